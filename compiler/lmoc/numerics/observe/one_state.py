"""Changing a variable through the one state that it follows from: `reinit`, and values set from outside."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass

Array = NDArray[np.float64]

_ASIDE = 1e-4  # change of a state, of its size, by which it is seen what follows it
_FOLLOWS = 1e-9  # share of the largest change that counts as one, and not as what solved equations leave
_MISSED = 1e-9, 1e-12  # share of the value, or of those on the way, by which rounding may let it be missed
_PROPORTIONAL = 1e-7  # share of a value that equations solved for it may leave
_ROUNDS, _HALVINGS = 60, 40


@dataclass(frozen=True, eq=False)
class Moved:
    """A state vector in which a variable has another value.

    Attributes
    ----------
    x : (n,) None where there is none: the variable follows from no state, from several, or does not reach the value
    followed : (k,) indices of the states that it follows from
    """

    x: Array | None
    followed: NDArray[np.int64]


def why_not(followed: NDArray[np.int64], states: Sequence[str]) -> str:
    """Return why a variable cannot be given a value.

    Parameters
    ----------
    followed : (k,) indices of the states that it follows from
    states : names of all states
    """
    names = [states[k] for k in followed.tolist()]
    if len(names) == 1:
        return f"no value of the state {names[0]} leads there"
    if names:
        return f"it follows from {len(names)} states: {', '.join(names)}"
    return f"it follows from no state; states are {', '.join(states)}" if states else "there are no states"


def places_under(reduced: Reduced) -> NDArray[np.bool_]:
    """Return which states (n,) are places: others are their velocities."""
    return np.isin(reduced.derivatives, reduced.states)


@np.errstate(all="ignore")
def moved(value: Callable[[Array], float], x: Array, wanted: float, places: NDArray[np.bool_] | None = None) -> Moved:
    """Return the states with which a variable has a value, by a change of the one state that it follows from.

    Newton's method with steps that are halved until they bring the value closer.

    Parameters
    ----------
    value : of the variable, from the states (n,)
    x : (n,) the present states
    places : which of the first of them (k,) stay where they are for what is proportional to one velocity: whether x or
        y is the coordinate of a pendulum, der(x) is changed where it is
    """
    here = value(x)
    aside = _aside(x)
    change = np.array([value(_with(x, j, aside[j])) - here for j in range(len(x))])
    lost = ~np.isfinite(change)
    followed = np.flatnonzero(lost | (np.abs(change) > _FOLLOWS * np.abs(change[~lost]).max(initial=0.0)))
    moving = followed
    if places is not None and len(followed) > 1:
        velocities = followed[~np.isin(followed, np.flatnonzero(places))]
        if len(velocities) == 1 and _is_proportional(value, x, int(velocities[0])):
            moving = velocities
    if len(moving) != 1 or not np.isfinite(here):
        return Moved(None, followed)
    j = int(moving[0])

    def gap(state: float) -> float:
        return value(_with(x, j, state)) - wanted

    now, missed = x[j], here - wanted
    for _ in range(_ROUNDS):
        beside = _aside(now)
        closer = _closer(gap, now, -missed * (beside - now) / (gap(beside) - missed), missed)
        if closer is None:
            break
        now, missed = closer
    if not abs(missed) <= max(_MISSED[0] * abs(wanted), _MISSED[1] * abs(here)):
        return Moved(None, moving)
    return Moved(_with(x, j, now), moving)


def _is_proportional(value: Callable[[Array], float], x: Array, j: int) -> bool:
    """Return whether a variable is proportional to a state, with all others as they are."""
    size = abs(x[j]) or 1.0
    none, once, twice = (value(_with(x, j, k * size)) for k in range(3))
    rounding = _PROPORTIONAL * abs(twice)
    return abs(none) <= rounding and abs(twice - 2.0 * once) <= rounding


def _closer(gap: Callable[[float], float], now: float, step: float, missed: float) -> tuple[float, float] | None:
    """Return a state, and the gap there, on the way of a step and closer than `missed`; None where there is none."""
    for _ in range(_HALVINGS):
        left = gap(now + step)
        if abs(left) < abs(missed):
            return now + step, left
        step /= 2
    return None


def _aside(x: Array) -> Array:
    return np.where(x == 0.0, _ASIDE, x * (1.0 + _ASIDE))


def _with(x: Array, j: int, value: float) -> Array:
    changed = x.copy()
    changed[j] = value
    return changed
