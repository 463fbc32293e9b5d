"""Dependence of coordinates on each other: the tableau T = A⁻¹B of constraints A·dq_dep + B·dq_state = 0.

An entry of T is the factor by which the determinant of A grows if that dependent coordinate and that state change
places. So the choice of coordinates is good as long as no entry is large, and the exchange at the largest entry is the
best single one (Goreinov, Oseledets, Savostyanov, Tyrtyshnikov & Zamarashkin, How to find a good submatrix, 2010; the
partitioning of coordinates is Wehage & Haug's, J. Mech. Design 104, 1982).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lmoc.numerics.limits import NO_ENTRY
from lmoc.support.records import dataclass

_GOOD = 1.5  # the largest entry with which exchanges end
VANISHING = 1e-6  # as small a singular value of A, where a segment begins, is none
_NORMALIZATIONS, AGAIN, NORMAL = 30, 6, 1e-2
SHARE = 0.5  # of the longest straight way on which the rank is certainly kept: the way of a motion is curved


@dataclass(frozen=True, eq=False)
class Tableau:
    """A choice of coordinates at one place.

    Attributes
    ----------
    table : (watched, states) T in the rows of the watched dependent coordinates, in units of the coordinates' scales
    sign : of the determinant of A
    plain : (watched, states) T in the coordinates' own units
    signs : of the determinants of the blocks of A, a byte each; empty where it is not seen in blocks
    """

    table: np.ndarray
    sign: float
    plain: np.ndarray
    signs: bytes = b""

    def worst(self, rows: np.ndarray) -> float:
        """Return the largest entry in some rows; infinity where the dependent coordinates do not follow at all."""
        table = self.table if rows.all() else self.table[rows]
        size = float(np.abs(table).max(initial=0.0))
        return size if math.isfinite(size) and self.sign else np.inf


def tableau(matrix: np.ndarray, watched: np.ndarray, scale: np.ndarray) -> Tableau:
    """Return the tableau of a constraint matrix.

    Parameters
    ----------
    matrix : (rows, rows + states)
    watched : rows of the tableau
    scale : (columns,) sizes of the columns
    """
    rows = len(matrix)
    a, b = matrix[:, :rows], matrix[:, rows:]
    sign = float(np.linalg.slogdet(a)[0]) if np.isfinite(a).all() else 0.0
    if sign == 0.0:
        return scaled(np.zeros((len(watched), b.shape[1])), 0.0, watched, scale)
    return scaled(np.linalg.solve(a, b)[watched], sign, watched, scale)


def scaled(table: np.ndarray, sign: float, watched: np.ndarray, scale: np.ndarray) -> Tableau:
    """Return the tableau from T in its rows; all infinite where the sign is not 1 or -1."""
    if abs(sign) != 1.0:
        nothing = np.full(table.shape, np.inf)
        return Tableau(nothing, 0.0, nothing)
    return Tableau(table * scale[watched][:, None] / scale[len(scale) - table.shape[1] :], sign, table.copy())


def exchanged(found: Tableau, barred: np.ndarray) -> list[tuple[int, int]]:
    """Return the exchanges (row of the tableau, state) that lead to a good choice, the first of them the best.

    Parameters
    ----------
    barred : (watched,) mask of dependent coordinates that cannot be states
    """
    table, exchanges, barred = found.table.copy(), [], barred.copy()
    for _ in range(4 * table.size):
        size = np.where(barred[:, None], 0.0, np.abs(table))
        i, j = np.unravel_index(int(np.argmax(size)), size.shape)
        if not _GOOD < size[i, j] < np.inf:
            break
        exchanges.append((int(i), int(j)))
        barred[i] = False  # what was a state there can be one again
        pivot = table[i, j]
        row, column = table[i] / pivot, table[:, j].copy()
        table -= np.outer(column, row)
        table[i], table[:, j] = row, -column / pivot
        table[i, j] = 1.0 / pivot
    return exchanges


def states_after(exchanges: list[tuple[int, int]], watched: np.ndarray, rows: int, columns: int) -> list[int]:
    """Return the columns that are states after some exchanges.

    Parameters
    ----------
    exchanges : (row of the tableau, state), as from `exchanged`
    watched : (watched,) rows of the tableau
    rows, columns : numbers of the constraint matrix's rows and columns; the states are its last columns
    """
    held, dependent = list(range(rows, columns)), watched.tolist()
    for i, j in exchanges:
        dependent[i], held[j] = held[j], dependent[i]
    return held


def states_by_pivots(matrix: np.ndarray) -> list[int]:
    """Return the states left where the dependent coordinates are chosen anew, by elimination with full pivoting.

    Parameters
    ----------
    matrix : (rows, rows + states), equilibrated

    Returns
    -------
    list
        Columns; empty where the rows depend on each other, or where the choice is the present one.
    """
    rows, a = len(matrix), matrix.copy()
    chosen: list[int] = []
    left = list(range(rows))
    for _ in range(rows):
        block = np.abs(a[left])
        block[:, chosen] = 0.0
        i, j = np.unravel_index(int(np.argmax(block)), block.shape)
        if not block[i, j] > NO_ENTRY:
            return []
        r = left.pop(int(i))
        chosen.append(int(j))
        a[left] -= np.outer(a[left, j] / a[r, j], a[r])
    held = [k for k in range(matrix.shape[1]) if k not in chosen]
    return held if held != list(range(rows, matrix.shape[1])) else []


def in_rows_of_one_size(matrix: np.ndarray) -> np.ndarray:
    """Return a matrix with its rows divided by their largest magnitudes."""
    size = np.abs(matrix).max(axis=1, keepdims=True)
    return matrix / np.where(size > 0, size, 1.0)


def vanishes(matrix: np.ndarray) -> bool:
    """Return whether the dependent coordinates do not follow, in rows of one size."""
    a = in_rows_of_one_size(matrix)[:, : len(matrix)]
    return not np.isfinite(a).all() or bool(np.linalg.svd(a, compute_uv=False)[-1] < VANISHING)


def equilibrated(size: np.ndarray, before: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return factors of the rows and columns with which a matrix of these sizes has rows and columns of one length.

    They make what is measured in the scaled matrix independent of the units of equations and coordinates. By
    alternating normalization (Sinkhorn & Knopp, Pacific J. Math. 21, 1967) until that changes little.

    Parameters
    ----------
    before : factors of the columns of a matrix that was similar
    """
    largest = size.max(axis=1, keepdims=True, initial=0.0)
    squares = np.where(np.isfinite(size) & (size > NO_ENTRY * largest), size, 0.0) ** 2
    return normalized(lambda factors: squares @ factors, lambda factors: factors @ squares, squares.shape[1], before)


def normalized(
    rows: Callable[[np.ndarray], np.ndarray],
    columns: Callable[[np.ndarray], np.ndarray],
    count: int,
    before: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the factors of `equilibrated` for a matrix of squares S.

    Parameters
    ----------
    rows, columns : ``S @ factors`` of its columns, and ``factors @ S`` of its rows
    count : of its columns
    """
    sums = rows(np.ones(count))
    no_row, no_column = 1.0 * (sums == 0.0), 1.0 * (columns(np.ones(len(sums))) == 0.0)  # which keep the factor 1
    column = np.ones(count) if before is None else before**2
    for k in range(_NORMALIZATIONS if before is None else AGAIN):
        row = 1.0 / (rows(column) + no_row)
        last, column = column, 1.0 / (columns(row) + no_column)
        if k % 2 and (np.abs(column - last) <= NORMAL * column).all():
            break
    return np.sqrt(1.0 / (rows(column) + no_row)), np.sqrt(column)


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
    allowed = SHARE * margins
    entries = change.ravel()
    return math.sqrt(float(entries @ entries)) <= allowed or float(np.linalg.norm(change, 2)) <= allowed
