"""Functions of Python that C asks: what they raise is kept until C has come back."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

_HALTED = 2  # what C is told of something raised


class Answers:
    """Keeps what is raised while C is running, and raises it afterwards.

    Parameters
    ----------
    no_memory : the status by which C says so
    """

    def __init__(self, no_memory: int) -> None:
        self._no_memory = no_memory
        self._failed: BaseException | None = None

    def answer(self, work: Callable[[], None]) -> int:
        """Do what C has asked for; the status that it is told."""
        try:
            work()
        except BaseException as raised:
            self._failed = raised
            return _HALTED
        return 0

    def judge(self, status: int) -> int:
        """Return the status that C has come back with.

        Raises
        ------
        MemoryError
            C has found none. Also raises what has been raised in Python.
        """
        if self._failed is not None:
            raised, self._failed = self._failed, None
            raise raised
        if status == self._no_memory:
            raise MemoryError
        return status


def doubles(place: int, count: int) -> np.ndarray:
    """Return memory of C as an array, which the next call may overwrite."""
    return np.frombuffer(memoryview((ctypes.c_double * count).from_address(place))) if count else np.zeros(0)
