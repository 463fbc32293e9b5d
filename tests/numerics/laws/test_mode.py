"""The mode that forces decide: each law holds as it is written, or no forces are found."""

import numpy as np
import pytest
from oracles.lawful import free_mode, settle

from lmoc.ir.law import NONE, LawKind
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import KINDS, Instant, LawTable

GAP, FRICTION, CONTACT = (
    KINDS.index(kind) for kind in (LawKind.UNILATERAL, LawKind.DRY_FRICTION, LawKind.CONTACT_FRICTION)
)


def instant(delassus, bias, limit):
    nothing = np.zeros(len(bias))
    return Instant(
        0.0, np.zeros(1), *[nothing] * 4, np.zeros((2, len(bias), 1)), np.array(bias), np.array(delassus),
        np.zeros((1, len(bias))), np.array(limit), np.array(limit), np.nan,
    )  # fmt: skip


def laws(kind, normal=None, degree=None):
    n = len(kind)
    degree = np.full(n, 2) if degree is None else np.array(degree)
    return LawTable(np.array(kind), degree, np.zeros(n), np.full(n, NONE) if normal is None else np.array(normal))


@pytest.mark.parametrize("seed", range(40))
def test_every_law_holds(seed):
    """Gaps and dry friction between bodies in a row, some of which depend on each other, under random loads."""
    dice = np.random.default_rng(seed)
    n = int(dice.integers(1, 9))
    motion = np.round(dice.normal(size=(n, n + 1))) if seed % 2 else dice.normal(size=(n, n + 2))
    motion[:, 0] += (motion == 0).all(axis=1)
    kind, delassus = dice.choice([GAP, FRICTION], n), motion @ motion.T
    bias = motion @ dice.normal(size=motion.shape[1])
    limit = np.where(kind == GAP, np.nan, dice.choice([0.1, 1.0], n))
    table, now, candidate = laws(kind), instant(delassus, bias, limit), dice.random(n) < 0.8
    sliding = np.where(candidate | (kind == GAP), 0, dice.choice([-1, 1], n))
    found = settle(table, now, free_mode(table), candidate, sliding, np.zeros(n, int))
    force, level, closed, direction = found.force, found.level, found.mode.closed, found.mode.direction
    small = 1e-9 * (np.abs(bias) + np.abs(delassus) @ np.abs(force))
    assert level == pytest.approx(bias + delassus @ force, abs=small.max())
    assert (closed <= candidate).all() and (np.abs(level[closed]) <= small[closed]).all()
    gap, dry = kind == GAP, kind == FRICTION
    assert (force[gap & closed] >= 0).all() and not force[gap & ~closed].any()
    assert (level[gap & candidate & ~closed] >= -small[gap & candidate & ~closed]).all()
    assert (np.abs(force[dry]) <= limit[dry] * (1 + 1e-9)).all()
    slides = dry & ~closed
    assert force[slides] == pytest.approx((-direction * limit)[slides])
    begins = slides & candidate & (np.abs(level) > small)
    assert (np.sign(level) == direction)[begins].all()


def test_a_contact_that_its_own_friction_would_press_opens():
    """Sliding, the friction pushes the bodies together by more than they part: 1 − 2·5 < 0 (Painlevé). Of the answers
    to that the one counts in which it would go on sliding in its direction: they part."""
    table = laws([GAP, CONTACT], normal=[NONE, 0])
    now = instant([[1.0, -2.0], [-2.0, 8.0]], [10.72, -43.0], [np.nan, 5.0])
    found = settle(table, now, free_mode(table), np.ones(2, bool), np.zeros(2, int), np.zeros(2, int))
    assert not found.mode.closed.any() and not found.force.any()
    assert found.level.tolist() == [10.72, -43.0] and found.mode.direction.tolist() == [0, -1]


def test_friction_that_presses_its_contact_more_than_that_yields():
    """Painlevé's paradox: 2.08 − 1·2.23 < 0, and the other friction of the contact has too little to give."""
    table = laws([GAP, CONTACT, CONTACT], normal=[NONE, 0, 0], degree=[2, 2, 1])
    delassus = [[2.08, 2.23, 0.48], [2.23, 4.03, 0.11], [0.48, 0.11, 0.35]]
    now, candidate = instant(delassus, [-10.0, -34.0, 3.7], [np.nan, 1.0, 0.3]), np.array([True, False, True])
    with pytest.raises(Contradiction, match="no forces") as failed:
        settle(table, now, free_mode(table), candidate, np.array([0, 1, 0]), np.zeros(3, int))
    assert 0 in failed.value.laws
