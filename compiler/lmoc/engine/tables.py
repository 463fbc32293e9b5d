"""Tables that inputs follow, as the engine reads them (``c/tables.c``)."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable

import numpy as np


class _Table(ctypes.Structure):
    """``lmoc_table`` in ``c/tables.h``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("place", "order", "knot_count", "degrees")],
        *[(name, ctypes.c_void_p) for name in ("knots", "coefficients", "low", "high", "ends")],
        ("at", ctypes.c_int64),
    ]


class _Tables(ctypes.Structure):
    """``lmoc_tables``."""

    _fields_ = [("count", ctypes.c_int64), ("table", ctypes.POINTER(_Table))]


class Tables:
    """Curves with the registers that they fill.

    Attributes
    ----------
    address : of the ``lmoc_tables``; valid as long as this lives
    """

    def __init__(self, given: Iterable[tuple[int, int, tuple[np.ndarray, ...]]]) -> None:
        """
        Parameters
        ----------
        given : register, order of the derivative, and its knots (n,), coefficients (n-1, degree+1), lower and upper
            bounds (n-1,) and ends (2,)
        """
        made: list[_Table] = []
        self._kept: list[np.ndarray] = []  # what C points to
        for register, order, numbers in given:
            arrays = [np.ascontiguousarray(a, float) for a in numbers]
            self._kept += arrays
            sizes = register, order, len(arrays[0]), arrays[1].shape[1]
            made.append(_Table(*sizes, *(a.ctypes.data for a in arrays), 0))
        self._tables = (_Table * max(1, len(made)))(*made)
        self._own = _Tables(len(made), self._tables)
        self.address = ctypes.addressof(self._own)
