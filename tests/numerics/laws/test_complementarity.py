"""Complementarity problems: conditions hold, dependent rows are recognized, contradictions are reported."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmoc.numerics.laws.complementarity import FREE, LOWER, UPPER, NoSolution, solve

INF = np.inf


def holds(matrix, q, lower, upper, found) -> bool:
    terms = 1e-9 * (np.abs(matrix) @ np.abs(found.x) + np.abs(q) + 1e-300)
    w = matrix @ found.x + q
    at_lower = (found.x <= lower + 1e-12) & (w >= -terms)
    at_upper = (found.x >= upper - 1e-12) & (w <= terms)
    between = (found.x >= lower - 1e-12) & (found.x <= upper + 1e-12) & (np.abs(w) <= terms)
    return bool((at_lower | at_upper | between).all())


@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(1, 40))
def test_the_conditions_hold(seed, n, rank):
    """Matrices G·Gᵀ of any rank, with right-hand sides in their range, as accelerations of gaps are."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, rank)) * 10.0 ** random.integers(-2, 3, size=(n, 1))
    matrix, q = root @ root.T, root @ random.normal(size=rank)
    lower = np.where(random.random(n) < 0.5, 0.0, -random.random(n))
    upper = np.where(lower == 0.0, INF, -lower)
    side = random.integers(-1, 2, size=n)
    found = solve(matrix, q, lower, upper, side)
    assert holds(matrix, q, lower, upper, found)
    assert solve(matrix, q, lower, upper).w == pytest.approx(found.w, abs=1e-6 * np.abs(q).max())


def test_a_chain_of_a_hundred_strings_that_are_all_taut():
    n = 100
    matrix = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    found = solve(matrix, np.r_[-1.0, np.zeros(n - 1)], np.zeros(n), np.full(n, INF))
    assert (found.side == FREE).all() and found.unique.all()
    assert found.x == pytest.approx(1 - np.arange(1, n + 1) / (n + 1), rel=1e-10)


def test_two_strings_side_by_side_share_a_force_that_is_not_determined():
    matrix = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = solve(matrix, np.array([-3.0, -3.0, -1.0]), np.zeros(3), np.full(3, INF))
    assert found.x[0] + found.x[1] == pytest.approx(3.0) and found.x[2] == pytest.approx(1.0)
    assert found.unique.tolist() == [False, False, True]


def test_friction_slips_at_its_limit_or_sticks():
    sides = [solve(np.eye(1), np.array([push]), np.array([-2.0]), np.array([2.0])).side[0] for push in (-3, 1, 3)]
    assert sides == [UPPER, FREE, LOWER]


def test_a_body_pressed_between_fixed_ones_has_no_solution():
    with pytest.raises(NoSolution):
        solve(np.zeros((1, 1)), np.array([-1.0]), np.zeros(1), np.full(1, INF))


def test_no_laws_are_no_problem():
    assert solve(np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0)).x.shape == (0,)


@pytest.mark.parametrize("seed", range(12))
def test_a_problem_that_falls_into_several(seed):
    """The same as the whole, with its components in any order and its sides begun anywhere."""
    dice = np.random.default_rng(seed)
    sizes = dice.integers(1, 5, size=9)
    n = int(sizes.sum())
    matrix, at = np.zeros((n, n)), 0
    for size in sizes.tolist():
        rows = dice.normal(size=(size, size + 1))
        matrix[at : at + size, at : at + size] = rows @ rows.T
        at += size
    order = dice.permutation(n)
    matrix, q = matrix[np.ix_(order, order)], dice.normal(size=n)
    lower, upper = np.where(dice.random(n) < 0.5, 0.0, -0.5), np.where(dice.random(n) < 0.5, np.inf, 0.5)
    found = solve(matrix, q, lower, upper, dice.integers(-1, 2, size=n))
    w = matrix @ found.x + q
    assert (found.x >= lower - 1e-12).all() and (found.x <= upper + 1e-12).all()
    assert found.unique.all() and found.w == pytest.approx(w, abs=1e-9)
    inside = (found.x > lower + 1e-9) & (found.x < upper - 1e-9)
    assert np.abs(w[inside]).max(initial=0) < 1e-9
    assert (w[found.x <= lower + 1e-9] >= -1e-9).all() and (w[found.x >= upper - 1e-9] <= 1e-9).all()


def test_which_part_of_a_problem_has_no_solution():
    matrix, q = np.eye(14), np.zeros(14)
    matrix[5, 5], q[5] = 0.0, -1.0
    with pytest.raises(NoSolution) as failed:
        solve(matrix, q, np.zeros(14), np.full(14, np.inf))
    assert np.flatnonzero(failed.value.x).tolist() == [5]
