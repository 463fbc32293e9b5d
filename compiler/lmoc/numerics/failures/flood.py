"""The warning of a run whose events are so many that its end is far: given while it goes on, not when it is over."""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Span as SourceSpan
from lmoc.numerics.observe.event import Event

_MANY = 2000  # instants with events, before anything is said
_AHEAD = 5  # times as many still to come make a flood
_LATEST = 1000  # records that tell what it is that happens
_EVERY = 0.2  # s between two reports of progress

Progress = Callable[[float, float], None]  # (time reached, stop time)


class Flood:
    """Counts the instants at which something happens.

    Parameters
    ----------
    end : s, where the run is to end
    places : {text of a condition: where it is written}
    """

    def __init__(self, end: float, places: Mapping[str, SourceSpan | None], report: Report, progress: Progress | None):
        self.end, self.places, self.report, self.progress = end, places, report, progress
        self._instants = 0
        self._half = 0.0  # s, of the event that was half as many ago
        self._next = _MANY
        self._told = clock.monotonic()

    def count(self, t: float, records: Sequence[Event]) -> None:
        """Take note of an instant; where a flood begins there, warn at once, and in the report.

        Parameters
        ----------
        records : all events so far
        """
        now = clock.monotonic()
        if self.progress is not None and now - self._told > _EVERY:  # segments are too short to tell by themselves
            self._told = now
            self.progress(t, self.end)
        self._instants += 1
        if 2 * self._instants == self._next:
            self._half = t
        elif self._instants == self._next:
            ahead = 0.5 * self._instants * (self.end - t) / (t - self._half) if t > self._half else float("inf")
            self._next = 2 * self._instants
            self._half = t
            if ahead > _AHEAD * self._instants:
                self._next = 0  # once is enough
                self._warn(t, ahead, records[-_LATEST:])

    def _warn(self, t: float, ahead: float, latest: Sequence[Event]) -> None:
        import logging

        text = Counter(e.after if e.after in self.places else e.name for e in latest).most_common(1)[0][0]
        message = (
            f"{self._instants} events until t = {t:.6g} s, most of the latest by '{text}': "
            f"at this rate about {ahead:.1g} are still ahead until {self.end:g} s"
        )
        hint = "an earlier --stop, or a longer interval; noEvent(…) where a formula needs no events"
        found = Diagnostic("W0556", message, self.places.get(text), hint=hint)
        self.report.diagnostics.append(found)
        logging.getLogger("lmoc").warning("%s", found)
