"""From event to event, as C functions go (``c/happen.h``): their memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.book import Accounts, Book
from lmoc.engine.instant import Instant
from lmoc.engine.library import address, library

WHEN, TIME, TERMINAL, START = range(4)  # what an event is called
TOO_LOW, TOO_OFTEN, OVER = 16, 17, -2  # what an instant comes to beside what `instant` says
_CHATTER = 12  # (``LMOC_CHATTER``)
_PLACE = ctypes.c_void_p
_MOTION = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, ctypes.c_double, _PLACE, _PLACE, _PLACE)
_STATES = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _PLACE)
_EQUATIONS = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, ctypes.c_int)

Motion = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]  # (t, x) -> rates, zero functions
Answer = Callable[[float, np.ndarray], bool]


class _Hops(ctypes.Structure):
    """``lmoc_hops``."""

    _fields_ = [
        *[(name, _PLACE) for name in ("times", "home", "work")],
        *[(name, ctypes.c_double) for name in ("begin", "span", "step", "soon")],
        ("motion", _PLACE),
    ]


class _Events(ctypes.Structure):
    """``lmoc_events``."""

    _fields_ = [
        *[(name, _PLACE) for name in ("e", "h")],
        *[(name, ctypes.c_int64) for name in ("initial", "terminal")],
        *[(name, _PLACE) for name in ("next", "turned", "errors", "defect")],
        *[(name, _PLACE) for name in ("begun", "held", "which", "turn", "at", "folds")],
        *[(name, ctypes.c_int64) for name in ("kind", "jumped", "culprit")],
        *[(name, _PLACE) for name in ("owner", "happened", "states", "equations", "fold", "defects")],
    ]


class EventWalk:
    """The events of a run on its way, and when each zero function has crossed zero.

    Attributes
    ----------
    times : (zeros, k) s, when each has crossed zero, the last time last; -infinity before
    data : the latest event: its ``kind``, whether it has ``jumped``, which function is the ``culprit``
    which, turn : (zeros,) functions that cross zero, 2: upwards; and that turn back, or are to blame
    folds : (zeros,) that cross it again where they have just done so
    book : what is written down of events
    """

    turn: np.ndarray
    folds: np.ndarray
    data: _Events
    book: Book

    def __init__(self, zeros: int, begin: float, end: float) -> None:
        self.times, self._home, self._next = np.full((zeros, _CHATTER), -np.inf), np.full(zeros, -np.inf), np.zeros(1)
        self.which = np.zeros(zeros)
        self._hops = _Hops(self.times.ctypes.data, self._home.ctypes.data, None, begin, end - begin, 0.0, np.inf)
        self.next = np.inf

    def bind(
        self,
        instant: Instant,
        flags: tuple[int, int],
        motion: Motion | None,
        fold: Answer,
        accounts: Accounts,
        step: Answer | None,
    ) -> None:
        """Go on with an instant.

        Parameters
        ----------
        flags : places of ``initial()`` and ``terminal()``, -1 for none
        motion : None where the instant has a view of it
        fold : takes values of relations that cross zero again, where there are any
        step : does to states what a step of discrete values does, where that may be something
        """
        states, zeros, discrete = instant.data.states, len(self._home), instant.data.discrete
        begun, held, work = np.zeros(states), np.zeros(discrete), np.empty(4 * states + 9 * zeros)
        self.turn, self.folds, at = np.zeros((3, zeros))
        hooks = [instant.hook(fold), *([] if step is None else [instant.hook(step)])]
        hooks += [] if motion is None else [_MOTION(instant.answering(motion, (states, zeros)))]
        folds, *others = (ctypes.cast(h, _PLACE).value for h in hooks)
        self._hops.motion = address("lmoc_look_along") if motion is None else others[-1]
        self._hops.work = work.ctypes.data
        arrays = (begun, held, self.which, self.turn, at, self.folds)
        self.data = _Events(
            ctypes.addressof(instant.data), ctypes.addressof(self._hops), *flags, self._next.ctypes.data, None, None,
            None, *(a.ctypes.data for a in arrays), fold=folds,
        )  # fmt: skip
        turned = self.book.data.turned if hasattr(self, "book") else self._hops.begin
        self.book = Book(ctypes.addressof(self.data), accounts, None if step is None else others[0], turned)
        self.data.happened, self.data.owner = self.book.writes, ctypes.addressof(self.book.data)
        self.data.turned = _at(self.book.data, "turned")
        self._instant, self._reference, self._kept = instant, ctypes.byref(self.data), (hooks, work, at, begun, held)

    @property
    def in_c(self) -> tuple[tuple[int, int], ...]:
        """Return what it knows, for who goes on in C: addresses, and how many numbers."""
        own, book = self._hops, self.book.data
        scalars = [_at(own, "soon"), _at(book, "turned")]
        return *((a.ctypes.data, a.size) for a in (self.times, self._home, self._next)), *((s, 1) for s in scalars)

    def memory(self) -> tuple[np.ndarray, np.ndarray, float, float, float]:
        """Return what it knows, for `recall`."""
        return self.times.copy(), self._home.copy(), self.soon, self.next, self.book.data.turned

    def recall(self, memory: tuple[np.ndarray, np.ndarray, float, float, float]) -> None:
        """Know what it has known."""
        self.times[:], self._home[:], self._hops.soon, self.next, self.book.data.turned = memory

    @property
    def next(self) -> float:
        """s, of the next time event."""
        return float(self._next[0])

    @next.setter
    def next(self, time: float) -> None:
        self._next[0] = time

    @property
    def soon(self) -> float:
        """s, after which the first function that has left zero is back; infinity where none is on its way."""
        return float(self._hops.soon)

    def start(
        self, t: float, x: np.ndarray, states: Callable[[], np.ndarray], equations: Callable[[bool], None]
    ) -> int:
        """Find states and discrete values that agree, and do what happens at the start; x gets the states.

        Parameters
        ----------
        states : finds those that the present discrete values lead to
        equations : gives discrete variables with an equation at the start their values; whether for the first time
        """

        def found(_: int, place: int) -> int:
            def work() -> bool:
                x[:] = states()
                return True

            return self._instant.answer(work)

        def begun(_: int, first: int) -> int:
            def work() -> bool:
                equations(bool(first))
                return True

            return self._instant.answer(work)

        hooks = _STATES(found), _EQUATIONS(begun)
        self.data.states, self.data.equations = (ctypes.cast(h, _PLACE).value for h in hooks)
        return int(self._instant.judged(library().lmoc_events_start(self._reference, t, x.ctypes.data, 0)))

    def after(self, t: float, x: np.ndarray, crossed: bool, step: float, errors: np.ndarray | None) -> int:
        """Do what happens where a segment has ended, because functions have crossed zero or not; x moves on.

        Parameters
        ----------
        step : s, the last step of the method, over which the motion is smooth
        errors : (states,) what the integrator has allowed itself in a step; None where something else happens as well
        """
        self._hops.step, self.data.errors = step, None if errors is None else errors.ctypes.data
        return int(self._instant.judged(library().lmoc_events_after(self._reference, t, x.ctypes.data, crossed)))

    def settle(self, t: float, x: np.ndarray) -> int:
        """Do what follows from a change of the continuous equations; x moves on."""
        return int(self._instant.judged(library().lmoc_events_settle(self._reference, t, x.ctypes.data)))


def _at(own: ctypes.Structure, name: str) -> int:
    """Return where a field stands."""
    offset: int = getattr(type(own), name).offset
    return ctypes.addressof(own) + offset
