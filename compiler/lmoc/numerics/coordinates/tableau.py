"""Dependence of coordinates on each other: the tableau T = A⁻¹B of constraints A·dq_dep + B·dq_state = 0.

An entry of T is the factor by which the determinant of A grows if that dependent coordinate and that state change
places. So the choice of coordinates is good as long as no entry is large, and the exchange at the largest entry is the
best single one (Goreinov, Oseledets, Savostyanov, Tyrtyshnikov & Zamarashkin, How to find a good submatrix, 2010; the
partitioning of coordinates is Wehage & Haug's, J. Mech. Design 104, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_GOOD = 1.5  # the largest entry with which exchanges end
_VANISHING = 1e-6  # as small a singular value of A, where a piece begins, is none


@dataclass(frozen=True, eq=False)
class Tableau:
    """A choice of coordinates at one place.

    Attributes
    ----------
    table : (watched, states) T in the rows of the watched dependent coordinates, in units of the coordinates' scales
    sign : of the determinant of A
    """

    table: np.ndarray
    sign: float

    def worst(self, rows: np.ndarray) -> float:
        """Return the largest entry in some rows; infinity where the dependent coordinates do not follow at all."""
        size = float(np.abs(self.table[rows]).max(initial=0.0))
        return size if np.isfinite(size) and self.sign else np.inf


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
        return Tableau(np.full((len(watched), b.shape[1]), np.inf), 0.0)
    full = np.linalg.solve(a, b)
    return Tableau(full[watched] * scale[watched][:, None] / scale[rows:], sign)


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


def vanishes(matrix: np.ndarray) -> bool:
    """Whether the dependent coordinates do not follow, in rows of one size."""
    size = np.abs(matrix).max(axis=1, keepdims=True)
    a = (matrix / np.where(size > 0, size, 1.0))[:, : len(matrix)]
    return not np.isfinite(a).all() or bool(np.linalg.svd(a, compute_uv=False)[-1] < _VANISHING)


def rank_margin(matrix: np.ndarray, size: np.ndarray) -> float:
    """Return the smallest singular value of all constraints: zero where they depend on each other, whatever the choice.

    Parameters
    ----------
    size : (rows, 1) of the rows
    """
    if not np.isfinite(matrix).all():
        return 0.0
    return float(np.linalg.svd(matrix / np.where(size > 0, size, 1.0), compute_uv=False)[-1])
