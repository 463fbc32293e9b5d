"""The order of pivots of a sparse matrix and the pattern of its factors, chosen once for values that change little.

Markowitz' criterion with threshold pivoting (Duff, Erisman, Reid, Direct Methods for Sparse Matrices, 2nd ed., 2017,
chapters 7 and 10). What follows from it, the pattern of L and U, lets C factorize the next matrices in a single pass,
as KLU's refactor does (Davis and Palamadai Natarajan, ACM TOMS 37, 2010, Algorithm 907); when a pivot has become
small beside its column, an order is reselected.
"""

from __future__ import annotations

import heapq

import numpy as np

from lmoc.support.records import dataclass

_THRESHOLD = 0.1  # of the largest number in its column: as small as a pivot may be for the sake of sparsity


@dataclass(frozen=True, eq=False)
class Order:
    """Pivots and patterns; everything by columns in the order of the pivots.

    Attributes
    ----------
    row, column : (n,) int32
        Row and column of each pivot in the matrix.
    a : (start, place, source)
        Entries of the matrix: the pivot whose row they stand in, and where they are among the values.
    upper, lower : (start, place)
        Entries of U above and of L below the diagonal.
    """

    row: np.ndarray
    column: np.ndarray
    a: tuple[np.ndarray, np.ndarray, np.ndarray]
    upper: tuple[np.ndarray, np.ndarray]
    lower: tuple[np.ndarray, np.ndarray]


def choose(indptr: np.ndarray, rows: np.ndarray, values: np.ndarray) -> Order | None:
    """Choose pivots for a matrix in compressed columns; None where it is singular.

    Entries that are zero count for the pattern, because the next values may not be.
    """
    n = len(indptr) - 1
    pivots = _eliminate(n, indptr, rows, values)
    if pivots is None:
        return None
    row = np.array([p[0] for p in pivots], np.int32)
    column = np.array([p[1] for p in pivots], np.int32)
    place_of_row, place_of_column = np.empty(n, np.int32), np.empty(n, np.int32)
    place_of_row[row] = place_of_column[column] = np.arange(n, dtype=np.int32)
    below = [place_of_row[list(p[2])] for p in pivots]
    right = [place_of_column[list(p[3])] for p in pivots]
    owner = np.repeat(np.arange(n), [len(r) for r in right])
    beside = np.concatenate([*right, np.zeros(0, np.int32)])
    by_column = np.lexsort((owner, beside))  # a column of U in the order in which its entries are eliminated
    source = [np.arange(indptr[c], indptr[c + 1]) for c in column.tolist()]
    entries = np.concatenate([*source, np.zeros(0, int)]).astype(int)
    return Order(
        row,
        column,
        (_starts([len(s) for s in source]), place_of_row[rows[entries]], entries.astype(np.int32)),
        (_starts(np.bincount(beside, minlength=n)), owner[by_column].astype(np.int32)),
        (_starts([len(b) for b in below]), np.concatenate([*below, np.zeros(0, int)]).astype(np.int32)),
    )


def _starts(lengths) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def _eliminate(n: int, indptr: np.ndarray, rows: np.ndarray, values: np.ndarray) -> list[tuple] | None:
    """Gauss elimination; for each pivot its row, its column, the rows below and the columns to the right of it."""
    row: list[dict[int, float]] = [{} for _ in range(n)]
    column: list[set[int]] = [set() for _ in range(n)]
    owner = np.repeat(np.arange(n), np.diff(indptr))
    for i, j, value in zip(rows.tolist(), owner.tolist(), values.tolist(), strict=True):
        row[i][j] = value
        column[j].add(i)
    heap = [(len(column[j]), j) for j in range(n)]
    heapq.heapify(heap)
    done, pivots = [False] * n, []
    while heap:
        length, j = heapq.heappop(heap)
        if done[j] or length != len(column[j]):  # an entry that has been replaced
            continue
        i = _pivot_row(row, column[j], j)
        if i is None:
            return None
        done[j] = True
        pivots.append(_eliminate_one(row, column, i, j))
        for k in pivots[-1][3]:
            heapq.heappush(heap, (len(column[k]), k))
    return pivots


def _pivot_row(row: list[dict[int, float]], candidates: set[int], j: int) -> int | None:
    """Of the rows whose number in column j is large enough the shortest."""
    largest = max((abs(row[i][j]) for i in candidates), default=0.0)
    if not largest > 0.0:
        return None
    good = [i for i in candidates if abs(row[i][j]) >= _THRESHOLD * largest]
    return min(good, key=lambda i: (len(row[i]), -abs(row[i][j]), i))


def _eliminate_one(row: list[dict[int, float]], column: list[set[int]], i: int, j: int) -> tuple:
    """Subtract multiples of row i from those below, and take it away."""
    own = row[i]
    pivot = own.pop(j)
    column[j].discard(i)
    below = sorted(column[j])
    for k in own:
        column[k].discard(i)
    for b in below:
        target = row[b]
        factor = target.pop(j) / pivot
        for k, value in own.items():
            if k in target:
                target[k] -= factor * value
            else:
                target[k] = -factor * value
                column[k].add(b)
    column[j].clear()
    return i, j, below, sorted(own)


class Factors:
    """The factors of one matrix in the form that C reads and fills (``lmoc_factors`` in ``c/matrices.c``)."""

    def __init__(self, number: int, indptr: np.ndarray, rows: np.ndarray) -> None:
        self.indptr, self.rows = indptr, rows
        self.handle = np.zeros(16, np.int64)
        self.handle[0], self.handle[2] = len(indptr) - 1, number
        self._arrays: list[np.ndarray] = []

    def choose(self, values: np.ndarray) -> bool:
        """Choose the order of pivots for these values; False where the matrix is singular."""
        order = choose(self.indptr, self.rows, values)
        self.handle[1] = order is not None
        if order is None:
            return False
        n = len(order.row)
        numbers = [np.zeros(max(1, len(order.upper[1]))), np.zeros(max(1, len(order.lower[1]))), np.zeros(n)]
        self._arrays = [*order.a, *order.upper, *order.lower, order.row, order.column, *numbers, np.zeros(2 * n)]
        self._arrays = [np.ascontiguousarray(a) for a in self._arrays]
        self.handle[3 : 3 + len(self._arrays)] = [a.ctypes.data for a in self._arrays]
        return True

    def forget(self) -> None:
        """Have pivots reselected for the next values."""
        self.handle[1] = 0
