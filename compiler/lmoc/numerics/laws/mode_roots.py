"""The functions whose change of sign ends a mode of the laws (``engine/c/switching.c``)."""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, numbers
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Laws, Mask
from lmoc.numerics.problem.mode import Mode

_CONTACT = (
    "x", "gap", "rate", "gap_scale", "rate_scale", "bias", "slip", "stick", "delassus", "response", "slope",
)  # fmt: skip


class _Contact(ctypes.Structure):
    """``lmoc_contact``."""

    _fields_ = [("time", ctypes.c_double), *[(name, ctypes.c_void_p) for name in _CONTACT]]


class _Switching(ctypes.Structure):
    """``lmoc_switching``."""

    _fields_ = [
        ("laws", Laws),
        ("states", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("unilateral", "curved", "limits", "noise", "closed", "implied")],
        *[(name, ctypes.c_void_p) for name in ("direction", "touched", "idle")],
    ]


class ModeRoots:
    """The functions that are positive as long as a mode holds: one a law, two for stuck friction.

    Parameters
    ----------
    touched : (n,) laws whose motion was zero where the segment has begun
    idle : (n,) roots in sequence at which nothing has happened to a law

    Attributes
    ----------
    second : the laws whose forces have a lower limit as well
    """

    def __init__(self, kinematics: ContactKinematics, mode: Mode, touched: Mask, idle: Array) -> None:
        table, scene = kinematics.table, kinematics.scene
        self.second = np.flatnonzero(mode.closed & ~table.complementary)
        self._errors = np.zeros(len(kinematics.plan.states)) + kinematics.errors
        masks = [np.ascontiguousarray(v, bool) for v in (mode.closed, mode.implied, touched)]
        values = [numbers(v) for v in (kinematics.known[4], kinematics.noise, idle)]
        curved, direction = np.ascontiguousarray(scene.curved[0]), np.ascontiguousarray(mode.direction, np.int64)
        arrays = (
            table.unilateral, curved, values[0], values[1], masks[0], masks[1], direction, masks[2], values[2],
        )  # fmt: skip
        self._kept = arrays
        data = _Switching(table.in_c, len(self._errors), *(a.ctypes.data for a in arrays))
        self._data, self._reference = data, ctypes.byref(data)

    def values(self, read: Array, apart: Array | None = None) -> Array:
        """Return the functions, (k, m), from motions, rates, forces and sticking limits at some places, (k, 4 laws)."""
        read = numbers(read)
        found = np.empty((len(read), len(self._kept[0]) + len(self.second)))
        added = None if apart is None else apart.ctypes.data
        library().lmoc_law_roots(self._reference, len(read), read.ctypes.data, added, found.ctypes.data)
        return found

    def apart(self, now: Instant, values: Array) -> Array:
        """Return what keeps functions, (m,), from being noticed at once that begin at zero up to rounding."""
        arrays, values = [numbers(getattr(now, name)) for name in _CONTACT], numbers(values)
        contact, found = _Contact(now.t, *(a.ctypes.data for a in arrays)), np.empty(len(values))
        library().lmoc_law_apart(
            self._reference, ctypes.byref(contact), self._errors.ctypes.data, values.ctypes.data, found.ctypes.data
        )
        return found
