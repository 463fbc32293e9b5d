"""Conditions that switch again and again without the run getting on.

Two ways of that: a condition that switches many times within a moment, and one whose hops become too low to be told
from rounding, as those of a ball that bounces to rest. Nothing behind that instant is known: a ball whose hop is taken
for none goes on through its floor. A ball that has just been turned at h = 0 has left ``h <= 0`` at once, without an
event of its own. It is decided in C (``engine/c/hops.c``); here is what it asks, and what is said.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.hops import Hops
from lmoc.ir.events import Relations
from lmoc.messages.source import Span as SourceSpan
from lmoc.numerics.events.closeness import located
from lmoc.numerics.events.discrete_state import DiscreteState
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.failures.chatter import FRICTION_HINT
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.status import Status, Stopped


class Crossings:
    """What crosses zero in a run."""

    def __init__(self, zeros: int, begin: float, end: float) -> None:
        self._hops, self._begin = Hops(zeros, begin, end), begin

    def memory(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Return what it knows, for `recall`."""
        return self._hops.memory()

    def recall(self, memory: tuple[np.ndarray, np.ndarray, float]) -> None:
        """Know what it has known."""
        self._hops.recall(memory)

    @property
    def soon(self) -> float:
        """s, after which the first function that has left zero at once is back; infinity where none is on its way."""
        return self._hops.soon

    def cross(self, discrete: DiscreteState, outcome: Outcome, which: np.ndarray) -> None:
        """Take note of the functions, (zeros,), that cross zero where a segment has ended.

        Raises
        ------
        Stopped
            A condition switches too often within a moment, or a function that has just left zero seems to be back and
            moves away from it.
        """
        hops, layout, t = self._hops, discrete.layout, outcome.time
        busy = hops.cross(discrete.instant, t, which)
        if busy >= 0:
            moment = t - hops.times[busy, 0]
            relations = [layout.relation_at(k) for k in np.flatnonzero(t - hops.times[:, -1] <= moment).tolist()]
            raise _stopped(relations, f"{hops.times.shape[1]} times within {moment:.1g} s")
        discrete.look_along(hops, outcome)
        wrong = hops.wrong_way(discrete.instant, t, outcome.x, which)
        if len(wrong):
            raise self._too_low(layout, wrong)

    def returning(self, t: float, crossed: np.ndarray) -> np.ndarray:
        """Return which functions that cross zero have done so at this instant before; `cross` has been told of them."""
        return crossed[t - self._hops.times[crossed, -2] <= located(t, self._begin)]

    def turned_back(
        self, discrete: DiscreteState, outcome: Outcome, x: np.ndarray, which: np.ndarray, at: np.ndarray
    ) -> np.ndarray:
        """Return the functions that leave zero at once, and note when they are back and by what their zeros are off.

        Parameters
        ----------
        outcome : of the segment that has ended where they crossed zero
        x : states behind the jump
        at : (zeros,) the functions where they crossed zero, before the jump

        Raises
        ------
        Stopped
            A hop is too low to be seen.
        """
        discrete.look_along(self._hops, outcome)
        discrete.inputs(outcome.time)
        found, too_low = self._hops.turned_back(discrete.instant, outcome.time, (outcome.x, x), which, at)
        if too_low:
            raise self._too_low(discrete.layout, found)
        return found

    def _too_low(self, layout: EventLayout, zeros: np.ndarray) -> Stopped:
        before, last = self._hops.times[zeros[0], -2:].tolist()
        taken = f", the last one has taken {last - before:.1g} s" if np.isfinite(before) else ""
        relations = [layout.relation_at(k) for k in zeros.tolist()]
        return _stopped(relations, f"the next hop is too low to be told from none{taken}")


def _stopped(relations: list[Relations], how: str) -> Stopped:
    places = list(dict.fromkeys(where(r.text, r.span) for r in relations))[:2]
    verb = "switches" if len(places) == 1 else "switch"
    return Stopped(Status.CHATTERING, f"{' and '.join(places)} {verb} back and forth: {how} ({FRICTION_HINT})")


def where(name: str, span: SourceSpan | None) -> str:
    """Return a name in a sentence, with its line."""
    if span is None or span.source is None:
        return f"'{name}'"
    return f"'{name}' ({span.source.name}, line {span.line})"
