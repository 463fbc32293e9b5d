"""Constraint matrices seen as a whole: their rank, and which columns are the states if all are chosen anew."""

from __future__ import annotations

import math

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.coordinates.limits import LIMITS, limits_in_c


def states_by_pivots(matrix: np.ndarray) -> list[int]:
    """Return the states left where the dependent coordinates are chosen anew, by elimination with full pivoting.

    Parameters
    ----------
    matrix : (rows, rows + states), equilibrated

    Returns
    -------
    list
        Columns; empty where the rows depend on each other.
    """
    (rows, columns), held, own = matrix.shape, np.empty(matrix.shape[1], np.int32), np.array(matrix, order="C")
    found = library().lmoc_states_by_pivots(limits_in_c(), rows, columns, own.ctypes.data, held.ctypes.data)
    return held[: columns - rows].tolist() if found else []


def in_rows_of_one_size(matrix: np.ndarray) -> np.ndarray:
    """Return a matrix with its rows divided by their largest magnitudes."""
    size = np.abs(matrix).max(axis=1, keepdims=True)
    return matrix / np.where(size > 0, size, 1.0)


def rank_margin(matrix: np.ndarray) -> float:
    """Return the smallest singular value: zero where the rows depend on each other, whatever the choice of columns."""
    if not np.isfinite(matrix).all():
        return 0.0
    return float(np.linalg.svd(matrix, compute_uv=False)[-1])


def stays_regular(change: np.ndarray, margins: float) -> bool:
    """Return whether a matrix keeps its full rank on the way from one place to another nearby.

    Singular values change by no more than the matrix does (Weyl; Golub & Van Loan, Matrix Computations, 8.6), so that
    none vanishes on a straight way shorter than their sum at its ends.

    Parameters
    ----------
    change : of the matrix
    margins : the smallest singular values at both places, added
    """
    allowed = LIMITS.share * margins
    entries = change.ravel()
    return math.sqrt(float(entries @ entries)) <= allowed or float(np.linalg.norm(change, 2)) <= allowed
