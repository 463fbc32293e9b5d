"""Conditions that switch again and again without the run getting on.

Two ways of that: a condition that switches many times within a moment, and one whose hops become too low to be told
from rounding, as those of a ball that bounces to rest. Nothing behind that instant is known: a ball whose hop is taken
for none goes on through its floor.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lmoc.ir.events import Relations
from lmoc.messages.source import Span as SourceSpan
from lmoc.numerics.events.discrete_state import near_to
from lmoc.numerics.events.excursion import Excursions
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.failures.chatter import FRICTION_HINT
from lmoc.numerics.problem.status import Status, Stopped

_CHATTER = 12  # changes of one condition …
_MOMENT = 1e-9  # … within this part of the run, which is chattering
SEEN = 200.0  # times what its zero may be off, which a hop is higher than; a margin ends at 100 times itself
_EARLY = 0.125  # of the time to the way back, before which a function does not come back
_LONG, _SHORT = 1e-2, 1e-6  # of the time since a function has last crossed zero, over which its way is looked at


class Crossings:
    """When each zero function has last crossed zero, and when those that have left it at once are back.

    Attributes
    ----------
    soon : s, after which the first of them is back; infinity where none is on its way
    """

    def __init__(self, begin: float, end: float) -> None:
        self._begin, self._span = begin, end - begin
        self._times: dict[int, deque[float]] = {}
        self._left: dict[int, float] = {}  # s, before which a function that has left zero is not back
        self.soon = np.inf

    def before(self, zeros: np.ndarray) -> float:
        """s, when functions that are crossing zero, of which `cross` has been told, have last done so before."""
        return max(self._times[k][-2] if len(self._times[k]) > 1 else self._begin for k in zeros.tolist())

    def short(self, t: float, zeros: np.ndarray, step: float) -> float:
        """Return a time over which the ways of such functions are looked at, as of `excursions`.

        Parameters
        ----------
        step : s, the last step of the method, over which the motion is smooth
        """
        since = t - self.before(zeros)
        return float(np.clip(step, _SHORT * since, _LONG * since))

    def cross(self, layout: EventLayout, t: float, crossed: np.ndarray) -> None:
        """Take note of what crosses zero; raise `Stopped` where a condition switches too often within a moment."""
        self.soon = np.inf
        moment = _MOMENT * max(self._span, near_to(t))
        busy = []
        for k in crossed.tolist():
            times = self._times.setdefault(k, deque(maxlen=_CHATTER))
            times.append(t)
            if len(times) == _CHATTER and t - times[0] <= moment:
                busy.append(k)
        if not busy:
            return
        relations = [layout.relation_at(k) for k in self._times if t - self._times[k][-1] <= moment]
        raise _stopped(relations, f"{_CHATTER} times within {t - self._times[busy[0]][0]:.1g} s")

    def leave(self, t: float, zeros: np.ndarray, ways: Excursions) -> None:
        """Take note of functions that leave zero the way they have come from."""
        self._left.update((k, t + _EARLY * ways.back[k]) for k in zeros.tolist())
        self.soon = float(ways.back[zeros].min())

    def back_too_early(self, t: float, crossed: np.ndarray) -> np.ndarray:
        """Return which of the functions that cross zero have just left it, and had no time to come back."""
        return np.array([k for k in crossed.tolist() if t < self._left.get(k, -np.inf)], int)

    def too_low(self, layout: EventLayout, zeros: np.ndarray) -> Stopped:
        """Return that hops have become too low to be seen."""
        times = self._times[int(zeros[0])]
        last = f", the last one has taken {times[-1] - times[-2]:.1g} s" if len(times) > 1 else ""
        relations = [layout.relation_at(k) for k in zeros.tolist()]
        return _stopped(relations, f"the next hop is too low to be told from none{last}")


def _stopped(relations: list[Relations], how: str) -> Stopped:
    places = list(dict.fromkeys(where(r.text, r.span) for r in relations))[:2]
    verb = "switches" if len(places) == 1 else "switch"
    return Stopped(Status.CHATTERING, f"{' and '.join(places)} {verb} back and forth: {how} ({FRICTION_HINT})")


def where(name: str, span: SourceSpan | None) -> str:
    """Return a name in a sentence, with its line."""
    if span is None or span.source is None:
        return f"'{name}'"
    return f"'{name}' ({span.source.name}, line {span.line})"
