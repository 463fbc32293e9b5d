"""When a condition has ceased to hold, to the last digits of time rather than at the output time at which it was seen.

The run is over by then. From a state that was kept nearby the way is integrated once more, by the classical Runge-Kutta
method in steps that are halved until two ways agree; between two steps the time is bisected.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.numerics.limits import AGREE
from lmoc.numerics.observe.slices import slice_of
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory

_FEW, _MOST = 16, 1024  # steps from one kept state to the next
_HALVINGS = 60

Array = np.ndarray
Rates = Callable[[float, Array], Array]
Holds = Callable[[SegmentRecord, float, Array], bool]


def onset(run: Trajectory, index: int, holds: Holds) -> float:
    """Return when a condition ceases to hold that does not at an output time, though at the one before.

    Parameters
    ----------
    index : of the output time
    holds : (segment, time, states) -> whether it does

    Returns
    -------
    s; the output time itself where nothing better is known
    """
    at = float(run.time[index])
    segment = _segment(run, index)
    times, states = segment.samples
    if index == 0 or not len(times) or not states.shape[1]:
        return at
    part = slice_of(segment.observer.plan, segment.observer.plan.derivatives)
    follow = segment.observer.followed(part)

    def rates(t: float, state: Array) -> Array:
        return follow(np.array([t]), state[None])[0]

    k = max(int(np.searchsorted(times, at, "right")) - 1, 0)
    way = _way(rates, float(times[k]), states[k], at)
    if way is None:
        return at
    if times[k] >= at or not any(holds(segment, *place) for place in way):  # what is known lies behind it
        begin = max(segment.begin, float(run.time[index - 1]))
        way = _way(rates, *way[-1], begin)
        if way is None:
            return at
        way = way[::-1]
    good = [k for k, place in enumerate(way) if holds(segment, *place)]
    if not good:
        return way[0][0]
    low, state = way[good[-1]]
    if good[-1] + 1 == len(way):
        return at
    start, high = low, way[good[-1] + 1][0]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if holds(segment, middle, _step(rates, start, state, middle - start)):
            low = middle
        else:
            high = middle
    return high


def _segment(run: Trajectory, index: int) -> SegmentRecord:
    """Return the segment in which an output time lies."""
    for segment in run.segments:
        if index < len(segment.time):
            return segment
        index -= len(segment.time)
    raise IndexError(index)


def _way(rates: Rates, begin: float, x: Array, end: float) -> list[tuple[float, Array]] | None:
    """Return places from one time to another, as exact as rounding allows; None where there is no value."""
    if begin == end:
        return [(begin, x)]
    steps, before = _FEW, None
    while steps <= _MOST:
        h, way = (end - begin) / steps, [(begin, x)]
        for _ in range(steps):
            t, state = way[-1]
            way.append((t + h, _step(rates, t, state, h)))
        last = way[-1][1]
        if not np.isfinite(last).all():
            return None
        if before is not None and (np.abs(last - before) <= AGREE * (np.abs(last) + np.abs(x))).all():
            return way
        before, steps = last, 2 * steps
    return way


def _step(rates: Rates, t: float, x: Array, h: float) -> Array:
    a = rates(t, x)
    b = rates(t + h / 2, x + h / 2 * a)
    c = rates(t + h / 2, x + h / 2 * b)
    return x + h / 6 * (a + 2 * b + 2 * c + rates(t + h, x + h * c))
