"""Location of sign changes of functions of time and state within a step: on the step's own dense output, in order.

Between the ends of a step a function may cross zero and come back. It is therefore looked at inside as well, and
where it comes near zero and turns, at its extremum (Shampine & Thompson, Event location for ordinary differential
equations, Comput. Math. Appl. 39, 2000). A crossing is located to the last digits of time by brackets around inverse
interpolation (`locate`), which are never worse than bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lmoc.numerics.problem.base import Integration, Roots

_INSIDE = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of a step, where the functions are looked at
_BESIDE = 0.01  # the same, beside its ends: where a function turns there, the samples further inside do not tell
_SHARES = np.array([0.0, _BESIDE, 0.25, 0.5, 0.75, 1.0 - _BESIDE, 1.0])
_COARSE = 0.02  # of a function's change in a step: what samples may be off by that follow it
_MANY_SAMPLES = 65  # in a part of a step; where more are needed, the part is made shorter
_MOST_SAMPLES = 500  # in a step, where no part is short enough
_SHORTEST = 1 / 512  # of a step, a part
_APART = 16  # units of the last digit of time: samples that are closer show rounding
_TIGHT = 4e-16  # of the time: two places that close are one
_NEAR = np.array([1e-2, 1e-4, 1e-6, 1e-9, 1e-12])  # shares of a bracket
_MOST_CALLS = 60
_NONE = np.zeros(0, int)
_POINTS = 5  # of inverse interpolation
_NEWTON, _SETTLED = 30, 1e-15  # steps of Newton's method on a polynomial in 0 … 1, and the shortest one
_LOW = 0.02  # of what three samples differ by: below it a minimum between them may be below zero
_GOLDEN = (5**0.5 - 1) / 2
_NARROWED = 30  # golden sections towards an extremum

Curve = Callable[[float], np.ndarray]  # the functions' values at a time within the step


class RootFinder:
    """Follows the signs of root functions from step to step.

    Attributes
    ----------
    signs : (m,) the signs that the functions have had last; 0 where none is known yet
    which : (m,) mask of those that vanish at the root found last
    """

    def __init__(self, roots: Roots, t: float, x: np.ndarray) -> None:
        self.roots = roots
        self.signs = roots.signs
        unknown = self.signs == 0
        self.signs[unknown] = np.sign(roots.values(np.array([t]), x[None])[0])[unknown]
        self.which = np.zeros(len(self.signs), bool)
        if roots.largest is None:
            roots.largest = np.abs(x)
        self._inside = _INSIDE  # of the step, as shares, where the functions are looked at
        self._place = t, x.copy()  # the end of the step before: multistep methods do not interpolate it exactly

    def first(self, run: Integration) -> tuple[float, np.ndarray] | None:
        """Return the place (t, x) in the last step at which the integration shall end, None where it goes on."""
        begin, self._inside = run.before, _INSIDE
        self._length, self._shortest = run.t - begin, _SHORTEST * (run.t - begin)
        while True:
            found, end = self._next(run, begin)
            if found is None and end < run.t:
                begin, self._inside, self._length = end, _INSIDE, self._longer()
                continue
            if found is None:
                self._place = run.t, run.x.copy()
                return None
            t, x = found
            if self.roots.reached(t, x, self.which, self.signs):
                return found
            begin = t

    def _longer(self) -> float:
        """Return the length of the next part of a step: twice that of the last one, where few samples have done."""
        return self._length * (2.0 if 2 * len(self._inside) < _MANY_SAMPLES else 1.0)

    def _next(self, run: Integration, begin: float) -> tuple[tuple[float, np.ndarray] | None, float]:
        """Return the first root of the last step after a time, and note the signs after it.

        Returns
        -------
        the place of the root; None where there is none before the second, the time up to which has been looked
        """

        def curve(times: np.ndarray) -> np.ndarray:
            return self.roots.values(times, run.interpolate(times))

        times, values = self._samples(run, begin)
        end = float(times[-1])
        best, rest = self._together(times, values, curve)
        for k in rest.tolist():
            t = self._first_of(k, times, values[:, k], lambda at, k=k: curve(at)[:, k])
            if t is not None and (best is None or t < best[0]):
                best = t, k
        known = np.sign(values[-1])
        if best is None:
            self.signs[known != 0] = known[known != 0]
            return None, end
        t = best[0]
        x = run.x.copy() if t == run.t else run.interpolate(np.array([t]))[0]
        at = values[-1] if t == end else self.roots.values(np.array([t]), x[None])[0]
        crossed = (np.sign(at) * self.signs < 0) | (np.arange(len(at)) == best[1])
        self.which = crossed
        self.signs[crossed] = np.where(self.signs != 0, -self.signs, np.sign(at))[crossed]
        unknown = self.signs == 0
        self.signs[unknown] = np.sign(at)[unknown]
        return (t, x), end

    def _samples(self, run: Integration, begin: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times from `begin` on, and the functions there, close enough to follow them.

        They reach to the end of the last step, or of a part of it where the functions change too often in all of it.
        A step is as long as the states allow. They say nothing about a body that is held fast, while the force that
        holds it follows the load. After a root, the rest of the step is looked at as closely as before it. Of a step of
        a few units of the last digit of time, as before a stop at an event, more samples show rounding alone.
        """
        while True:
            end = min(begin + self._length, run.t) if begin + 1.01 * self._length < run.t else run.t
            times = begin + self._shares() * (end - begin)
            times[-1] = end
            states = run.interpolate(times)
            if end == run.t:
                states[-1] = run.x
            if times[0] == self._place[0]:
                states[0] = self._place[1]
            np.fmax(self.roots.largest, np.abs(states).max(axis=0), out=self.roots.largest)
            values = self._without_rounding(end, states[-1], self.roots.values(times, states))
            count = len(self._inside)
            told_apart = end - begin > count * _APART * np.spacing(max(abs(begin), abs(end)))
            if count > _MOST_SAMPLES or not told_apart or not _unresolved(values, self.signs).any():
                return times, values
            if count >= _MANY_SAMPLES and self._length < np.inf:
                # a part, or all of the step again where not even the shortest is followed: a jump, or noise
                self._length = min(self._length, end - begin) / 2
                self._length = np.inf if self._length < self._shortest else self._length
                if self._length < np.inf:
                    continue
            self._inside = np.linspace(0.0, 1.0, 2 * count - 1)

    def _without_rounding(self, t: float, x: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return samples in which functions that are zero but for rounding keep their sign."""
        wrong = (values * self.signs <= 0).any(axis=0) | _unresolved(values, self.signs)
        if wrong.any():
            quiet = wrong & self.roots.quiet(t, x, np.abs(values).max(axis=0))
            values[:, quiet] = self.signs[quiet] * np.abs(values[:, quiet]).max(axis=0, initial=0.0)
        return values

    def _shares(self) -> np.ndarray:
        """Return where a step is looked at: at equal distances, and beside its ends."""
        if self._inside is _INSIDE:
            return _SHARES
        return np.concatenate([[0.0, _BESIDE], self._inside[1:-1], [1.0 - _BESIDE, 1.0]])

    def _together(
        self, times: np.ndarray, values: np.ndarray, curve: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[tuple[float, int] | None, np.ndarray]:
        """Find the first root of the functions that simply cross zero, as that of the lowest of them.

        Returns
        -------
        the time and the function, None where there is none; the functions that are to be looked at one by one
        """
        heights = values * self.signs
        below, dips, known = heights < 0, _dips(times, heights).any(axis=0), self.signs != 0
        crosses = below.any(axis=0)
        if not (crosses | dips | ~known).any():
            return None, _NONE
        simple = known & crosses & ~dips
        rest = np.flatnonzero((dips | ~known) & ~simple)
        own = np.flatnonzero(simple)
        if not len(own):
            return None, rest
        index = below[:, own].argmax(axis=0)
        i = int(index.min())
        own = own[index == i]
        if i == 0:  # against the sign it is said to have: at once
            return (float(times[0]), int(own[0])), rest
        sides = self.signs[own]
        lowest_of = heights[:, own].min(axis=1)
        near = (times, lowest_of) if (np.diff(times) > 0).all() else None
        t = locate(
            lambda at: (curve(at)[:, own] * sides).min(axis=1),
            times[i - 1], times[i], lowest_of[i - 1], lowest_of[i], near,
        )  # fmt: skip
        if len(own) == 1:
            return (t, int(own[0])), rest
        return (t, int(own[(curve(np.array([t]))[0, own] * sides).argmin()])), rest

    def _first_of(self, k: int, times: np.ndarray, values: np.ndarray, curve) -> float | None:
        """Return the first time at which function k has the other sign than before, None where it keeps its sign."""
        sign = self.signs[k]
        if sign == 0:
            some = values[values != 0]
            sign = np.sign(some[0]) if len(some) else 0.0
        if sign == 0:
            return None
        heights = sign * values
        for i in range(1, len(times)):
            if heights[0] < 0:  # against the sign it is said to have: at once
                return float(times[0])
            if heights[i] < 0:
                return locate(lambda t: sign * curve(t), times[i - 1], times[i], heights[i - 1], heights[i])
            three = slice(i - 1, i + 2)
            if i + 1 < len(times) and _dips(times[three], heights[three]).any():
                low = _lowest(lambda t: sign * float(curve(np.array([t]))[0]), times[three], heights[three])
                if low[1] < 0:
                    return locate(lambda t: sign * curve(t), times[i - 1], low[0], heights[i - 1], low[1])
        return None


def _even(values: np.ndarray) -> np.ndarray:
    """Return the values at equidistant samples, without those beside the ends."""
    return np.concatenate([values[:1], values[2:-2], values[-1:]])


def _unresolved(values: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Return which functions, (times, m), may be below zero somewhere between samples, for all these tell.

    Where the cubic through four neighbours misses the one in their middle by a part of what the function changes. So
    do those of an oscillation of nearly as many periods as samples, but not what is seen beside the ends.
    """
    beside, values = values[[1, -2]], _even(values)
    middle = (4 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]) / 6
    missed = np.abs(values[2:-2] - middle).max(axis=0)
    if len(values) <= _MANY_SAMPLES:
        weights = _to_beside(len(values))
        expected = np.stack([weights @ values[:5], weights @ values[:-6:-1]])
        missed = np.maximum(missed, np.abs(beside - expected).max(axis=0))
    return (missed > _COARSE * np.ptp(values, axis=0)) & ((values * signs).min(axis=0) < 10 * missed)


@cache
def _to_beside(samples: int) -> np.ndarray:
    """Return the weights (5,) of the first equidistant samples in their quartic's value at `_BESIDE`."""
    at = _BESIDE * (samples - 1)
    return np.array([np.prod([(at - b) / (a - b) for b in range(5) if b != a]) for a in range(5)])


def _dips(times: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Return where smooth functions may be below zero between neighbouring samples that are not, (times - 2, …).

    Where one has turned and is no higher than it has come down, or where the parabola through three samples comes near
    zero: as of a hop that is over in a small part of a long step, at whose samples all is as before. Else it would take
    a curvature that the samples do not show.
    """
    before, inner, behind = heights[:-2], heights[1:-1], heights[2:]
    turned = (inner > 0) & (inner <= np.minimum(before, behind)) & (2 * inner < np.maximum(before, behind))
    place, value = _vertices(times, heights)
    least, most = np.minimum(np.minimum(before, behind), inner), np.maximum(np.maximum(before, behind), inner)
    with np.errstate(invalid="ignore"):
        inside = (place > 0.0) & (place < 1.0)
        return turned | ((least >= 0) & inside & (value < np.minimum(_LOW * (most - least), least)))


def _vertices(times: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places, as shares, and the values of the minima of the parabolas through three neighbours each.

    NaN or outside of 0 … 1 where there is none between them.
    """
    before, inner, behind = heights[:-2], heights[1:-1], heights[2:]
    wide, first = times[2:] - times[:-2], times[1:-1] - times[:-2]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (first / wide).reshape(-1, *[1] * (heights.ndim - 1))
        slope = (inner - before) / share  # of the line from the first to the second
        bent = (behind - before - slope) / (1.0 - share)  # half the second derivative
        at_first = slope - share * bent
        place = np.where(bent > 0.0, -at_first / (2.0 * bent), np.nan)
        return place, before - at_first**2 / (4.0 * bent)


def locate(
    curve: Callable[[np.ndarray], np.ndarray],
    a: float,
    b: float,
    at_a: float,
    at_b: float,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> float:
    """Return the end at which ``curve < 0`` of the smallest bracket of its crossing from above zero.

    A call costs about the same for one time as for a dozen. So each one looks at the place that the values known so far
    give (`_guess`), at places ever nearer to it on both sides, and at the middle: for a smooth function the bracket
    shrinks with a high power of its length, and never by less than half. On DOP853's dense output that takes 2 or 3
    calls, the ITP method 17.

    Parameters
    ----------
    curve : times (k,) -> (k,), with ``curve(a) = at_a ≥ 0 > at_b = curve(b)``
    near : (times, values) of the function there and around, for the first guess
    """
    known: tuple[np.ndarray, np.ndarray] | None = None
    least = _TIGHT * max(abs(a), abs(b))  # from zero on, of the bracket: what is 1e-320 s behind it has no digits
    for _ in range(_MOST_CALLS):
        if b - a <= 2 * least:
            break
        if near is not None and known is None:
            place = a + (b - a) * _zero_between((near[0] - a) / (b - a), near[1])
        else:
            place = _guess(a, b, at_a, at_b, known)
        apart = (b - a) * _NEAR
        places = np.concatenate([place - apart, [place], place + apart, [place - least, place + least, (a + b) / 2]])
        places = np.sort(places[(places > a) & (places < b)])
        if not len(places):
            break
        values = curve(places)
        known = places, values
        below = np.flatnonzero(values < 0)
        k = int(below[0]) if len(below) else len(places)
        if k < len(places):
            b, at_b = float(places[k]), float(values[k])
        if k > 0:
            a, at_a = float(places[k - 1]), float(values[k - 1])
    return float(b)


def _zero_between(times: np.ndarray, values: np.ndarray) -> float:
    """Return a zero in 0 … 1 of the polynomial through some values, positive at 0 and negative at 1."""
    coefficients = np.linalg.solve(np.vander(times), values).tolist()
    low, high, t = 0.0, 1.0, 0.5
    for _ in range(_NEWTON):
        value = slope = 0.0
        for c in coefficients:
            slope = slope * t + value
            value = value * t + c
        if value < 0.0:
            high = t
        else:
            low = t
        step = value / slope if slope else np.inf
        if abs(step) < _SETTLED:
            break
        t = t - step if low < t - step < high else 0.5 * (low + high)
    return t


def _guess(a: float, b: float, at_a: float, at_b: float, known: tuple[np.ndarray, np.ndarray] | None) -> float:
    """Return where a function crosses zero between a and b: by inverse interpolation, else by the secant.

    Parameters
    ----------
    known : (times, values) further places; those of the lowest values count
    """
    if known is not None:
        times, values = np.append(known[0], [a, b]), np.append(known[1], [at_a, at_b])
        values, first = np.unique(values, return_index=True)
        nearest = np.argsort(np.abs(values))[:_POINTS]
        t, v = times[first[nearest]] - a, values[nearest]
        apart = v[:, None] - v
        np.fill_diagonal(apart, 1.0)
        weights = -v / apart.T
        np.fill_diagonal(weights, 1.0)
        place = a + float(t @ weights.prod(axis=0))
        if a < place < b:
            return place
    return (at_a * b - at_b * a) / (at_a - at_b)


def _lowest(curve: Callable[[float], float], times: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Return a place and value of a minimum among three samples: that of their parabola if it is below zero there."""
    share = float(_vertices(times, heights)[0][0])
    if 0.0 < share < 1.0:
        place = float(times[0] + share * (times[2] - times[0]))
        value = curve(place)
        if value < 0:
            return place, value
    return lowest(curve, float(times[0]), float(times[2]))


def lowest(curve: Callable[[float], float], a: float, b: float) -> tuple[float, float]:
    """Return a place and value of a minimum between two times (golden sections); where below zero, at once."""
    c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_c, at_d = curve(c), curve(d)
    for _ in range(_NARROWED):
        if min(at_c, at_d) < 0:
            break
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - _GOLDEN * (b - a)
            at_c = curve(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + _GOLDEN * (b - a)
            at_d = curve(d)
    return (c, at_c) if at_c < at_d else (d, at_d)
