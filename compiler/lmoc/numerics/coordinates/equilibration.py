"""The sizes in which the entries of the constraint matrix are compared: the largest that each has had in the run.

An entry that vanishes at a place is small only beside those sizes: scaling rows and columns by what they are at that
place alone would not show it.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.coordinates.tableau import equilibrated, normalized
from lmoc.numerics.limits import NO_ENTRY

GROWN = 1.25  # by which the sizes of entries must have grown for rows and columns to be equilibrated again


class Equilibration:
    """Sizes of entries, and the factors that give rows and columns of these sizes one length.

    Attributes
    ----------
    size : (rows, columns) largest magnitude of each entry so far
    bound : (rows, columns) sizes up to which the factors serve
    scales : factors of the rows and of the columns; None where they are to be computed anew
    factor : (rows, columns) of each entry, from the last scales
    ranges : (columns,) largest share of each coordinate in an equation, for the tableau
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.size, self.bound = np.zeros((2, rows, columns))
        self.scales: tuple[np.ndarray, np.ndarray] | None = None
        self.factor, self.ranges = self.size, np.ones(columns)
        self._columns: np.ndarray | None = None  # the last factors of the columns

    def grow(self, size: np.ndarray) -> None:
        """Take note of the sizes (rows, columns) of entries; factors that no longer serve are dropped."""
        if not (size <= self.size).all():
            with np.errstate(invalid="ignore"):
                self.size = np.fmax(self.size, size)
            if self.scales is not None and not (size <= self.bound).all():
                self.scales = None

    def replace(self, size: np.ndarray) -> None:
        """Take other sizes (rows, columns), for which the factors are computed anew."""
        self.size, self.scales = size, None

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the factors of the rows and of the columns."""
        if self.scales is None:
            self.take(self._equilibrated())
        return self.scales

    def take(self, scales: tuple[np.ndarray, np.ndarray]) -> None:
        """Compare entries with these factors of the rows and columns from now on."""
        self.scales, self._columns, self.bound = scales, scales[1], GROWN * self.size
        ranges, self.factor = self._shares(), self._products(scales)
        self.ranges = np.where(ranges > 0, ranges, 1.0)

    def served(self) -> np.ndarray:
        """Return the sizes (rows, columns) that the factors were made for."""
        return self.bound / GROWN

    def scaled(self, matrix: np.ndarray) -> np.ndarray:
        """Return a matrix (rows, columns) in which rows and columns of the sizes so far have one length."""
        self.factors()
        return matrix * self.factor

    def _equilibrated(self) -> tuple[np.ndarray, np.ndarray]:
        return equilibrated(self.size, self._columns)

    def _shares(self) -> np.ndarray:
        """(columns,) the largest share of each in a row."""
        row = self.size.max(axis=1, keepdims=True)
        largest: np.ndarray = (self.size / np.where(row > 0, row, 1.0)).max(axis=0)
        return largest

    def _products(self, scales: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return scales[0][:, None] * scales[1]


class SparseEquilibration(Equilibration):
    """The same of the entries of a sparse matrix alone: (nnz,) arrays stand in the place of (rows, columns)."""

    def __init__(self, rows: int, columns: int, row: np.ndarray, column: np.ndarray) -> None:
        super().__init__(rows, columns)
        self.size, self.bound = np.zeros((2, len(row)))
        self.factor, self._row, self._column = self.size, row, column
        self._shape = rows, columns

    def _equilibrated(self) -> tuple[np.ndarray, np.ndarray]:
        size, row, column, (rows, columns) = self.size, self._row, self._column, self._shape
        kept = np.isfinite(size) & (size > NO_ENTRY * largest_of(size, row, rows)[row])
        squares = np.where(kept, size, 0.0) ** 2
        return normalized(
            lambda factors: np.bincount(row, squares * factors[column], rows),
            lambda factors: np.bincount(column, squares * factors[row], columns),
            columns,
            self._columns,
        )

    def _shares(self) -> np.ndarray:
        largest = largest_of(self.size, self._row, self._shape[0])
        share = self.size / np.where(largest > 0, largest, 1.0)[self._row]
        return largest_of(share, self._column, self._shape[1])

    def _products(self, scales: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return scales[0][self._row] * scales[1][self._column]


def largest_of(size: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(count,) the largest of some sizes (n,) in each of their groups; zero where there are none."""
    largest = np.zeros(count)
    np.maximum.at(largest, group, size)
    return largest
