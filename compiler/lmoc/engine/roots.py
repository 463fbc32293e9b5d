"""Sign changes within steps, as C functions find them (``c/roots.h``): their memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import library

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
    values : (times (k,)) -> (k, m)
    quiet : (time, heights (m,)) -> (m,) bool
        Which functions that have been no higher than so much are zero but for rounding: they have no roots.

    Attributes
    ----------
    which : (m,) bool, those that vanish at the root found last
    """

    def __init__(
        self,
        signs: np.ndarray,
        values: Callable[[np.ndarray], np.ndarray],
        quiet: Callable[[float, np.ndarray], np.ndarray],
    ) -> None:
        self._library, self._asked, count = library(), Answers(_NO_MEMORY), len(signs)
        self.signs, self.which = signs, np.zeros(count, bool)
        asked = self._asked

        def values_at(_: int, many: int, times: int, found: int) -> int:
            def work() -> None:
                doubles(found, many * count)[:] = values(doubles(times, many)).ravel()

            return asked.answer(work)

        def quiet_at(_: int, time: float, heights: int, found: int) -> int:
            def work() -> None:
                answer = quiet(time, doubles(heights, count))
                np.ctypeslib.as_array((ctypes.c_uint8 * count).from_address(found))[:] = answer

            return asked.answer(work)

        self._hooks = _VALUES(values_at), _QUIET(quiet_at)
        hooks = [ctypes.cast(h, ctypes.c_void_p).value for h in self._hooks]
        self._data = _Finder(count, signs.ctypes.data, self.which.ctypes.data, None, *hooks)
        self._reference, self._time = ctypes.byref(self._data), ctypes.c_double()
        self._out = ctypes.byref(self._time)

    def __del__(self) -> None:
        self._library.lmoc_roots_free(self._reference)

    def begin(self, before: float, end: float) -> None:
        """Begin with a step."""
        self._library.lmoc_roots_of_step(self._reference, before, end)

    def next(self) -> float | None:
        """Return the time of the next root of the step, None where there is none."""
        found = self._asked.judge(self._library.lmoc_next_root(self._reference, self._out))
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
