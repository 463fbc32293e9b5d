"""Reductions of one model with other states share what does not depend on these, and are the same as alone."""

from __future__ import annotations

from pathlib import Path

import lmoc
import lmoc.structure.reduce as reduction
from lmoc.ir.text.reduced import reduced_text
from lmoc.structure.coordinates import selection, tied
from lmoc.structure.coordinates.shared import Shared
from lmoc.structure.reduce import reduce

FOUR_BAR = Path(__file__).parents[2] / "models/hard/h03_four_bar.lmo"


def test_a_start_is_looked_for_once_and_the_results_are_the_same(monkeypatch):
    flat = lmoc.compile(FOUR_BAR).flat
    asked = [None, ("right.phi",), ("coupler.dy",), ("left.phi",)]
    alone = [reduce(flat, states=states) for states in asked]
    looked = []
    found = tied.start_point
    for room in (tied, selection):  # the guards of a reduction, which its check asks, do not look for it again
        monkeypatch.setattr(room, "start_point", lambda *given: looked.append(given) or found(*given))
    shared = Shared()
    together = [reduce(flat, states=states, shared=shared) for states in asked]
    assert len(looked) == 1
    assert len({tuple(r.state_names) for r in alone}) == 3
    for own, other in zip(alone, together, strict=True):
        assert reduced_text(own) == reduced_text(other)
        assert own.guess.values.tobytes() == other.guess.values.tobytes()
        assert [n.message for n in own.notes] == [n.message for n in other.notes]
        assert [g.text for g in own.guards] == [g.text for g in other.guards]


def test_other_parameter_values_share_nothing():
    flat = lmoc.compile(FOUR_BAR).flat
    shared = Shared()
    first, values = reduce(flat, shared=shared), flat.parameter_values()
    values[flat.find("coupler.L")] *= 1.01
    there, alone = reduce(flat, values, shared=shared), reduce(flat, values)
    assert there.guess.values.tobytes() == alone.guess.values.tobytes()
    assert there.guess.values.tobytes() != first.guess.values.tobytes()


def test_two_reductions_at_once_keep_their_own_starts(monkeypatch):
    flat = lmoc.compile(FOUR_BAR).flat
    shared, values, solve = Shared(), flat.parameter_values(), reduction.solve_structure
    values[flat.find("coupler.L")] *= 1.01
    alone = reduce(flat)

    def in_between(*given):  # as another thread may come
        monkeypatch.undo()
        reduce(flat, values, shared=shared)
        return solve(*given)

    monkeypatch.setattr(reduction, "solve_structure", in_between)
    assert reduce(flat, shared=shared).guess.values.tobytes() == alone.guess.values.tobytes()
