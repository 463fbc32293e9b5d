"""Steps checked in C by bounds, many of them without Python in between (``engine/c/step_check.c``)."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from lmoc.engine.kernel import StepHook
from lmoc.engine.library import address
from lmoc.numerics.coordinates.bounds_kernel import BoundsKernel
from lmoc.numerics.coordinates.constraint_state import ConstraintState
from lmoc.numerics.coordinates.tableau import SHARE
from lmoc.numerics.problem.system import InC

Step = tuple[float, np.ndarray, np.ndarray]  # its end: time, states, solutions of blocks


class _StepCheck(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("call", "evaluate", "mark", "registers", "by")],
        *[(name, ctypes.c_void_p) for name in ("given", "found", "reads", "told", "solved")],
        *[(name, ctypes.c_int64) for name in ("read_count", "solved_count", "n")],
        *[(name, ctypes.c_double) for name in ("limit", "sure", "share", "sign", "least")],
        *[(name, ctypes.c_void_p) for name in ("rows", "columns", "counted")],
        ("rescaled", ctypes.c_int64),
        ("places", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("count", "room")],
    ]


class CheckLimits(NamedTuple):
    """The bounds and sizes by which steps are judged.

    Attributes
    ----------
    limit : of the largest entry of the tableau
    sure : of the smallest singular value
    rows, columns : factors with which rows and columns of the constraints have one length
    barred : (watched,) mask of rows of the tableau that do not count
    """

    limit: float
    sure: float
    rows: np.ndarray
    columns: np.ndarray
    barred: np.ndarray


class StepCheck:
    """Judges the steps of one system, and keeps a record of those that are certainly good."""

    def __init__(self, bounds: BoundsKernel, system: InC, n: int, *registers: np.ndarray) -> None:
        """
        Parameters
        ----------
        n : states
        registers : that the bounds read, of the coordinates, of the unknowns of blocks
        """
        reads, told, solved = tables = [np.ascontiguousarray(r, np.int32) for r in registers]
        self._kept: list[object] = [bounds, tables]
        self.system, self._n, self._width = system, n, 1 + n + len(solved)
        self._check = _StepCheck(
            system.call, system.evaluate, system.mark, system.registers, *bounds.addresses,
            reads.ctypes.data, told.ctypes.data, solved.ctypes.data, len(reads), len(solved), n, share=SHARE,
        )  # fmt: skip
        own = ctypes.addressof(self._check)
        self._hook = StepHook(own, address("lmoc_step_check_look"), None, address("lmoc_step_check_keep"), 1)
        self.address = ctypes.addressof(self._hook)

    def enter(self, place: ConstraintState, by: CheckLimits, most: int) -> None:
        """Begin a record of up to `most` steps from a place."""
        check, self._places = self._check, np.empty((most, self._width))
        check.sign, check.least, check.limit, check.sure = place.found.sign, place.least, by.limit, by.sure
        check.places, check.count, check.room, check.rescaled = self._places.ctypes.data, 0, most, 0
        self._factors = by.rows.copy(), by.columns.copy(), 1.0 - by.barred
        check.rows, check.columns, check.counted = (f.ctypes.data for f in self._factors)

    def scales(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the factors of rows and columns; None where they are the same as before."""
        return self._factors[:2] if self._check.rescaled else None

    @property
    def least(self) -> float:
        """A lower bound of the smallest singular value at the last of the places."""
        return self._check.least

    def places(self) -> list[Step]:
        """Return the steps on record."""
        own = self._places[: self._check.count]
        return list(zip(own[:, 0].tolist(), own[:, 1 : 1 + self._n], own[:, 1 + self._n :], strict=True))
