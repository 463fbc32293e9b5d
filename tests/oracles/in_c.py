"""Runs whose segments follow each other in C, and the same one by one in Python."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import lmoc
from lmoc.numerics.run import segments

WAYS = segments._Run._through_segments, lambda run, x: (x, False)  # in C, and in Python


def both_ways(
    simulate: Callable[[], lmoc.Run], bits: Callable[[lmoc.Run], tuple], monkeypatch: pytest.MonkeyPatch
) -> tuple[tuple, tuple, int]:
    """Return the bits of a run that C goes through, those of one that Python does, and how many segments C has gone."""
    passed = []

    def through(run, x):
        before = len(run.segments)
        found = WAYS[0](run, x)
        passed.append(len(run.segments) - before)
        return found

    monkeypatch.setattr(segments._Run, "_through_segments", through)
    together = bits(simulate())
    monkeypatch.setattr(segments._Run, "_through_segments", WAYS[1])
    return together, bits(simulate()), sum(passed)
