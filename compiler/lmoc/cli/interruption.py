"""Ctrl-C that strikes where no exception can get out of, and is raised again where one can."""

from __future__ import annotations

import _thread  # `threading` would be the first thing that a command imports; this is there anyway
import signal
import sys
import time
from typing import Any

_AGAIN = 0.01  # s until it is raised again: a callback is over by then, and if not, the next time counts


def keep() -> None:
    """Have a KeyboardInterrupt that Python can only print and forget raised again.

    It forgets one that is raised in the callback of a weak reference, in `__del__` or in the garbage collector's
    work. Each import of a module runs such callbacks: the signal was lost, and the run went on for its hours.
    """
    if sys.unraisablehook is not _unraisable:
        sys.unraisablehook = _unraisable


def _unraisable(lost: Any) -> None:
    if lost.exc_type is KeyboardInterrupt:  # not one of its descendants: who raises these looks after them
        _thread.start_new_thread(_raise_again, ())
    else:
        sys.__unraisablehook__(lost)


def _raise_again() -> None:
    time.sleep(_AGAIN)
    ignored = not callable(signal.getsignal(signal.SIGINT))  # then it can only have come from SIGTERM
    _thread.interrupt_main(signal.SIGTERM if ignored else signal.SIGINT)
