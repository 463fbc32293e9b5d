"""What is watched along a run: one interface of all that may end a segment by functions of time and states."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate
from typing import Protocol

import numpy as np

from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.roots import Roots, joined
from lmoc.numerics.problem.status import Status


class Monitor(Protocol):
    """Something that is watched from segment to segment.

    Attributes
    ----------
    until : s, where the present segment ends at the latest; infinity where nothing is known to come
    longest_step : s, so that nothing that depends on time is stepped over
    ended : why the run does not go on; None where it does
    """

    @property
    def until(self) -> float: ...

    @property
    def longest_step(self) -> float: ...

    @property
    def ended(self) -> Status | None: ...

    def watch(self, observer: Observer, t: float, x: np.ndarray) -> Roots | None:
        """Look at the place where a segment begins; return what is watched in it, None where nothing is."""


class Monitors:
    """All that is watched in one run, in the order in which it is looked at."""

    def __init__(self) -> None:
        self._all: list[Monitor] = []
        self._ends: list[int] = []  # of the root functions of each, among those of all

    def add(self, monitor: Monitor) -> None:
        self._all.append(monitor)

    def until(self, end: float) -> float:
        """Return where the present segment ends at the latest, s, in a run up to `end`."""
        return min([end, *(m.until for m in self._all)])

    @property
    def longest_step(self) -> float:
        """s, as of `Monitor`."""
        return min([np.inf, *(m.longest_step for m in self._all)])

    def watch(self, observer: Observer, t: float, x: np.ndarray) -> Roots | None:
        """Return what all watch in a segment that begins at a place; None where that is nothing."""
        found = [m.watch(observer, t, x) for m in self._all]
        self._ends = [*accumulate(0 if roots is None else len(roots.signs) for roots in found)]
        known = [roots for roots in found if roots is not None]
        return joined(known) if known else None

    @property
    def ended(self) -> Status | None:
        """Why the run does not go on; None where it does."""
        return next((m.ended for m in self._all if m.ended is not None), None)

    def own(self, monitor: Monitor, which: np.ndarray | None) -> np.ndarray | None:
        """Return which root functions of one have ended a segment, of those of all."""
        if which is None or len(self._all) == 1:
            return which
        k = self._all.index(monitor)
        return which[self._ends[k - 1] if k else 0 : self._ends[k]]

    def after(self, outcome: Outcome) -> Outcome:
        """Return the outcome of a segment, or that one has ended the run."""
        ended = self.ended
        return outcome if ended is None else replace(outcome, status=ended, roots=None)
