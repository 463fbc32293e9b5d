"""A budget for work that may not end: where nothing moves on for long, the work is interrupted.

Work is opened by `within` and says through `moved_on` and `reached` that it gets on. One thread of the process looks at
all work that is open a few times a second; where none of it has been heard of for as long as the budget allows, it
interrupts the thread that does the work, in the same way as Ctrl-C: what the work has reached by then is kept by the
same code. No result of work that was interrupted is ever taken for one: `within` raises `Spent`, whatever comes back.

What counts is the processor time of the thread that does the work, at most the time on the clock, and at least a tenth
of that: a machine or a process that is busy with other things does not make work slow, and waiting has an end as well.
"""

from __future__ import annotations

import _thread
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

DEFAULT = 30.0  # s
VARIABLE = "LMOC_BUDGET"  # of the environment, in place of the default
_EVERY = 0.1  # s between two looks
_AGAIN = 5.0  # s until work that has not ended is interrupted again: an interruption can be lost, in a callback of C
_IDLE = 100  # looks without any open work, after which the looking thread ends
_PART = 1e-3  # of the whole way: what gets on by less within a budget has no end that could be waited for
_WAITING = 0.1  # of the time on the clock counts at least

Result = TypeVar("Result")
_allowed: ContextVar[float | None] = ContextVar("lmoc_budget", default=None)


class Spent(KeyboardInterrupt):
    """Nothing has moved on for as long as the budget allows.

    Attributes
    ----------
    work : what was being done
    doing : the last thing heard of it; empty where nothing was
    seconds : the budget
    """

    def __init__(self, work: str = "", doing: str = "", seconds: float = DEFAULT) -> None:
        super().__init__(f"{work} has not moved on for {seconds:g} s")
        self.work, self.doing, self.seconds = work, doing, seconds


class Work:
    """Something under way in a thread.

    Attributes
    ----------
    doing : the last thing heard of it
    share : of a way that is being gone, what has been gone of it
    interrupted : whether it has been interrupted
    """

    def __init__(self, what: str, outer: Work | None) -> None:
        self.what, self.outer, self.seconds = what, outer, allowed()
        self.doing, self.share, self.heard = "", 0.0, 0
        self.known: set[str] = set()
        self.interrupted = False
        self.instead: Callable[[], object] | None = None  # called instead of an interruption from outside
        self.mark: tuple[int, float] | None = None  # `heard` and `share` when it was last seen to have moved on
        self.since = 0.0, 0.0  # clock and processor then
        clock = getattr(time, "pthread_getcpuclockid", None)
        self.own = None if clock is None else clock(threading.get_ident())  # of this thread, where it has one

    def moved(self) -> bool:
        """Return whether it has moved on since the mark; if so, mark the place where it is."""
        if self.mark is not None and self.heard == self.mark[0] and 0 <= self.share - self.mark[1] < _PART:
            return False
        self.mark = self.heard, self.share
        self.since = time.monotonic(), self.processor()
        return True

    def processor(self) -> float:
        """Return the processor time of the thread that does the work, s; of the process where that is not told."""
        if self.own is None:
            return time.process_time()
        try:
            return time.clock_gettime(self.own)
        except OSError:  # the thread has ended, and its work before it
            return self.since[1]

    def spent(self) -> float:
        """Return what has been spent since the mark, s."""
        clock, processor = time.monotonic() - self.since[0], self.processor() - self.since[1]
        return max(min(clock, processor), _WAITING * clock)


_open: dict[int, Work] = {}  # {thread: the innermost work}
_lock = threading.Lock()
_looking: threading.Thread | None = None


def allowed() -> float:
    """Return the seconds that work may take without moving on; infinite for no bound."""
    own = _allowed.get()
    if own is not None:
        return own
    try:
        given = float(os.environ[VARIABLE])
    except (KeyError, ValueError):
        return DEFAULT
    return given if given > 0 else DEFAULT


@contextmanager
def budget(seconds: float | None) -> Iterator[None]:
    """Allow all work in this context so many seconds without moving on, instead of 30; None for no bound.

    >>> with lmoc.budget(300):
    ...     dae.equations()

    Raises
    ------
    ValueError
        The seconds are not positive.
    """
    given = math.inf if seconds is None else float(seconds)
    if not given > 0:
        raise ValueError(f"a budget is a positive number of seconds, or None for no bound; found {seconds!r}")
    token = _allowed.set(given)
    try:
        yield
    finally:
        _allowed.reset(token)


def within(what: str, action: Callable[[], Result]) -> Result:
    """Return what an action returns, which is interrupted where it does not move on.

    Work within other work has a budget of its own, and when it ends the outer one has moved on.

    Raises
    ------
    Spent
        The budget is spent. An exception that says more, made of the interruption, is its `__cause__`.
    """
    thread = threading.get_ident()
    work = Work(what, _open.get(thread))
    try:
        _open[thread] = work
        _look()
        result = action()
        _close(thread, work)
    except BaseException as error:
        _close(thread, work)
        if work.interrupted:
            raise _spent(work) from error
        raise
    if work.interrupted:
        raise _spent(work)
    return result


def moved_on(what: str) -> None:
    """Say that a piece of work begins, different from those before it: the same one counts once."""
    work = _open.get(threading.get_ident())
    if work is not None and what not in work.known:
        work.known.add(what)
        work.doing = what
        work.heard += 1


def reached(share: float) -> None:
    """Say which part of a way has been gone, between 0 and 1; less than before where another way begins."""
    work = _open.get(threading.get_ident())
    if work is not None:
        work.share = share


def interrupted() -> bool:
    """Return whether the present work has been interrupted because its budget is spent."""
    work = _open.get(threading.get_ident())
    return work is not None and work.interrupted


@contextmanager
def instead(action: Callable[[], object]) -> Iterator[None]:
    """Have an interruption of the present work call an action, in any thread, instead of raising an exception."""
    work = _open.get(threading.get_ident())
    if work is None:
        yield
        return
    work.instead, before = action, work.instead
    try:
        yield
    finally:
        work.instead = before


def _spent(work: Work) -> Spent:
    return Spent(work.what, work.doing, work.seconds)


def _close(thread: int, work: Work) -> None:
    """End some work; once this has returned, no interruption of it is on its way."""
    while True:
        try:
            with _lock:
                if _open.get(thread) is work:
                    if work.outer is None:
                        del _open[thread]
                    else:
                        work.outer.heard += 1
                        _open[thread] = work.outer
            return
        except KeyboardInterrupt:  # on its way before the lock was ours
            if not work.interrupted:
                raise


def _look() -> None:
    """Have the thread that looks at open work run."""
    global _looking
    if _looking is None or not _looking.is_alive():
        with _lock:
            if _looking is None or not _looking.is_alive():
                _looking = threading.Thread(target=_watch, name="lmoc budget", daemon=True)
                _looking.start()


def _watch() -> None:
    global _looking
    idle = 0
    while True:
        time.sleep(_EVERY)
        idle = 0 if _open else idle + 1
        if idle > _IDLE:
            with _lock:
                if not _open:  # whoever opens work now starts another thread
                    _looking = None
                    return
        for thread, work in list(_open.items()):
            if not work.moved() and work.spent() > (_AGAIN if work.interrupted else work.seconds):
                with _lock:
                    if _open.get(thread) is work:
                        work.interrupted = True
                        work.heard += 1  # so that it is left alone for a while, to say what it has reached
                        _interrupt(thread, work)


def _interrupt(thread: int, work: Work) -> None:
    """Interrupt a thread as Ctrl-C would; where that does nothing, by an exception at its next step."""
    if thread == threading.main_thread().ident and callable(handler := signal.getsignal(signal.SIGINT)):
        if handler is signal.default_int_handler or work.instead is not None:
            _thread.interrupt_main()
            return
    if work.instead is not None:
        work.instead()
        return
    import ctypes

    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(Spent))
