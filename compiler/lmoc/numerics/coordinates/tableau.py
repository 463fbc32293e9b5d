"""Constraint matrices seen as a whole: their rank, and which columns are the states if all are chosen anew."""

from __future__ import annotations

import math

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.coordinates.limits import LIMITS, limits_in_c
from lmoc.numerics.limits import INFINITE
from lmoc.numerics.plan.plan import Plan

LARGE, SMALL = 10.0, 1e3  # times the unit is a mechanism's size at the most; times that size the unit is


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


def coordinate_units(plan: Plan, known: np.ndarray) -> np.ndarray:
    """(columns,) in what units the coordinates of a plan's constraints are compared with each other.

    Angles in radians, lengths in metres; but where the mechanism is so small, or so large, that an entry of an angle
    in a constraint would be next to nothing beside that of a length, or the other way round, in a unit of its size.

    Parameters
    ----------
    known : (k,) values of the parameters in `Plan.known`
    """
    flat = plan.reduced.flat
    is_length = flat.per_variable(lambda b: b.unit == "m", np.bool_)
    lengths = np.abs(known[is_length[plan.known[1]]])
    size = float(lengths[lengths <= INFINITE].max(initial=0.0)) or 1.0
    unit = size * min(max(1 / size, 1 / LARGE), SMALL)
    return np.where(is_length[plan.reduced.constraints.variable], unit, 1.0)


def in_rows_of_one_size(
    shape: tuple[int, int], place: np.ndarray, entries: np.ndarray, units: np.ndarray
) -> np.ndarray:
    """Return entries of a matrix with rows of one size at this place.

    Parameters
    ----------
    shape : numbers of rows and columns
    place, entries : (n,) where they stand in the matrix by rows (int32), and their values
    units : (columns,) of coordinates
    """
    own, work = np.array(entries, float).ravel(), np.empty(shape[0])
    addresses = [a.ctypes.data for a in (place, units, own, work)]
    library().lmoc_rows_of_one_size(*shape, len(own), *addresses)
    return own


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
