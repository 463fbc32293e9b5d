"""What steps at an instant does to the states, as C functions find it (``c/jump.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import library

JUMPED, _, _, _, ENDLESS, _NO_MEMORY = range(6)
REASONS = _NO_MEMORY + 1  # how many statuses there are
_VALUES = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 5)


class _Jump(ctypes.Structure):
    """``lmoc_jump``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("states", "given", "rows", "judged")],
        *[(name, ctypes.c_void_p) for name in ("lower", "upper", "origin", "second", "ledger", "owner", "values")],
    ]


class JumpOfStates:
    """The effect of a step.

    Parameters
    ----------
    tables : lower, upper, origin, second (rows,) of ``lmoc_jump``, and ledger (states,)
    given : how many values can be given
    judged : how many results there are behind the rates
    values : (x, which (given,), given (given,)) -> (states + judged,)
    """

    def __init__(
        self,
        tables: tuple[np.ndarray, ...],
        given: int,
        judged: int,
        values: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    ) -> None:
        self._tables = [np.ascontiguousarray(t, np.int32) for t in tables]
        states, self._asked = len(tables[-1]), Answers(_NO_MEMORY)
        asked = self._asked

        def values_at(_: int, x: int, which: int, own: int, out: int) -> int:
            def work() -> None:
                chosen = np.ctypeslib.as_array((ctypes.c_int32 * given).from_address(which))
                doubles(out, states + judged)[:] = values(doubles(x, states), chosen, doubles(own, given))

            return asked.answer(work)

        self._hook = _VALUES(values_at)
        addresses = [t.ctypes.data for t in self._tables]
        hook = ctypes.cast(self._hook, ctypes.c_void_p).value
        self._data = _Jump(states, given, len(tables[0]), judged, *addresses, None, hook)

    def states(self, old: np.ndarray, change: np.ndarray, x: np.ndarray) -> tuple[int, np.ndarray]:
        """Return what the states change by, and the status; `old`, `change` (given,)."""
        moved = np.zeros(len(x))
        addresses = [a.ctypes.data for a in (old, change, x, moved)]
        return self._asked.judge(library().lmoc_jump_states(ctypes.byref(self._data), *addresses)), moved

    def work(self, old: np.ndarray, change: np.ndarray, x: np.ndarray) -> int:
        """Return ENDLESS where the ledger grows with a power of the impulses."""
        addresses = [a.ctypes.data for a in (old, change, x)]
        return self._asked.judge(library().lmoc_jump_work(ctypes.byref(self._data), *addresses))


def reason(status: int) -> str:
    """Return why a step has come to a status, in the words of a message."""
    text: bytes = library().lmoc_jump_reason(status)
    return text.decode()


def steps_between(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the values on both sides of an instant, (2, k), and what they step by.

    Parameters
    ----------
    values : (4, k) just before it, before that, just after it, after that
    """
    values = np.ascontiguousarray(values)
    sides, change = np.empty((2, values.shape[1])), np.empty(values.shape[1])
    library().lmoc_steps_between(len(change), values.ctypes.data, sides.ctypes.data, change.ctypes.data)
    return sides, change
