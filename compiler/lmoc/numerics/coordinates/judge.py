"""Steps judged in C by their certificate, many of them without Python in between (``engine/c/judge.c``)."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from lmoc.engine.kernel import Hold
from lmoc.engine.library import address
from lmoc.numerics.coordinates.bounds import Bounds
from lmoc.numerics.coordinates.place import Place
from lmoc.numerics.coordinates.tableau import SHARE
from lmoc.numerics.problem.system import InC

Step = tuple[float, np.ndarray, np.ndarray]  # its end: time, states, solutions of blocks


class _Judge(ctypes.Structure):
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


class Judged(NamedTuple):
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


class Judge:
    """Judges the steps of one system, and keeps a record of those that are certainly good."""

    def __init__(self, certificate: Bounds, system: InC, n: int, *registers: np.ndarray) -> None:
        """
        Parameters
        ----------
        n : states
        registers : that the certificate reads, of the coordinates, of the unknowns of blocks
        """
        reads, told, solved = tables = [np.ascontiguousarray(r, np.int32) for r in registers]
        self._kept: list[object] = [certificate, tables]
        self.system, self._n, self._width = system, n, 1 + n + len(solved)
        self._judge = _Judge(
            system.call, system.evaluate, system.mark, system.registers, *certificate.addresses,
            reads.ctypes.data, told.ctypes.data, solved.ctypes.data, len(reads), len(solved), n, share=SHARE,
        )  # fmt: skip
        own = ctypes.addressof(self._judge)
        self._hold = Hold(own, address("lmoc_judge_look"), None, address("lmoc_judge_keep"), 1)
        self.address = ctypes.addressof(self._hold)

    def enter(self, place: Place, by: Judged, most: int) -> None:
        """Begin a record of up to `most` steps from a place."""
        judge, self._places = self._judge, np.empty((most, self._width))
        judge.sign, judge.least, judge.limit, judge.sure = place.found.sign, place.least, by.limit, by.sure
        judge.places, judge.count, judge.room, judge.rescaled = self._places.ctypes.data, 0, most, 0
        self._factors = by.rows.copy(), by.columns.copy(), 1.0 - by.barred
        judge.rows, judge.columns, judge.counted = (f.ctypes.data for f in self._factors)

    def scales(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the factors of rows and columns; None where they are the same as before."""
        return self._factors[:2] if self._judge.rescaled else None

    @property
    def least(self) -> float:
        """A lower bound of the smallest singular value at the last of the places."""
        return self._judge.least

    def places(self) -> list[Step]:
        """Return the steps on record."""
        own = self._places[: self._judge.count]
        return list(zip(own[:, 0].tolist(), own[:, 1 : 1 + self._n], own[:, 1 + self._n :], strict=True))
