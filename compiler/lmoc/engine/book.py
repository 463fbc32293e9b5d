"""What is written down of events, as C functions write it (``c/book.h``)."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import address

ENTRY = 7  # numbers of an entry beside conditions and changes
_LEAST = 8192  # numbers of a page
_PLACE, _COUNT = ctypes.c_void_p, ctypes.c_int64


class _Book(ctypes.Structure):
    """``lmoc_book``."""

    _fields_ = [
        ("v", _PLACE),
        *[(name, _COUNT) for name in ("stored", "work", "heat", "told", "deciding")],
        *[(name, _PLACE) for name in ("tell", "decides", "stops", "step")],
        ("turned", ctypes.c_double),
        ("page", _PLACE),
        *[(name, _COUNT) for name in ("size", "filled")],
    ]


class Accounts(NamedTuple):
    """What is looked at where an event has been carried out, all as of ``lmoc_book``.

    Attributes
    ----------
    stored, work, heat : the place of the stored energy among the values, and which states keep accounts; -1: none
    told, decides : discrete values that are told of where they have changed, and those that decide about the motion
    stops : (conditions,) whether a run does not go on where one is met
    """

    stored: int
    work: int
    heat: int
    told: NDArray[np.int64]
    decides: NDArray[np.int64]
    stops: NDArray[np.bool_]


class Entry(NamedTuple):
    """What is written down of an event.

    Attributes
    ----------
    time, lost : s, J
    kind : what it is called
    wrong : which discrete value is not finite, and how large it is; -1 where all are
    conditions : those of which something is told
    changes : which of those that are told of have changed, and values before and after
    """

    time: float
    kind: int
    lost: float
    wrong: tuple[int, float]
    conditions: list[int]
    changes: list[tuple[int, float, float]]


class Book:
    """The entries that nobody has read yet."""

    def __init__(self, events: int, accounts: Accounts, step: int | None, turned: float) -> None:
        """
        Parameters
        ----------
        events, step : addresses of the ``lmoc_events``, and of what a step of discrete values does to states, if any
        turned : s, of the latest event that has changed the motion
        """
        stored, work, heat, *tables = accounts
        told, decides = (np.ascontiguousarray(t, np.int64) for t in tables[:2])
        stops = np.ascontiguousarray(tables[2], np.uint8)
        size = max(_LEAST, 4 * (ENTRY + len(stops) + 3 * len(told)))
        self._page = np.zeros(size)
        addresses = (t.ctypes.data for t in (told, decides, stops))
        self.data = _Book(
            events, stored, work, heat, len(told), len(decides), *addresses, step, turned, self._page.ctypes.data, size
        )
        self._kept = told, decides, stops
        self.writes = address("lmoc_book_event")

    def taken(self) -> list[tuple[int, Entry]]:
        """Return the entries, each with how many numbers there are up to its end; from here on there are none."""
        numbers, at, found = self._page[: self.data.filled].tolist(), 0, []
        while at < len(numbers):
            length, time, kind, lost, which, value, count = numbers[at : at + ENTRY]
            end, changes = at + int(length), at + ENTRY + int(count)
            told = [(int(numbers[k]), numbers[k + 1], numbers[k + 2]) for k in range(changes, end, 3)]
            conditions = [int(k) for k in numbers[at + ENTRY : changes]]
            found.append((end, Entry(time, int(kind), lost, (int(which), value), conditions, told)))
            at = end
        self.data.filled = 0
        return found
