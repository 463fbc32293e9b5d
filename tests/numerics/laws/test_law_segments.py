"""Segments that laws end, in C one after the other, and one by one in Python: the same bits."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracles.in_c import both_ways

import lmoc

MODELS = Path(__file__).parents[3] / "models" / "laws"


def bits(run: lmoc.Run) -> tuple[object, ...]:
    """Return all that a run has found."""
    trajectory = run.trajectory
    parts = [
        (s.begin, s.time.tobytes(), s.table.tobytes(), s.observer.base.tobytes(), s.largest, s.rounding, s.mode)
        for s in trajectory.segments
    ]
    plain = [
        (*own, *(None if v is None else v.tobytes() for v in (largest, rounding)), mode.key + mode.push.tobytes())
        for *own, largest, rounding, mode in parts
    ]
    counts = {k: v for k, v in trajectory.stats.items() if not k.endswith("seconds")}
    return plain, run.events, counts, dict(run.end)


@pytest.mark.parametrize(
    "name, options",
    [
        ("h16_stick_slip", {}),
        ("h34_slack_string", {"max_step": 0.1}),
        ("h19_bouncing_ball", {"solver": "taylor", "points": 7}),
        ("h19_bouncing_ball", {"keep": ["y"]}),
    ],
)
def test_bits_are_those_of_segments_one_by_one(name, options, monkeypatch):
    dae = lmoc.compile(MODELS / f"{name}.lmo")
    together, one_by_one, passed = both_ways(lambda: dae.simulate(**options), bits, monkeypatch)
    assert passed >= 1 and passed >= len(together[0]) - 3  # C has gone through nearly all of them
    assert one_by_one == together
