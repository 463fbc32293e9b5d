"""Zero functions that leave zero at once behind a jump of states, as C functions judge them (``c/hops.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.instant import Instant

TOO_LOW = 16
_CHATTER = 12  # (``LMOC_CHATTER``)
_MOTION = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p
)


class _Hops(ctypes.Structure):
    """``lmoc_hops``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("times", "home", "work")],
        *[(name, ctypes.c_double) for name in ("begin", "span", "step", "soon")],
        ("motion", ctypes.c_void_p),
    ]


class Hops:
    """When each zero function has last crossed zero, and when those that have left it at once are back.

    Attributes
    ----------
    times : (zeros, k) s, when each has crossed zero, the last time last; -infinity before
    """

    def __init__(self, zeros: int, begin: float, end: float) -> None:
        self.times, self._home = np.full((zeros, _CHATTER), -np.inf), np.full(zeros, -np.inf)
        self._data = _Hops(self.times.ctypes.data, self._home.ctypes.data, None, begin, end - begin, 0.0, np.inf)
        self._reference = ctypes.byref(self._data)
        self._kept: list[object] = []

    def memory(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Return what it knows, for `recall`."""
        return self.times.copy(), self._home.copy(), self.soon

    def recall(self, memory: tuple[np.ndarray, np.ndarray, float]) -> None:
        """Know what it has known."""
        self.times[:], self._home[:], self._data.soon = memory

    @property
    def soon(self) -> float:
        """s, after which the first function that has left zero is back; infinity where none is on its way."""
        return float(self._data.soon)

    def cross(self, instant: Instant, t: float, which: np.ndarray) -> int:
        """Take note of what crosses zero; return a function that does so too often within a moment, else -1."""
        return int(instant.call("lmoc_cross", self._reference, t, which))

    def look(
        self, instant: Instant, step: float, motion: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
    ) -> None:
        """Look along the motion from here on.

        Parameters
        ----------
        step : s, the last step of the method, over which the motion is smooth
        motion : (t, x) -> rates of the states, zero functions
        """
        work = np.empty(4 * instant.data.states + 9 * len(self._home))
        hook = _MOTION(instant.answering(motion, (instant.data.states, len(self._home))))
        self._kept = [work, hook]
        self._data.step, self._data.work = step, work.ctypes.data
        self._data.motion = ctypes.cast(hook, ctypes.c_void_p).value

    def turned_back(
        self, instant: Instant, t: float, states: tuple[np.ndarray, np.ndarray], which: np.ndarray, at: np.ndarray
    ) -> tuple[np.ndarray, bool]:
        """Return which functions leave zero at once, to the side they came from, or whose hops are too low for that.

        Parameters
        ----------
        states : before and behind a jump
        which : (zeros,) that have just crossed zero
        at : (zeros,) the functions before the jump

        Returns
        -------
        (k,) functions; whether their hops are too low to be told from none
        """
        found = np.zeros(len(self._home))
        status = instant.call("lmoc_turned_back", self._reference, t, *states, which, at, found)
        return found.nonzero()[0], status == TOO_LOW

    def wrong_way(self, instant: Instant, t: float, x: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return the functions (k,) that seem to be back too early, and move away from zero."""
        found = np.zeros(len(self._home))
        instant.call("lmoc_wrong_way", self._reference, t, x, which, found)
        return found.nonzero()[0]
