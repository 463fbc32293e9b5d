"""The sizes in which the entries of the constraint matrix are compared: the largest that each has had in the run.

An entry that vanishes at a place is small only beside those sizes: scaling rows and columns by what they are at that
place alone would not show it.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.coordinates.limits import LIMITS, limits_in_c


def equilibrated(
    shape: tuple[int, int],
    place: np.ndarray,
    size: np.ndarray,
    units: np.ndarray,
    before: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return factors of rows and columns with which entries of these sizes have one length, and the columns' shares.

    They make what is measured in the scaled matrix independent of the units of equations and coordinates.

    Parameters
    ----------
    shape : numbers of rows and columns
    place, size : (n,) where the entries stand in the matrix by rows (int32), and their magnitudes
    units : (columns,) of the coordinates
    before : factors of the columns of a matrix that was similar

    Returns
    -------
    (rows,), (columns,) and (columns,) arrays
        The last: the largest share of each column in a row, by its unit.
    """
    rows, columns = shape
    row, share, work = np.empty(rows), np.empty(columns), np.empty(3 * (rows + columns) + len(size))
    column, size = np.ones(columns) if before is None else before.copy(), np.ascontiguousarray(size, float)
    out = [a.ctypes.data for a in (row, column, share, work)]
    again = int(before is not None)
    library().lmoc_equilibrate(
        limits_in_c(), rows, columns, len(size), *[a.ctypes.data for a in (place, size, units)], again, *out
    )
    return row, column, share


class Equilibration:
    """Sizes of the entries of a sparse matrix, and the factors that give rows and columns of these sizes one length.

    Attributes
    ----------
    size : (n,) largest magnitude of each entry so far
    bound : (n,) sizes up to which the factors serve
    scales : factors of the rows and of the columns; None where they are to be computed anew
    factor : (n,) of each entry, from the last scales
    ranges : (columns,) largest share of each coordinate in an equation, for the tableau
    """

    def __init__(self, shape: tuple[int, int], row: np.ndarray, column: np.ndarray, units: np.ndarray) -> None:
        self.size, self.bound = np.zeros((2, len(row)))
        self._served = self.size
        self.scales: tuple[np.ndarray, np.ndarray] | None = None
        self.factor, self.ranges = self.size, np.ones(shape[1])
        self._shape, self._row, self._column, self._units = shape, row, column, units
        self._place = np.ascontiguousarray(row.astype(np.int64) * shape[1] + column, np.int32)
        self._columns: np.ndarray | None = None  # the last factors of the columns

    def grow(self, size: np.ndarray) -> None:
        """Take note of the sizes of entries; factors that no longer serve are dropped."""
        if not (size <= self.size).all():
            with np.errstate(invalid="ignore"):
                self.size = np.fmax(self.size, size)
            if self.scales is not None and not (size <= self.bound).all():
                self.scales = None

    def replace(self, size: np.ndarray) -> None:
        """Take other sizes, for which the factors are computed anew."""
        self.size, self.scales = size, None

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the factors of the rows and of the columns."""
        if self.scales is None:
            row, column, self.ranges = equilibrated(
                self._shape, self._place, self.size, self._units, self._columns
            )
            self.scales, self._columns, self._served = (row, column), column, self.size
            rounding = LIMITS.no_entry * largest_of(self.size, self._row, self._shape[0])[self._row]
            self.bound = LIMITS.grown * np.fmax(self.size, rounding)  # what rounding leaves is no entry
            self.factor = row[self._row] * column[self._column]
        return self.scales

    def served(self) -> np.ndarray:
        """Return the sizes that the factors were made for."""
        return self._served

    def scaled(self, matrix: np.ndarray) -> np.ndarray:
        """Return entries in which rows and columns of the sizes so far have one length."""
        self.factors()
        return matrix * self.factor


def largest_of(size: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(count,) the largest of some sizes (n,) in each of their groups; zero where there are none."""
    largest = np.zeros(count)
    np.maximum.at(largest, group, size)
    return largest
