"""Interpolation of tables by a twice continuously differentiable cubic spline (de Boor 1978, chapter IV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Spline:
    """Cubic spline with not-a-knot ends: exact for cubic polynomials. Beyond the ends the last value is held.

    Attributes
    ----------
    knots : (n,) increasing
    coefficients : (4, n-1), value ``((c0·d + c1)·d + c2)·d + c3`` at distance d behind a knot
    """

    knots: np.ndarray
    coefficients: np.ndarray

    def __call__(self, t, order: int = 0) -> np.ndarray:
        """Value, or the derivative of an order up to 2, at t (any shape)."""
        t = np.asarray(t, float)
        inside = np.clip(t, self.knots[0], self.knots[-1])
        k = np.clip(np.searchsorted(self.knots, inside, "right") - 1, 0, len(self.knots) - 2)
        d = inside - self.knots[k]
        c0, c1, c2, c3 = self.coefficients[:, k]
        if order == 0:
            return ((c0 * d + c1) * d + c2) * d + c3
        held = (t < self.knots[0]) | (t > self.knots[-1])
        slope = (3 * c0 * d + 2 * c1) * d + c2 if order == 1 else 6 * c0 * d + 2 * c1
        return np.where(held, 0.0, slope)


@np.errstate(all="ignore")
def fit(knots: np.ndarray, values: np.ndarray) -> Spline:
    """The spline through points; two points give a line, three a parabola.

    Coefficients are not finite where knots are too close together for double precision.

    Parameters
    ----------
    knots : (n,) finite, increasing, n ≥ 2
    values : (n,) finite
    """
    x, y = np.asarray(knots, float), np.asarray(values, float)
    if len(x) < 4:
        degree = len(x) - 1
        polynomial = np.polynomial.Polynomial.fit(x, y, degree)
        slopes = polynomial.deriv()(x) if degree else np.zeros(len(x))
    else:
        slopes = _knot_slopes(x, y)
    h, rise = np.diff(x), np.diff(y) / np.diff(x)
    s0, s1 = slopes[:-1], slopes[1:]
    return Spline(x, np.array([(s0 + s1 - 2 * rise) / h**2, (3 * rise - 2 * s0 - s1) / h, s0, y[:-1]]))


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
