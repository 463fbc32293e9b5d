"""The tableau of constraints, written out for casadi and by numpy."""

from types import SimpleNamespace

import numpy as np
import pytest

from lmoc.numerics.coordinates.tableau import scaled, tableau
from lmoc.numerics.coordinates.unrolled_tableau import MOST_ROWS, unrolled


def function(matrix: np.ndarray, pattern: np.ndarray, watched: np.ndarray):
    """The written-out tableau of matrices with a pattern, called with one of them."""
    import casadi as ca

    row, column = np.nonzero(pattern)
    rows, columns = matrix.shape
    own = SimpleNamespace(rows=rows, row=row, column=column, variable=np.zeros(columns, int), watched=watched)
    entries = ca.SX.sym("e", len(row))
    table, sign = ca.Function("f", [entries], list(unrolled(entries, own)))(matrix[row, column])
    return np.array(table), float(sign)


@pytest.mark.parametrize("rows", range(1, MOST_ROWS + 1))
@pytest.mark.parametrize("states", [1, 3])
def test_it_is_that_of_numpy(rows, states):
    rng = np.random.default_rng(10 * rows + states)
    watched = np.sort(rng.choice(rows, max(1, rows // 2), replace=False))
    for share in (0.3, 0.6, 1.0):
        pattern = rng.random((rows, rows + states)) < share
        pattern[np.arange(rows), rng.permutation(rows)] = True  # so that it can be regular
        for _ in range(5):
            matrix = np.where(pattern, rng.standard_normal(pattern.shape) * 10 ** rng.uniform(-3, 3, (rows, 1)), 0.0)
            expected = tableau(matrix, watched, np.ones(rows + states))
            table, sign = function(matrix, pattern, watched)
            assert sign == expected.sign
            assert table == pytest.approx(expected.table, rel=1e-6, abs=1e-9 * np.abs(expected.table).max())


def test_rows_change_places_by_their_numbers():
    pattern = np.ones((2, 3), bool)
    for first in (0.0, 1e-30, -1e-30, 1.0):
        matrix = np.array([[first, 1.0, 2.0], [1.0, 0.0, 3.0]])
        table, sign = function(matrix, pattern, np.array([0, 1]))
        assert sign == -1.0
        assert table[:, 0] == pytest.approx(np.linalg.solve(matrix[:, :2], matrix[:, 2]))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_determines_nothing(bad):
    matrix = np.array([[1.0, bad, 2.0], [1.0, 1.0, 3.0]])
    found = scaled(*function(matrix, np.ones((2, 3), bool), np.array([0, 1])), np.array([0, 1]), np.ones(3))
    assert found.sign == 0.0 and found.worst(np.array([0])) == np.inf


def test_singular_matrices():
    for matrix in (np.zeros((2, 3)), np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 0.0]])):
        found = scaled(*function(matrix, np.ones((2, 3), bool), np.array([0, 1])), np.array([0, 1]), np.ones(3))
        assert found.sign == 0.0 and found.worst(np.array([0])) == np.inf
        assert tableau(matrix, np.array([0, 1]), np.ones(3)).sign == 0.0
    empty = np.array([[True, False, True], [True, False, True]])  # whatever the numbers
    assert scaled(*function(np.ones((2, 3)), empty, np.array([0])), np.array([0]), np.ones(3)).sign == 0.0
