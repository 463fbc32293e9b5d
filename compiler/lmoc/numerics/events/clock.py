"""Time events: the instants at which `sample` is true, and at which relations of time alone change."""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.events.discrete_state import DiscreteState, near_to


def next_time(discrete: DiscreteState, t: float, include: bool = False) -> float:
    """Return the first time event behind a time; infinity where there is none.

    Parameters
    ----------
    include : one at the time itself counts
    """
    events = discrete.layout.events
    least = t - near_to(t) if include else t + near_to(t)
    found = math.inf
    for s in events.samples:
        for start, interval in zip(discrete.v[s.start].tolist(), discrete.v[s.interval].tolist(), strict=True):
            found = min(found, _tick(start, interval, least))
    for timed in discrete.layout.timed:
        r = events.relations[timed.relation]
        slope, offset = discrete.line(timed.relation, r.slots)
        with np.errstate(all="ignore"):
            if r.op == "floor":
                level = np.floor(slope * least + offset) + (slope > 0)
                level = np.where((slope < 0) & (level == slope * least + offset), level - 1, level)
            else:
                level = np.zeros(r.rows)
            at = (level - offset) / slope
        ahead = at[np.isfinite(at) & (at > least)]
        found = min(found, float(ahead.min(initial=math.inf)))
    return found


def ring(discrete: DiscreteState, t: float) -> bool:
    """Set the variables of `sample` whose instant this is; whether there are any."""
    some = False
    for s in discrete.layout.events.samples:
        start, interval = discrete.v[s.start], discrete.v[s.interval]
        k = np.round((t - start) / interval)
        due = (k >= 0) & (np.abs(start + k * interval - t) <= near_to(t))
        discrete.v[s.target] = due
        some |= bool(due.any())
    return some


def _tick(start: float, interval: float, least: float) -> float:
    """Return the first of ``start + k·interval`` behind a time."""
    if not interval > 0:
        return math.inf
    k = max(0, math.floor((least - start) / interval))
    while start + k * interval <= least:
        k += 1
    return start + k * interval
