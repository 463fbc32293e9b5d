"""The warning of a run that will take long, while it is still at its beginning."""

from __future__ import annotations

import logging
import time as clock

from lmoc.messages.diagnostics import Diagnostic

_FIRST = 5.0  # s of work, before anything is said
_LONG = 60.0  # s of work still ahead make a long run


class Pace:
    """Compares the work of a run with the way that it has come.

    What it says depends on the machine, so that it goes to the log (and the command's standard error) and is no note of
    the run.

    Parameters
    ----------
    begin, end : s, of the run
    """

    def __init__(self, begin: float, end: float) -> None:
        self.begin, self.end = begin, end
        self._started = clock.thread_time()
        self._next = _FIRST

    def reached(self, t: float) -> None:
        """Say once how long it will take, where that is long."""
        spent = clock.thread_time() - self._started
        if spent < self._next or not t > self.begin:
            return
        left = spent * (self.end - t) / (t - self.begin)
        self._next = 2 * spent  # the pace of a beginning may be none of what follows
        if left > _LONG:
            self._next = float("inf")
            come = f"the run has come to t = {t:.4g} s in {spent:.0f} s of work"
            message = f"{come}: at this pace it takes about {_duration(left)} more until {self.end:g} s"
            hint = "an earlier --stop, a coarser --rtol, fewer jumps and kinks of inputs; Ctrl-C keeps what it has"
            found = Diagnostic("W0563", message, hint=hint)
            logging.getLogger("lmoc").warning("%s", found)


def _duration(seconds: float) -> str:
    """Return a duration in words.

    >>> _duration(300), _duration(8000), _duration(300000)
    ('5 min', '2.2 h', '3.5 days')
    """
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.2g} h" if seconds < 86400 else f"{seconds / 86400:.2g} days"
