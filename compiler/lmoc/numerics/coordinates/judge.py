"""Steps judged in C by their certificate, many of them without Python in between (`native/c/judge.c`)."""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.numerics.coordinates.compiled_certificate import CompiledCertificate
from lmoc.numerics.coordinates.place import Place
from lmoc.numerics.coordinates.tableau import SHARE
from lmoc.numerics.evaluate.native.kernel import Hold
from lmoc.numerics.evaluate.system import InC


class _Judge(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("call", "evaluate", "mark", "registers", "w", "m", "tab")],
        *[(name, ctypes.c_void_p) for name in ("given", "found", "reads", "told", "solved")],
        *[(name, ctypes.c_int64) for name in ("read_count", "solved_count", "n")],
        *[(name, ctypes.c_double) for name in ("limit", "sure", "share", "sign", "least")],
        ("places", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("count", "room")],
    ]


class Judge:
    """Judges the steps of one system, and keeps a record of those that are certainly good."""

    def __init__(
        self, certificate: CompiledCertificate, system: InC, n: int, sure: float, *registers: np.ndarray
    ) -> None:
        """
        Parameters
        ----------
        n : states
        sure : lower bound of the smallest singular value with which a step is certainly good
        registers : that the certificate reads, of the coordinates, of the unknowns of blocks
        """
        reads, told, solved = tables = [np.ascontiguousarray(r, np.int32) for r in registers]
        self._kept: list[object] = [certificate, tables]
        self.system, self._n, self._width = system, n, 1 + n + len(solved)
        self._judge = _Judge(
            system.call, system.evaluate, system.mark, system.registers, *certificate.addresses,
            reads.ctypes.data, told.ctypes.data, solved.ctypes.data, len(reads), len(solved), n, sure=sure, share=SHARE,
        )  # fmt: skip
        own = ctypes.addressof(self._judge)
        self._hold = Hold(own, certificate.address("lmoc_judge_look"), None, certificate.address("lmoc_judge_keep"), 1)
        self.address = ctypes.addressof(self._hold)

    def enter(self, place: Place, limit: float, most: int) -> None:
        """Begin a record of up to `most` steps from a place.

        Parameters
        ----------
        limit : of the largest entry of the tableau
        """
        judge, self._places = self._judge, np.empty((most, self._width))
        judge.sign, judge.least, judge.limit = place.found.sign, place.least, limit
        judge.places, judge.count, judge.room = self._places.ctypes.data, 0, most

    @property
    def least(self) -> float:
        """A lower bound of the smallest singular value at the last of the places."""
        return self._judge.least

    def places(self) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Return the ends of the steps on record: times, states, solutions of blocks."""
        own = self._places[: self._judge.count]
        return list(zip(own[:, 0].tolist(), own[:, 1 : 1 + self._n], own[:, 1 + self._n :], strict=True))
