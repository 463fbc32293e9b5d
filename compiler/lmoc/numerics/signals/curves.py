"""Curves through the points of a table that stay between neighbouring points: nothing overshoots.

One thing is let pass: a peak between two samples, where the samples around it show its curvature clearly
(`_smooth_peaks`). Flattening it would spoil the accelerations of a motion that was sampled finely.

How smooth a curve is made depends on the derivatives that the equations need of it: it is continuous (linear), or once
or twice continuously differentiable (monotone cubic and quintic Hermite interpolation). Where a time is repeated, the
curve jumps.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.support.records import dataclass

_ALIKE = 0.9  # ratio of neighbouring second differences that belong to one smooth peak
SMOOTHEST = 2  # continuous derivatives that a curve can have


@dataclass(frozen=True, eq=False)
class Curve:
    """A piecewise polynomial that holds its first and last value beyond its ends; at a jump it has the value behind it.

    Attributes
    ----------
    knots : (n,) not decreasing; a time that occurs twice is a jump
    values : (n,)
    coefficients : (degree+1, n-1)
        Coefficient k belongs to ``u**k`` with u = (t - knot)/(next knot - knot).
    peaks : (n-1,) pieces that may go beyond their ends
    """

    knots: np.ndarray
    values: np.ndarray
    coefficients: np.ndarray
    peaks: np.ndarray

    def __call__(self, t, order: int = 0) -> np.ndarray:
        """Return the value, or the derivative of an order, at times of any shape; where it jumps, that behind it."""
        t = np.asarray(t, float)
        k = np.clip(np.searchsorted(self.knots, t, "right") - 1, 0, len(self.knots) - 2)
        length = self._lengths[k]
        u, result = (t - self.knots[k]) / length, np.zeros(t.shape)
        for c in self._derivatives(order)[::-1]:
            result = result * u + c[k]
        before, behind = t < self.knots[0], t >= self.knots[-1]
        if order == 0:
            low, high = self._bounds
            inside = np.clip(result, low[k], high[k])  # against rounding
            return np.where(before, self.values[0], np.where(behind, self.values[-1], inside))
        return np.where(before | (t > self.knots[-1]), 0.0, result / length**order)

    def at(self, t: float, order: int = 0) -> float:
        """The same for one time; numpy is slow for single numbers."""
        knots, last = self.knots, float(self.knots[-1])
        if t < knots[0] or t > last or (t == last and order == 0):
            return 0.0 if order else self._ends[bool(t >= last)]
        k = min(int(knots.searchsorted(t, "right")), len(knots) - 1) - 1
        length = float(self._lengths[k])
        u, result = (t - float(knots[k])) / length, 0.0
        for c in self._derivatives(order)[::-1]:
            result = result * u + float(c[k])
        low, high = self._bounds
        return result / length**order if order else min(max(result, float(low[k])), float(high[k]))

    def pieces(self, order: int) -> tuple[np.ndarray, ...]:
        """Return the derivative of an order: knots, coefficients by piece (see there), its bounds, the ends."""
        return self.knots, self._derivatives(order).T, *self._bounds, np.array(self._ends)

    @property
    def jumps(self) -> np.ndarray:
        """Times at which the curve jumps."""
        return self.knots[1:][np.diff(self.knots) == 0]

    @cached_property
    def kinks(self) -> np.ndarray:
        """Times at which some derivative that is not zero jumps: all knots but those on a straight line."""
        slopes = self.coefficients[1] / self._lengths
        straight = (np.abs(self.coefficients[2:]) <= 1e-12 * np.abs(self.coefficients[1])).all(axis=0)
        same = np.isclose(slopes[1:], slopes[:-1], rtol=1e-9, atol=0) & straight[1:] & straight[:-1]
        return np.unique(np.concatenate([self.knots[:1], self.knots[1:-1][~same], self.knots[-1:], self.jumps]))

    @cached_property
    def _lengths(self) -> np.ndarray:
        lengths = np.diff(self.knots)
        return np.where(lengths > 0, lengths, 1.0)  # nobody is ever within a jump

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        left, right = self.values[:-1], self.values[1:]
        low, high = np.minimum(left, right), np.maximum(left, right)
        return np.where(self.peaks, -np.inf, low), np.where(self.peaks, np.inf, high)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return float(self.values[0]), float(self.values[-1])

    def _derivatives(self, order: int) -> np.ndarray:
        """Coefficients of a derivative by u."""
        if order not in self._made:
            c = self.coefficients
            for _ in range(order):
                c = c[1:] * np.arange(1, len(c))[:, None]
            self._made[order] = c
        return self._made[order]

    @cached_property
    def _made(self) -> dict[int, np.ndarray]:
        return {}


@np.errstate(all="ignore")
def fit(knots: np.ndarray, values: np.ndarray, smoothness: int) -> Curve:
    """Return a curve through points that between two of them lies between their values.

    Coefficients are not finite where times are too close together, or values too large, for double precision.

    Parameters
    ----------
    knots : (n,) finite, not decreasing, no time more than twice, n ≥ 2
    values : (n,) finite
    smoothness : number of continuous derivatives between the jumps: 0, 1 or 2
    """
    x, y = np.asarray(knots, float), np.asarray(values, float)
    degree = (1, 3, 5)[smoothness]
    coefficients, peaks = np.zeros((degree + 1, len(x) - 1)), np.zeros(len(x) - 1, bool)
    gap, rise = np.diff(x), np.diff(y)
    edges = np.flatnonzero(gap == 0)
    coefficients[:2] = np.where(gap > 0, (y[:-1], rise), 0.0)
    coefficients[-1] += 0 * (rise / np.where(gap > 0, gap, 1.0) ** 2)  # no number where derivatives would be none
    for first, last in zip([0, *(edges + 1)], [*edges, len(x) - 1], strict=True):
        if last > first + 1 and smoothness:  # two points are joined by their line
            t, v = x[first : last + 1], y[first : last + 1]
            peak = _smooth_peaks(t, v)
            coefficients[:, first:last] = _PIECES[smoothness](t, v, peak)
            peaks[first:last] = peak[1:] | peak[:-1]
    return Curve(x, y, coefficients, peaks)


def _monotone_cubic(x: np.ndarray, y: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Fritsch and Carlson, Monotone piecewise cubic interpolation (SIAM J. Numer. Anal. 17, 1980)."""
    h, rise = np.diff(x), np.diff(y)
    slope = _agreeing(parabolic_slopes(x, y), rise, peak)
    a, b = slope[:-1] * h, slope[1:] * h
    factor = _at_knots(_limit(3 * np.abs(rise), np.hypot(a, b), peak))
    a, b = a * factor[:-1], b * factor[1:]
    return np.array([y[:-1], a, 3 * rise - 2 * a - b, a + b - 2 * rise])


def _monotone_quintic(x: np.ndarray, y: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Quintic Hermite pieces with slopes and curvatures of the cubic spline, limited until every piece is monotone.

    Between two knots the derivative is a quartic; where its five Bernstein coefficients have the sign of the rise, so
    has the derivative. With a, b the slopes and c, d the curvatures at the ends, times h and h², they are
    a, a + c/4, 5·rise - (2a + c/4 + 2b - d/4), b - d/4, b: linear in all four, so that limiting a knot's values for one
    neighbour never spoils what holds for the other. Where nothing has to be limited the spline itself comes out.
    (Compare Lux, Watson, Chang and Thacker, Algorithm 1031: MQSI, ACM TOMS 49, 2023.)
    """
    h, rise = np.diff(x), np.diff(y)
    slope, curvature = spline_slopes(x, y)
    slope = _agreeing(slope, rise, peak)
    sign = np.sign(rise)
    least, most = np.full(len(x), -np.inf), np.full(len(x), np.inf)  # of the curvature at each knot
    bound = 4 * slope[:-1] / h  # a + c/4 has the sign of the rise to the right …
    np.copyto(least[:-1], -bound, where=sign > 0)
    np.copyto(most[:-1], -bound, where=sign < 0)
    bound = 4 * slope[1:] / h  # … and b - d/4 that of the rise to the left
    most[1:] = np.where(sign > 0, np.minimum(most[1:], bound), most[1:])
    least[1:] = np.where(sign < 0, np.maximum(least[1:], bound), least[1:])
    flat = _at_knots(sign != 0) == 0
    curvature = np.where(peak, curvature, np.where(flat, 0.0, np.clip(curvature, least, most)))
    a, b, c, d = slope[:-1] * h, slope[1:] * h, curvature[:-1] * h**2, curvature[1:] * h**2
    middle = 2 * a + c / 4 + 2 * b - d / 4
    factor = _at_knots(_limit(5 * np.abs(rise), np.abs(middle), peak))
    a, b, c, d = a * factor[:-1], b * factor[1:], c * factor[:-1], d * factor[1:]
    p, q, r = rise - a - c / 2, b - a - c, d - c
    return np.array([y[:-1], a, c / 2, 10 * p - 4 * q + r / 2, -15 * p + 7 * q - r, 6 * p - 3 * q + r / 2])


_PIECES = {1: _monotone_cubic, 2: _monotone_quintic}


def _smooth_peaks(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Knots beside which a well sampled peak lies: no step or corner, as the second divided differences around say.

    They are nearly the same at the knot and its neighbours, as are those of a sine with 25 or more points a period.
    """
    found = np.zeros(len(x), bool)
    if len(x) >= 5:
        slope = np.diff(y) / np.diff(x)
        bend = np.diff(slope) / (x[2:] - x[:-2])
        around = np.array([bend[:-2], bend[1:-1], bend[2:]])
        low, high = np.abs(around).min(axis=0), np.abs(around).max(axis=0)
        alike = (np.abs(np.sign(around).sum(axis=0)) == 3) & (low > _ALIKE * high)
        turns = np.sign(slope[1:-2]) != np.sign(slope[2:-1])
        found[2:-2] = alike & turns
    return found


def _limit(most: np.ndarray, size: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Factors for pieces by which `size` comes down to `most`; 1 for those at a peak."""
    return np.where(peak[1:] | peak[:-1], 1.0, np.minimum(1.0, most / np.maximum(size, 1e-300)))


def _at_knots(pieces: np.ndarray) -> np.ndarray:
    """The smaller of the values of the two pieces that meet at each knot."""
    wide = np.concatenate([pieces[:1], pieces, pieces[-1:]])
    return np.minimum(wide[:-1], wide[1:])


def _agreeing(slope: np.ndarray, rise: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Slopes at the knots where they have the sign of the rises on both sides, or a peak is near; 0 elsewhere."""
    sign = np.sign(rise)
    left, right = np.concatenate([sign[:1], sign]), np.concatenate([sign, sign[-1:]])
    return np.where(peak | ((left == right) & (np.sign(slope) == left)), slope, 0.0)


def parabolic_slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Slopes at the knots of the parabolas through three neighbouring points: exact for polynomials of degree 2."""
    h, slope = np.diff(x), np.diff(y) / np.diff(x)
    if len(x) == 2:
        return np.repeat(slope, 2)
    inner = (h[1:] * slope[:-1] + h[:-1] * slope[1:]) / (h[1:] + h[:-1])
    return np.concatenate([[2 * slope[0] - inner[0]], inner, [2 * slope[-1] - inner[-1]]])


def spline_slopes(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivatives at the knots of the cubic spline with not-a-knot ends (de Boor 1978, chapter IV).

    Exact for polynomials of degree 3; through three points it is their parabola, through two their line.
    """
    h, slope = np.diff(x), np.diff(y) / np.diff(x)
    first = _knot_slopes(x, y) if len(x) > 3 else parabolic_slopes(x, y)
    second = (6 * slope - 4 * first[:-1] - 2 * first[1:]) / h
    last = (2 * first[-2] + 4 * first[-1] - 6 * slope[-1]) / h[-1]
    return first, np.append(second, last)


def _knot_slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """First derivatives at the knots from continuity of the second, and of the third at the outermost inner knots."""
    h, rise = np.diff(x), np.diff(y) / np.diff(x)
    n = len(x)
    lower, diagonal, upper, right = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    lower[1:-1], diagonal[1:-1], upper[1:-1] = h[1:], 2 * (h[1:] + h[:-1]), h[:-1]
    right[1:-1] = 3 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])
    ends = h[0] + h[1], h[-1] + h[-2]
    diagonal[0], upper[0] = h[1], ends[0]
    right[0] = ((h[0] + 2 * ends[0]) * h[1] * rise[0] + h[0] ** 2 * rise[1]) / ends[0]
    diagonal[-1], lower[-1] = h[-2], ends[1]
    right[-1] = (h[-1] ** 2 * rise[-2] + (2 * ends[1] + h[-1]) * h[-2] * rise[-1]) / ends[1]
    return _tridiagonal(lower, diagonal, upper, right)


def _tridiagonal(lower, diagonal, upper, right) -> np.ndarray:
    """Thomas' algorithm."""
    b, r = diagonal.tolist(), right.tolist()
    a, c = lower.tolist(), upper.tolist()
    for i in range(1, len(b)):
        f = a[i] / b[i - 1]
        b[i] -= f * c[i - 1]
        r[i] -= f * r[i - 1]
    for i in range(len(b) - 1, -1, -1):
        r[i] = (r[i] - (c[i] * r[i + 1] if i + 1 < len(b) else 0.0)) / b[i]
    return np.array(r)
