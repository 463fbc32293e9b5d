"""Sparse factors of the engine against dense solutions, and what they cost where a row or column is full."""

import ctypes

import numpy as np
import pytest

from lmoc.engine.library import library

GOOD, SINGULAR = 1, 0


class Factors:
    """A matrix given densely; every entry of the pattern counts."""

    def __init__(self, pattern: np.ndarray) -> None:
        columns = [np.flatnonzero(c) for c in pattern.T]
        self.start = np.concatenate([[0], np.cumsum([len(c) for c in columns])]).astype(np.int32)
        self.rows = np.concatenate(columns).astype(np.int32)
        self.columns = np.repeat(np.arange(len(columns)), np.diff(self.start))
        self.engine = library()
        self.handle = self.engine.lmoc_lu_new(len(columns), self.start.ctypes.data, self.rows.ctypes.data)

    def factor(self, matrix: np.ndarray, how: str = "factor") -> tuple[int, float]:
        values, determinant = np.ascontiguousarray(matrix[self.rows, self.columns]), ctypes.c_double()
        call = getattr(self.engine, f"lmoc_lu_{how}")
        found = call(self.handle, values.ctypes.data, *([] if how == "choose" else [ctypes.addressof(determinant)]))
        return found, determinant.value

    def solve(self, b: np.ndarray) -> np.ndarray:
        x = b.astype(float).copy()
        self.engine.lmoc_lu_solve(self.handle, x.ctypes.data)
        return x

    def __del__(self) -> None:
        self.engine.lmoc_lu_free(self.handle)


def random_matrix(rng, n: int, full: bool = False) -> np.ndarray:
    matrix = np.where(rng.random((n, n)) < 3 / n, rng.standard_normal((n, n)), 0.0)
    matrix[np.arange(n), rng.permutation(n)] += rng.choice([-2.0, 2.0], n)  # a diagonal somewhere: it is not singular
    if full:  # a row and a column with an entry everywhere
        matrix[n // 2], matrix[:, n // 3] = rng.standard_normal(n), rng.standard_normal(n)
    return matrix


@pytest.mark.parametrize("seed", range(60))
def test_solutions_and_determinants(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 120))
    matrix = random_matrix(rng, n, full=seed % 3 == 0)
    factors, b = Factors(matrix != 0), rng.standard_normal(n)
    found, determinant = factors.factor(matrix)
    if found != GOOD:
        assert np.linalg.cond(matrix) > 1e12
        return
    x = factors.solve(b)
    scale = np.abs(matrix) @ np.abs(x) + np.abs(b)
    assert np.abs(matrix @ x - b).max() <= 1e-11 * scale.max()
    assert abs(determinant) == pytest.approx(abs(np.linalg.det(matrix)), rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_other_values_on_the_same_pivots(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 60))
    matrix = random_matrix(rng, n)
    factors, b = Factors(matrix != 0), rng.standard_normal(n)
    if factors.factor(matrix)[0] != GOOD:
        return
    other = matrix * (1 + 0.01 * rng.standard_normal((n, n)))
    assert factors.factor(other, "refactor")[0] == GOOD
    x = factors.solve(b)
    assert np.abs(other @ x - b).max() <= 1e-10 * (np.abs(other) @ np.abs(x) + np.abs(b)).max()


@pytest.mark.parametrize("seed", range(8))
def test_listed_operations_have_the_bits_of_loops_over_columns(seed):
    """Beside a large full matrix, which nothing ties to it, the same matrix is factorized without a list."""
    rng = np.random.default_rng(seed)
    n, full = int(rng.integers(2, 80)), 130
    matrix, b = random_matrix(rng, n), rng.standard_normal(n)
    both = np.zeros((n + full, n + full))
    both[:n, :n], both[n:, n:] = matrix, rng.standard_normal((full, full)) + 20 * np.eye(full)
    alone, beside = Factors(matrix != 0), Factors(both != 0)
    if alone.factor(matrix)[0] != GOOD:
        return
    assert beside.factor(both)[0] == GOOD
    assert (alone.solve(b) == beside.solve(np.concatenate([b, np.ones(full)]))[:n]).all()
    other = 1 + 0.01 * rng.standard_normal((n, n))
    both[:n, :n] *= other
    assert alone.factor(matrix * other, "refactor")[0] == beside.factor(both, "refactor")[0]
    assert (alone.solve(b) == beside.solve(np.concatenate([b, np.ones(full)]))[:n]).all()


def test_a_pivot_that_vanishes_is_reselected():
    matrix = np.array([[2.0, 1.0], [1.0, 3.0]])
    factors = Factors(np.ones((2, 2), bool))
    assert factors.factor(matrix)[0] == GOOD
    turned = np.array([[0.0, 1.0], [1.0, 0.0]])
    assert factors.factor(turned, "refactor")[0] == SINGULAR
    assert factors.factor(turned)[0] == GOOD
    assert factors.solve(np.array([3.0, 5.0])) == pytest.approx([5.0, 3.0])


@pytest.mark.parametrize("matrix", [[[0.0]], [[1.0, 2.0], [2.0, 4.0]], [[np.nan]], [[np.inf]]])
def test_what_has_no_factors(matrix):
    factors = Factors(np.ones(np.shape(matrix), bool))
    assert factors.factor(np.array(matrix))[0] == SINGULAR


def test_values_that_are_no_numbers_keep_the_order():
    factors = Factors(np.ones((2, 2), bool))
    assert factors.factor(np.array([[2.0, 1.0], [1.0, 3.0]]))[0] == GOOD
    assert factors.factor(np.full((2, 2), np.nan))[0] == SINGULAR
    assert factors.factor(np.array([[2.0, 1.0], [1.0, 3.0]]), "refactor")[0] == GOOD


def test_an_arrowhead_fills_nothing():
    """10⁵ unknowns, of which one is in every equation: as a sum of forces on the ground."""
    n = 100_000
    start = np.concatenate([np.arange(0, 2 * n - 1, 2), [3 * n - 2]]).astype(np.int32)
    rows = np.concatenate([np.stack([np.arange(n - 1), np.full(n - 1, n - 1)], axis=1).ravel(), np.arange(n)])
    rows = rows.astype(np.int32)
    values = np.ones(len(rows))
    values[-1] = 2 * n  # the corner
    engine, determinant, x = library(), ctypes.c_double(), np.ones(n)
    handle = engine.lmoc_lu_new(n, start.ctypes.data, rows.ctypes.data)
    try:
        assert engine.lmoc_lu_factor(handle, values.ctypes.data, ctypes.addressof(determinant)) == GOOD
        engine.lmoc_lu_solve(handle, x.ctypes.data)
    finally:
        engine.lmoc_lu_free(handle)
    corner = (1 - (n - 1)) / (2 * n - (n - 1))
    assert x[-1] == pytest.approx(corner) and x[:-1] == pytest.approx(1 - corner)
