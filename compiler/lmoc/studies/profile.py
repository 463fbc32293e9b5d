"""Profile likelihoods: how far a value may go from the best one if all others follow as well as they can.

Bates and Watts, Nonlinear Regression Analysis and Its Applications (1988), chapter 6; Raue et al., Bioinformatics 25
(2009): the interval holds where the linear one does not, and is infinite where the data set no bound.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from lmoc.support.records import dataclass

_PART = 0.25  # of the way to where the interval would end by the covariance, of the first step
_STEPS = 40  # to each side
_GROW = 1.6  # of a step where the distance has grown by less than expected
_FAR = 1e4  # standard deviations, or sizes: what is not reached by then is not bounded
_EXACT = 1e-4  # of the distance at which an interval ends
_UNSEEN = 0.1  # of a value that the data do not determine, of the first step
_LOWER = 1e-3  # of the distance: what lies below the best value by more is a lower minimum



@dataclass(frozen=True, eq=False)
class Place:
    """The best values while one of them is held.

    Attributes
    ----------
    grown : how much the sum of squares has grown, divided by the variance of the data
    values : (n,)
    slope : (n,) their derivatives by the one that is held
    """

    grown: float
    values: np.ndarray
    slope: np.ndarray

    @property
    def distance(self) -> float:
        return float(np.sqrt(max(self.grown, 0.0)))

    def ahead(self, k: int, value: float) -> np.ndarray:
        """Return a first guess (n,) of the values where unknown k is held at another one."""
        return self.values + self.slope * (value - self.values[k])


Conditional = Callable[[int, float, np.ndarray], Place]


class Searched(Protocol):
    """What is looked for."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Profile:
    """The profile of one value.

    Attributes
    ----------
    values : (k,) increasing
    distance : (k,) signed roots of how much the sum of squares grows, in standard deviations of the data
    low, high : where the interval ends; infinite where the data set no bound, a bound of the search where that is met
    lower : whether some values fit better than the best one: the search has not found the lowest minimum
    """

    name: str
    values: np.ndarray
    distance: np.ndarray
    low: float
    high: float
    lower: bool = False


def profile_of(
    k: int, unknown: Searched, best: np.ndarray, spread: float, limit: float, conditional: Conditional
) -> Profile:
    """Return the profile of unknown k.

    Parameters
    ----------
    best : (n,) all values
    spread : its standard deviation by the covariance, infinite where that knows none
    limit : distance at which the interval ends
    conditional : (k, value of k, first guess of all) -> the place where the others are as good as they can be
    """
    points, lower = [(float(best[k]), 0.0)], False
    ends = {}
    for sign, bound in ((-1.0, unknown.low), (1.0, unknown.high)):
        found, end, below = _side(k, sign, bound, best, spread, limit, conditional)
        points += [(value, sign * distance) for value, distance in found]
        lower |= below
        ends[sign] = end
    points.sort()
    values, distance = np.array(points).T
    return Profile(unknown.name, values, distance, ends[-1.0], ends[1.0], lower)


def _side(
    k: int, sign: float, bound: float, best: np.ndarray, spread: float, limit: float, conditional: Conditional
) -> tuple[list[tuple[float, float]], float, bool]:
    """Return values and distances to one side, where the interval ends, and whether there was a lower minimum."""
    size = spread if np.isfinite(spread) and spread > 0 else _UNSEEN * (abs(best[k]) or 1.0)
    step, inner = _PART * limit * size, conditional(k, float(best[k]), best)
    points, lower = [], False
    for _ in range(_STEPS):
        at = float(inner.values[k])
        value = at + sign * step
        stopped = sign * (value - bound) >= 0
        value = bound if stopped else value
        outer = conditional(k, value, inner.ahead(k, value))
        lower |= outer.grown < -_LOWER * limit**2
        points.append((value, outer.distance))
        if outer.distance >= limit:
            crossing = _crossing(k, inner, outer, limit, conditional)
            return [*points, (crossing, limit)], crossing, lower
        if stopped:
            return points, bound, lower
        if abs(value - best[k]) > _FAR * size:
            break
        if outer.distance - inner.distance < _PART * limit:
            step *= _GROW
        inner = outer
    return points, sign * np.inf, lower


def _crossing(k: int, inner: Place, outer: Place, limit: float, conditional: Conditional) -> float:
    """Return where the distance is the limit, between two places: it is nearly linear there (regula falsi, halved)."""
    for attempt in range(_STEPS):
        a, b = float(inner.values[k]), float(outer.values[k])
        share = (limit - inner.distance) / (outer.distance - inner.distance) if attempt % 3 < 2 else 0.5
        value = a + share * (b - a)
        if abs(b - a) <= _EXACT**2 * abs(b):
            break
        now = conditional(k, value, inner.ahead(k, value))
        if abs(now.distance - limit) <= _EXACT * limit:
            break
        inner, outer = (now, outer) if now.distance < limit else (inner, now)
    return value
