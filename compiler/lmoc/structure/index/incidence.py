"""Incidence of unknowns in equations, with orders of differentiation: the input of every graph algorithm here."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass


def ranges(start: np.ndarray, items: np.ndarray) -> np.ndarray:
    """Positions ``start[i] … start[i+1]-1`` of all `items` of a compressed table, one after the other."""
    begin = start[items]
    length = start[items + 1] - begin
    total = int(length.sum())
    if total == 0:
        return np.zeros(0, np.int64)
    shift = np.repeat(begin - np.concatenate([[0], np.cumsum(length)[:-1]]), length)
    return shift + np.arange(total)


def pointers(sorted_keys: np.ndarray, count: int) -> np.ndarray:
    """Return where each key ``0 … count-1`` begins in a sorted array: the ``start`` of a compressed table."""
    return np.concatenate([[0], np.cumsum(np.bincount(sorted_keys, minlength=count))])


@dataclass(frozen=True, eq=False)
class Incidence:
    """A sparse matrix of derivative orders, its entries sorted by (row, column), no pair twice.

    Attributes
    ----------
    rows, columns : int
        Equations and unknowns.
    row, column, order : (nnz,) int
        The highest derivative order of each unknown in each equation: Pryce's signature matrix.
    """

    rows: int
    columns: int
    row: np.ndarray
    column: np.ndarray
    order: np.ndarray

    @staticmethod
    def of(rows: int, columns: int, row: np.ndarray, column: np.ndarray, order: np.ndarray) -> Incidence:
        """Sorted, with the highest order where a pair is given several times."""
        # a row, a column and an order packed into one number are sorted several times faster than by argsort
        low = int(np.max(order, initial=0)).bit_length()
        middle = low + columns.bit_length()
        if middle + rows.bit_length() > 63:
            raise OverflowError(f"{rows} equations with {columns} unknowns are too many")
        key = np.asarray(row).astype(np.int64)
        key <<= middle - low
        key |= column
        if low:
            key <<= low
            key |= order
        key.sort()
        last = np.ones(len(key), bool)
        last[:-1] = (key[1:] >> low) != (key[:-1] >> low)
        if not last.all():
            key = key[last]
        orders = (key & ((1 << low) - 1)).astype(INDEX)
        column = ((key >> low) & ((1 << (middle - low)) - 1)).astype(INDEX)
        return Incidence(rows, columns, (key >> middle).astype(INDEX), column, orders)

    @cached_property
    def start(self) -> np.ndarray:
        """(rows+1,) where each row's entries begin."""
        return pointers(self.row, self.rows)

    @cached_property
    def by_column(self) -> np.ndarray:
        """(nnz,) the entries in an order sorted by (column, row)."""
        return np.argsort(self.column, kind="stable")

    @cached_property
    def column_start(self) -> np.ndarray:
        """(columns+1,) where each column begins in `by_column`."""
        return pointers(self.column, self.columns)

    def of_rows(self, rows: np.ndarray) -> np.ndarray:
        """The entries in these rows."""
        return ranges(self.start, rows)

    def of_columns(self, columns: np.ndarray) -> np.ndarray:
        """The entries in these columns."""
        result: np.ndarray = self.by_column[ranges(self.column_start, columns)]
        return result

    def restricted(self, entries: np.ndarray) -> Incidence:
        """The same rows and columns with these entries (a mask or sorted positions) only."""
        return Incidence(self.rows, self.columns, self.row[entries], self.column[entries], self.order[entries])

    def submatrix(self, rows: np.ndarray, columns: np.ndarray) -> Incidence:
        """Chosen rows and columns (sorted numbers), renumbered."""
        new_row, new_column = np.full(self.rows, -1, INDEX), np.full(self.columns, -1, INDEX)
        new_row[rows], new_column[columns] = np.arange(len(rows)), np.arange(len(columns))
        r, c = new_row[self.row], new_column[self.column]
        kept = (r >= 0) & (c >= 0)
        return Incidence(len(rows), len(columns), r[kept], c[kept], self.order[kept])
