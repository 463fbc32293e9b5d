"""Sign changes within steps, as C functions find them (``c/roots.h``): their memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import address, library
from lmoc.engine.step_functions import StepFunctions

_ROOT, _NO_MEMORY = 1, 3
_VALUES = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)
_QUIET = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)


class _Finder(ctypes.Structure):
    """``lmoc_finder``."""

    _fields_ = [
        ("count", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("signs", "which", "owner", "values", "quiet")],
        *[(name, ctypes.c_double) for name in ("before", "end", "begin", "length", "shortest")],
        ("inside", ctypes.c_int64),
        ("memory", ctypes.c_void_p),
        ("room", ctypes.c_int64),
    ]


class Finder:
    """Follows the signs of functions from step to step.

    Parameters
    ----------
    signs : (m,) that they have had last, 0 where none is known; kept up to date
    owner, values, quiet : addresses of C functions, and of what they are called with
    judged : takes the status that C has come back with, and raises what has been raised in Python

    Attributes
    ----------
    which : (m,) bool, those that vanish at the root found last
    """

    def __init__(
        self, signs: np.ndarray, owner: int | None, values: int, quiet: int, judged: Callable[[int], int]
    ) -> None:
        self._library, self._judged = library(), judged
        self._kept: object = None  # what C asks
        self.signs, self.which = signs, np.zeros(len(signs), bool)
        self._data = _Finder(len(signs), signs.ctypes.data, self.which.ctypes.data, owner, values, quiet)
        self._reference, self._time = ctypes.byref(self._data), ctypes.c_double()
        self._out = ctypes.byref(self._time)

    @classmethod
    def along(cls, signs: np.ndarray, functions: StepFunctions) -> Finder:
        """Follow functions that C knows."""
        own = ctypes.addressof(functions.data), address("lmoc_step_values"), address("lmoc_step_quiet")
        finder = cls(signs, *own, functions.judged)
        finder._kept = functions
        return finder

    @classmethod
    def asking(
        cls,
        signs: np.ndarray,
        values: Callable[[np.ndarray], np.ndarray],
        quiet: Callable[[float, np.ndarray], np.ndarray],
    ) -> Finder:
        """Follow functions of Python.

        Parameters
        ----------
        values : (times (k,)) -> (k, m)
        quiet : (time, heights (m,)) -> (m,) bool
            Which functions that have been no higher than so much are zero but for rounding: they have no roots.
        """
        asked, count = Answers(_NO_MEMORY), len(signs)

        def values_at(_: int, many: int, times: int, found: int) -> int:
            def work() -> None:
                doubles(found, many * count)[:] = values(doubles(times, many)).ravel()

            return asked.answer(work)

        def quiet_at(_: int, time: float, heights: int, found: int) -> int:
            def work() -> None:
                answer = quiet(time, doubles(heights, count))
                np.ctypeslib.as_array((ctypes.c_uint8 * count).from_address(found))[:] = answer

            return asked.answer(work)

        hooks = _VALUES(values_at), _QUIET(quiet_at)
        places = [ctypes.cast(h, ctypes.c_void_p).value or 0 for h in hooks]
        finder = cls(signs, None, places[0], places[1], asked.judge)
        finder._kept = hooks
        return finder

    def __del__(self) -> None:
        self._library.lmoc_roots_free(self._reference)

    def begin(self, before: float, end: float) -> None:
        """Begin with a step."""
        self._library.lmoc_roots_of_step(self._reference, before, end)

    def next(self) -> float | None:
        """Return the time of the next root of the step, None where there is none."""
        found = self._judged(self._library.lmoc_next_root(self._reference, self._out))
        if found == _NO_MEMORY:
            raise MemoryError
        return self._time.value if found == _ROOT else None


def locate(curve: Callable[[np.ndarray], np.ndarray], a: float, b: float, at_a: float, at_b: float) -> float:
    """Return the end at which a function is below zero of the smallest bracket of its crossing.

    Parameters
    ----------
    curve : times (k,) -> (k,), with ``curve(a) = at_a ≥ 0 > at_b = curve(b)``
    """
    asked, hook = _curve(curve)
    time = ctypes.c_double()
    asked.judge(library().lmoc_locate(hook, None, a, b, at_a, at_b, 0, None, None, ctypes.byref(time)))
    return time.value


def lowest(curve: Callable[[float], float], times: np.ndarray) -> tuple[float, float]:
    """Return a place and value of a minimum next to that of some times at which it is lowest (golden sections)."""
    asked, hook = _curve(lambda some: np.array([curve(t) for t in some.tolist()]))
    own, time, value = np.ascontiguousarray(times, float), ctypes.c_double(), ctypes.c_double()
    out = ctypes.byref(time), ctypes.byref(value)
    asked.judge(library().lmoc_lowest_about(hook, None, len(own), own.ctypes.data, *out))
    return time.value, value.value


def _curve(curve: Callable[[np.ndarray], np.ndarray]) -> tuple[Answers, Callable[..., int]]:
    """Return a function of time as C asks it."""
    asked = Answers(_NO_MEMORY)

    def ask(_: int, many: int, times: int, found: int) -> int:
        def work() -> None:
            doubles(found, many)[:] = curve(doubles(times, many))

        return asked.answer(work)

    return asked, _VALUES(ask)
