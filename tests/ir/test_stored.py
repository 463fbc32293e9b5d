"""Structures as bytes: what comes back is what went in, and nothing but data does."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.expression.dag import TIME, const, slot
from lmoc.ir.flat import Kind
from lmoc.ir.stored import NotStorable, restore, store
from lmoc.ir.text import text

MODELS = Path(__file__).parents[2] / "models"
SCENES = ["notes/ex05_suspension", "notes/fig6_string_over_pulley", "planar/four_bar", "hard/h10_bouncing_ball"]


@pytest.mark.parametrize("scene", [s for s in SCENES if (MODELS / f"{s}.lmo").exists()])
def test_a_scene_comes_back_as_it_was(scene):
    dae = lmoc.compile(MODELS / f"{scene}.lmo")
    reduced = replace(dae.reduced, guards=(), guess_at=None)
    flat, again = restore(store((dae.flat, reduced)))
    assert text(flat) == text(dae.flat)
    assert text(again) == text(reduced)
    assert np.array_equal(again.values, reduced.values, equal_nan=True)
    assert again.rhs[0].shape is reduced.rhs[0].shape  # expressions are interned again


def test_plain_values():
    shared = np.arange(6, dtype=np.int32).reshape(2, 3)
    values = {"a": (1,), (1, 2): Kind.INPUT}
    given = (None, True, -1.5, float("inf"), "ä\0", [1, (2, "x")], values, shared, {"same": shared})
    back = restore(store(given))
    assert back[:7] == given[:7] and type(back[1]) is bool and back[6][1, 2] is Kind.INPUT
    assert back[7].dtype == np.int32 and (back[7] == shared).all() and back[8]["same"] is back[7]
    back[7][0, 0] = 9  # arrays can be written to as before
    assert np.isnan(restore(store(float("nan"))))
    assert restore(store(np.zeros((0, 3)))).shape == (0, 3)


def test_expressions_are_the_same_nodes():
    e = (slot(0, 1) * const(-2.5) + TIME) ** slot(1)
    assert restore(store({"e": (e, e.args[0])}))["e"] == (e, e.args[0])
    assert restore(store(e)) is e


@dataclass(frozen=True)
class Foreign:
    value: int


@pytest.mark.parametrize("thing", [print, lambda: 0, Foreign(1), np.array([None]), {1, 2}])
def test_what_is_no_data_is_refused(thing):
    with pytest.raises(NotStorable):
        store((1, thing))


@pytest.mark.parametrize("name", ["os:system", "lmoc.cli.main:main", "lmoc.ir.flat:np", "builtins:object"])
def test_other_classes_are_not_made(name):
    head = f'{{"classes":["{name}"],"arrays":[],"objects":[],"root":1}}'.encode()
    with pytest.raises((ValueError, AttributeError)):
        restore(len(head).to_bytes(8, "little") + head)


def test_damaged_bytes():
    whole = store((np.arange(100), "text"))
    for cut in (3, 20, len(whole) // 2, len(whole) - 1):
        with pytest.raises((ValueError, KeyError, TypeError, IndexError)):
            restore(whole[:cut])
