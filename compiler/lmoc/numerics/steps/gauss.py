"""Gauss collocation of order 8: symmetric, A-stable, and symplectic at steps of equal length, for conservative scenes.

Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1.3 (the method), VI.4 (why it is symplectic) and
VIII.6 (Newton's method and the first guess). The energy of a periodic motion does not drift as long as the step stays
the same; so a step chosen by the tolerance is kept until it has been too short for a long time, or is too long.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.limits import LEFT_BY_NEWTON, NO_STEP
from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.problem.status import Status
from lmoc.numerics.steps import gauss_table as table
from lmoc.numerics.steps.dop853 import initial_step
from lmoc.numerics.steps.resolvent import Resolvent

PROPERTIES = Properties(
    "gauss", "Gauss collocation", "symplectic", "8", "7", "own",
    stability="A", implicit=True, symplectic=True, lengths="either",
    good_for="conservative scenes over long times; keeps the length that the tolerance asks for, or takes a step",
)  # fmt: skip

_CONSTANT = 0.13  # of the error of a step, fitted to the oscillator
_ADDED = 2.0  # as the errors of the steps add up
_LEAST_PICARD, _PICARD = 3, 6  # iterations for the polynomial between the ends …
_SETTLED = 0.05  # … not all of them where they change it by so few tolerances
_SAFETY, _SHORTER, _LONGER = 0.9, 0.2, 4.0
_WORTHWHILE = 1.5  # factor by which a step must have been too short …
_CALM = 50  # … for so many steps, until it grows
_EXACT = 1e-13  # of the states: Newton's method goes on until then, since what it leaves drifts
_ITERATIONS, _SLOW = 15, 0.3
_ROUGH = 10.0  # tolerances by which the last two polynomials between the ends may differ
_LAST_TERM = 0.1  # largest value of the integral of the third Legendre polynomial along a step
_LEAST = 1e-300  # s, a step that can still be divided by


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem."""
    return Gauss(problem)


class Gauss(Integration):
    """The method at work.

    Attributes
    ----------
    z : (4, n) the stages of the last step less the state at its beginning; None where there is no step behind
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.system = problem.system
        self.resolvent = Resolvent(problem.system, table.SHIFTS)
        self.smallest = problem.atol / problem.rtol * 1e-3
        self.fixed = problem.step is not None
        self.step_size = float(problem.step) if self.fixed else 0.0
        self.t = problem.t
        self.jump(problem.x)

    def jump(self, x: np.ndarray) -> None:
        self.before, self.x = self.t, x.copy()
        self.z: np.ndarray | None = None
        self._between: np.ndarray | None = None  # the polynomial along the last step, once it is asked for
        self.stale, self.growing, self.calm, self.longer = True, True, 0, np.inf
        self._origin, self._done = self.t, 0
        with np.errstate(all="ignore"):
            self.slope = self._rhs(self.t, self.x)
            self.finite = bool(np.isfinite(self.slope).all())
            if not self.fixed and not self.step_size and self.finite:
                self.step_size = initial_step(self.problem, self.t, self.x, self.slope)

    def _rhs(self, t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(len(x))
        self.system.rhs(t, x, out)
        return out

    # ------------------------------------------------------------------ a step

    @np.errstate(all="ignore")
    def step(self) -> Status:
        if not self.finite:
            return Status.NOT_FINITE
        t, end, h = self.t, self.problem.end, self.step_size
        while True:
            t_new = self._origin + (self._done + 1) * h if self.fixed else t + min(h, self.problem.max_step)
            if t_new > end - NO_STEP * h:
                t_new = end
            h = t_new - t
            if not h > 8e-16 * abs(t_new) or h < _LEAST:
                return self._why_none(t, h)
            found = self._solved(t, h)
            if self.fixed:
                if found is None:
                    return Status.NO_CONVERGENCE
                return Status.OK if self._accepted(t_new, found[0]) else Status.NOT_FINITE
            refined = None if found is None else self._refined(t, h, self.x, self.slope, found[0])
            error = math.inf if found is None else self._error(h, *found, refined[0])
            factor = 0.5 if math.isinf(error) else max(_SHORTER, _SAFETY * max(error, 1e-30) ** (-1 / 9))
            if error <= 1.0:
                rough = self._roughness(refined[1]) if self.wanted < t_new else 0.0
                if rough > _ROUGH:
                    factor = max(_SHORTER, _SAFETY * (_ROUGH / rough) ** (1 / 6))
                elif self._accepted(t_new, found[0]):
                    self._between = self._polynomial(h, refined[0])
                    self._plan(h, h * min(_LONGER, factor), t_new == end)
                    return Status.OK
                else:
                    factor = 0.5
            self.rejected += 1
            self.problem.system.go_back()
            self.growing, self.calm = False, 0
            h *= factor
            self.step_size = h

    def _why_none(self, t: float, h: float) -> Status:
        """Return why there is no step short enough: values that are not finite ahead, or none of it."""
        ahead = self._rhs(t, self.x + max(h, 1e-12 * abs(t)) * self.slope)
        return Status.COLLAPSED if np.isfinite(ahead).all() else Status.NOT_FINITE

    def _plan(self, h: float, wanted: float, last: bool) -> None:
        """Choose the length of the next step: as long as this one, as a rule."""
        if last and h < self.step_size:  # shortened by the end
            return
        short = wanted > _WORTHWHILE * h
        if self.growing and short:
            self.step_size = wanted
            return
        self.growing, self.step_size = False, h
        self.calm, self.longer = (self.calm + 1, min(self.longer, wanted)) if short else (0, math.inf)
        if self.calm >= _CALM:
            self.step_size, self.calm, self.longer = self.longer, 0, math.inf

    def _accepted(self, t_new: float, z: np.ndarray) -> bool:
        """Stand at the end of a step, if the derivatives have values there; whether they have."""
        x = self.x + table.ENDS @ z
        slope = self._rhs(t_new, x)
        if not np.isfinite(slope).all():
            return False
        self._past = self.x, self.slope
        self.before, self.t, self.x, self.z, self.slope = self.t, t_new, x, z, slope
        self._between = None
        self.steps += 1
        self._done += 1
        return True

    def _error(self, h: float, z: np.ndarray, f: np.ndarray, refined: np.ndarray | None) -> float:
        """Return the error of a step in tolerances, 1 is what they allow: the largest of three estimates.

        The Legendre coefficients a_k of the derivative along the step decay by some ratio from one to the next, and the
        first that the method does not integrate is a_8. Those up to a_3 are known from the stages; one of them may be
        small by chance. The refined polynomial knows those up to a_5, and another end of the step.

        Parameters
        ----------
        z, f : (4, n) the stages and the derivatives at them
        refined : (6, n) as from `_refined`
        """
        scale = self.problem.atol + self.problem.rtol * np.abs(self.x)

        def sizes(values: np.ndarray) -> list[float]:
            return np.sqrt(((values / scale) ** 2).mean(axis=-1)).tolist()

        first, third = sizes(table.LEGENDRE @ f)
        error = _CONSTANT * h * third * _decay(first, third) ** 5
        if refined is not None:
            a2, a3, a4, a5 = sizes(table.LOBATTO_LEGENDRE @ refined)
            ratio = max(_decay(a2, a4), _decay(a3, a5))
            end = sizes(h * table.INTEGRALS[-1] @ refined - table.ENDS @ z)
            error = max(error, _CONSTANT * h * max(a4 * ratio**4, a5 * ratio**3), end)
        error *= _ADDED
        return float(error) if math.isfinite(error) else math.inf

    # ------------------------------------------------------------------ the stages

    def _solved(self, t: float, h: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the stages and the derivatives at them, (4, n) each, by a simplified Newton's method."""
        fresh = False
        while True:
            if self.stale:
                self.resolvent.at(t, self.x)
                self.stale, fresh = False, True
            found = self._newton(t, h) if self.resolvent.factorize(h) else None
            if found is not None or fresh:
                return found
            self.stale = True

    def _newton(self, t: float, h: float) -> tuple[np.ndarray, np.ndarray] | None:
        x, last = self.x, math.inf
        z = self._guess(h)
        f = np.empty_like(z)
        scale = np.abs(x) + self.smallest
        for _ in range(_ITERATIONS):
            for i in range(4):
                self.system.rhs(t + table.NODES[i] * h, x + z[i], f[i])
            rest = table.TO_MODES @ (f - table.INVERSE @ z / h)
            change = np.stack([self.resolvent.solve(k, rest[k]) for k in range(2)])
            change = 2 * (table.TO_STAGES @ change).real
            z = z + change
            size = float((np.abs(change) / scale).max())
            if size <= _EXACT or size > last / 2 and last < LEFT_BY_NEWTON:
                return z, table.INVERSE @ z / h
            if not size < 2 * last:
                return None
            self.stale |= size > _SLOW * last
            last = size
        return None

    def _guess(self, h: float) -> np.ndarray:
        """Return the stages as the polynomial of the step before continues."""
        if self.z is None:
            return h * np.outer(table.NODES, self.slope)
        return table.extrapolation(h / (self.t - self.before)) @ self.z

    # ------------------------------------------------------------------ values within a step

    def _roughness(self, change: np.ndarray) -> float:
        """Return by how many tolerances the last two polynomials of a step that is not accepted yet differ."""
        scale = self.problem.atol + self.problem.rtol * np.abs(self.x)
        return float((np.abs(change) / scale).max())

    def _polynomial(self, h: float, f: np.ndarray | None) -> np.ndarray:
        """Return h times the derivatives of the refined polynomial; empty for that of collocation."""
        return np.zeros((0, len(self.x))) if f is None else h * f

    def _refined(
        self, t: float, h: float, x: np.ndarray, slope: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray | None, np.ndarray]:
        """Return derivatives (6, n) at Lobatto's nodes, whose integral is a polynomial of order 7, and its last change.

        The polynomial of collocation has order 4 only between its ends; each of Picard's iterations adds one. None
        where stiffness makes them diverge: then that polynomial is the best there is, and the first term that it lacks
        is told in place of the change.
        """
        f = np.empty((len(table.LOBATTO), len(x)))
        f[0] = slope
        values, moved = table.FROM_STAGES @ z, np.inf
        scale = self.problem.atol + self.problem.rtol * np.abs(x)
        for k in range(_LEAST_PICARD if self.fixed else _PICARD):
            for i in range(1, len(table.LOBATTO)):
                self.system.rhs(t + table.LOBATTO[i] * h, x + values[i], f[i])
            new = h * table.INTEGRALS @ f
            change = new - values
            size = float(np.abs(change).max())
            if not size <= max(moved, 1e-14 * float(np.abs(x).max(initial=0.0))):
                first, third = np.abs(table.LEGENDRE @ table.INVERSE @ z)
                return None, _LAST_TERM * third * min(1.0, math.sqrt(third.max() / max(first.max(), 1e-300)))
            values, moved = new, size
            if k + 1 >= _LEAST_PICARD and (np.abs(change) <= _SETTLED * scale).all():
                break
        return f, change

    @np.errstate(all="ignore")
    def interpolate(self, times: np.ndarray) -> np.ndarray:
        h, (x, slope) = self.t - self.before, self._past
        if self._between is None:
            self._between = self._polynomial(h, self._refined(self.before, h, x, slope, self.z)[0])
        theta = (times - self.before) / h
        if not len(self._between):
            values = x + table.stage_values(theta) @ self.z
        else:
            gap = self.x - x - table.INTEGRALS[-1] @ self._between
            values = x + table.integrals(theta) @ self._between + np.outer(theta**2 * (3 - 2 * theta), gap)
        values[times == self.t] = self.x
        return values

    def counts(self) -> dict[str, int]:
        return super().counts() | {"jacobians": self.resolvent.evaluations}


def _decay(one: float, two: float) -> float:
    """Return the ratio of neighbouring coefficients from two of them, of which one is skipped."""
    return math.sqrt(two / max(one, two)) if two > 0 else 0.0
