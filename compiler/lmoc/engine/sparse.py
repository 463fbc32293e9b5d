"""A sparse matrix of a fixed pattern, solved by the engine (``c/lu.h``)."""

from __future__ import annotations

import ctypes
import weakref

import numpy as np

from lmoc.engine.library import library

_GOOD = 1


class SparseMatrix:
    """A square matrix whose entries change and whose pattern does not."""

    def __init__(self, size: int, row: np.ndarray, column: np.ndarray) -> None:
        """
        Parameters
        ----------
        row, column : (nnz,) places of the entries, no place twice
        """
        self._order = np.lexsort((row, column))
        self._start = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=size))]).astype(np.int32)
        self._rows = np.ascontiguousarray(row[self._order], np.int32)
        self._engine, self._determinant = library(), ctypes.c_double()
        self._handle = self._engine.lmoc_lu_new(size, self._start.ctypes.data, self._rows.ctypes.data)
        if not self._handle:
            raise MemoryError
        weakref.finalize(self, self._engine.lmoc_lu_free, self._handle)

    def solve(self, entries: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(size, k) the solutions for entries (nnz,) and right-hand sides (size, k); NaN where it is singular."""
        values = np.ascontiguousarray(entries[self._order])
        found = np.array(right.T, order="C")
        if self._engine.lmoc_lu_factor(self._handle, values.ctypes.data, ctypes.byref(self._determinant)) != _GOOD:
            return np.full(right.shape, np.nan)
        for column in found:
            self._engine.lmoc_lu_solve(self._handle, column.ctypes.data)
        return found.T
