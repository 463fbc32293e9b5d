"""Conditions that switch again and again without the run getting on.

Two ways of that: a condition that switches many times within a moment, and one whose hops become too low to be told
from rounding, as those of a ball that bounces to rest. Nothing behind that instant is known: a ball whose hop is taken
for none goes on through its floor. A ball that has just been turned at h = 0 has left ``h <= 0`` at once, without an
event of its own. It is decided in C (``engine/c/hops.c``); here is what is said.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.event_walk import EventWalk
from lmoc.ir.events import Relations
from lmoc.messages.source import Span as SourceSpan
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.failures.chatter import FRICTION_HINT
from lmoc.numerics.problem.status import Status, Stopped


def too_often(walk: EventWalk, layout: EventLayout, t: float) -> Stopped:
    """Return what ends a run whose conditions switch too often within a moment."""
    moment = t - walk.times[walk.data.culprit, 0]
    relations = [layout.relation_at(k) for k in np.flatnonzero(t - walk.times[:, -1] <= moment).tolist()]
    return _stopped(relations, f"{walk.times.shape[1]} times within {moment:.1g} s")


def too_low(walk: EventWalk, layout: EventLayout) -> Stopped:
    """Return what ends a run in which a function seems to be back, or hops too low to be seen."""
    zeros = walk.turn.nonzero()[0]
    before, last = walk.times[zeros[0], -2:].tolist()
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
