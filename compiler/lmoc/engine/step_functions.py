"""Functions along the last step of a method, as C looks at them (``c/step_functions.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from lmoc.engine.instant import Instant
from lmoc.engine.kernel import Call
from lmoc.engine.library import library


class _Watched(ctypes.Structure):
    """``lmoc_watched``."""

    _fields_ = [
        ("call", ctypes.c_void_p),
        ("chosen", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("registers", "read", "laws", "events")],
        ("count", ctypes.c_int64),
    ]


class _StepFunctions(ctypes.Structure):
    """``lmoc_step_functions``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("n", "parts", "count")],
        *[(name, ctypes.c_void_p) for name in ("part", "largest", "x", "first", "last")],
        *[(name, ctypes.c_double) for name in ("begin", "end", "before")],
        ("order", ctypes.c_int64),
        ("series", ctypes.c_void_p),
    ]


class Watched:
    """Root functions from registers of a program.

    Parameters
    ----------
    call, registers : of the program
    laws : address of the laws whose functions they are; None for those of events
    events : whose functions they are; None for laws
    """

    def __init__(
        self, call: Call, registers: np.ndarray, laws: int | None = None, events: Instant | None = None
    ) -> None:
        self.given, self.events, self.of, chosen = call.given, events, (laws, events), len(registers)
        own, read = np.ascontiguousarray(registers, np.int32), np.empty(chosen)
        instant = None if events is None else ctypes.addressof(events.data)
        place = ctypes.addressof(call)
        self.data = _Watched(place, chosen, own.ctypes.data, read.ctypes.data, laws, instant)
        self._kept = call, own, read

    @property
    def count(self) -> int:
        """How many functions they are."""
        return int(self.data.count)

    @count.setter
    def count(self, count: int) -> None:
        self.data.count = count


class StepFunctions:
    """All that is watched in a segment, along the steps of a method whose values between are polynomials.

    Parameters
    ----------
    largest : (n,) magnitudes of the states where the functions have been looked at; kept up to date
    """

    def __init__(self, watched: Sequence[Watched], largest: np.ndarray) -> None:
        n, parts = len(largest), (_Watched * len(watched))(*(one.data for one in watched))
        x, self.largest = np.zeros(max(n, *(one.given for one in watched))), largest
        self.data = _StepFunctions(
            n, len(watched), sum(one.count for one in watched), ctypes.addressof(parts), largest.ctypes.data,
            x.ctypes.data,
        )  # fmt: skip
        self._kept, self._watched = (parts, x), watched
        self._states = library().lmoc_step_states

    def begin(
        self, first: tuple[float, np.ndarray], last: tuple[float, np.ndarray], series: tuple[float, int, int]
    ) -> None:
        """Look at a step.

        Parameters
        ----------
        first, last : time and states at the end of the step before, and of this one
        series : where it begins, its order and the address of its coefficients
        """
        own = self.data
        (own.begin, x), (own.end, y) = first, last
        own.first, own.last = x.ctypes.data, y.ctypes.data
        own.before, own.order, own.series = series
        self._places = x, y

    def states(self, t: float) -> np.ndarray:
        """Return the states at a time within the step."""
        x = np.empty(len(self.largest))
        self._states(ctypes.addressof(self.data), t, x.ctypes.data)
        return x

    def judged(self, status: int) -> int:
        """Return the status that C has come back with; what has been raised in Python is raised."""
        for one in self._watched:
            if one.events is not None:
                one.events.judged(status)
        return status
