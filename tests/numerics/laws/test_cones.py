"""Complementarity problems with the friction of contacts."""

import numpy as np
import pytest
from oracles.impacts import collide

from lmoc.numerics.laws.complementarity import NoSolution
from lmoc.numerics.laws.cones import NO_FRICTION, Friction, solve_with_cones


def assert_solves(matrix, q, friction, x):
    w, normal, rows = matrix @ x + q, friction.normal, friction.rows
    size = 1e-9 * (np.abs(matrix) @ np.abs(x) + np.abs(q)).max()
    limit = friction.share * x[normal]
    assert (x[normal] >= 0).all() and (w[normal] >= -size).all()
    assert np.abs(x[normal] * w[normal]).max() <= size * (1 + np.abs(x).max())
    assert (np.abs(x[rows]) <= limit * (1 + 1e-9) + 1e-12).all()
    slides = np.abs(w[rows]) > size
    assert x[rows][slides] == pytest.approx(-np.sign(w[rows][slides]) * limit[slides], rel=1e-6, abs=1e-12)


def test_a_slanted_bar_on_its_corner_slides_on_where_limits_tried_in_turn_grow_without_bound():
    """With each limit from the normal impulse before, that impulse grows by μ·|Wnt|/Wnn = 2.6 each time."""
    matrix = np.array([[0.0033, -0.0426], [-0.0426, 0.862]])
    rate, friction = np.array([-0.146, 2.779]), Friction(np.array([1]), np.array([0]), np.array([0.2]))
    normal = 0.146 / (0.0033 + 0.2 * 0.0426)
    found = collide(matrix, rate, np.zeros(2), friction)
    assert found.impulse == pytest.approx([normal, -0.2 * normal], rel=1e-12)
    assert found.rate == pytest.approx([0, 2.779 - normal * (0.0426 + 0.2 * 0.862)], abs=1e-12)
    assert found.lost.sum() > 0


@pytest.mark.parametrize("seed", range(40))
def test_random_contacts(seed):
    dice = np.random.default_rng(seed)
    count = int(dice.integers(1, 6))
    rows = dice.normal(size=(2 * count, 2 * count + 1)) * 10.0 ** dice.uniform(-2, 2, size=(2 * count, 1))
    matrix, q = rows @ rows.T, rows @ dice.normal(size=2 * count + 1)
    friction = Friction(np.arange(count, 2 * count), np.arange(count), dice.uniform(0, 1.5, count))
    found = solve_with_cones(matrix, q, np.zeros(2 * count), np.full(2 * count, np.inf), friction)
    assert_solves(matrix, q, friction, found.x)


def test_bounds_beside_cones():
    matrix, q = np.array([[2.0, 0.5, 0.3], [0.5, 1.0, 0.1], [0.3, 0.1, 1.0]]), np.array([-1.0, 2.0, 5.0])
    friction = Friction(np.array([1]), np.array([0]), np.array([0.1]))
    found = solve_with_cones(matrix, q, np.array([0, 0, -2.0]), np.array([np.inf, np.inf, 2.0]), friction)
    normal = (1.0 + 0.3 * 2.0) / (2.0 - 0.05)
    assert found.x == pytest.approx([normal, -0.1 * normal, -2.0], rel=1e-12)


def test_what_has_no_solution_is_said_to_have_none():
    with pytest.raises(NoSolution):
        solve_with_cones(np.zeros((1, 1)), np.array([-1.0]), np.zeros(1), np.full(1, np.inf), NO_FRICTION)
