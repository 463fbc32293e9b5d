"""Steps of equal length: what the methods that make them have in common.

The length is the user's, and no error is estimated. The last step of a segment ends where the segment does.
"""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from lmoc.numerics.limits import NO_STEP
from lmoc.numerics.problem.base import Integration, Problem
from lmoc.numerics.problem.status import Status


class FixedStep(Integration):
    """A method at work. Between the steps: the cubic polynomial with the values and slopes at both ends.

    Where a step is so long that these slopes lead far away, as in a transient that it jumps over, a straight line.

    Attributes
    ----------
    slope : (n,) the derivative at the current point; None until it is needed
    curved : whether the polynomial is used between the ends of the last step; None until it is needed
    """

    slope: np.ndarray | None
    curved: bool | None

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.system = problem.system
        self.step_size = float(problem.step)
        self.t = self.before = problem.t
        self.x = self.x_before = problem.x.copy()
        self._begin()

    def _begin(self) -> None:
        self._origin, self._done = self.t, 0
        self.slope = self.slope_before = self.curved = None

    def jump(self, x: np.ndarray) -> None:
        self.x, self.before = x.copy(), self.t
        self._begin()

    @abstractmethod
    def advanced(self, t: float, x: np.ndarray, h: float) -> np.ndarray | None:
        """Return the state a step later; None where the equations of the step have no solution that is found."""

    def step(self) -> Status:
        h, end = self.step_size, self.problem.end
        t_new = self._origin + (self._done + 1) * h
        if not t_new > self.t:
            return Status.COLLAPSED
        if t_new > end - NO_STEP * h:
            t_new = end
        with np.errstate(all="ignore"):
            x = self.advanced(self.t, self.x, t_new - self.t)
        if x is None:
            return Status.NO_CONVERGENCE
        if not math.isfinite(float(x.sum())):
            return Status.NOT_FINITE
        self.before, self.x_before, self.slope_before = self.t, self.x, self.slope
        self.t, self.x, self.slope, self.curved = t_new, x, None, None
        self._done += 1
        self.steps += 1
        return Status.OK

    def derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return f(t, x)."""
        out = np.empty(len(x))
        self.system.rhs(t, x, out)
        return out

    def own_slope(self) -> np.ndarray:
        """Return the derivative at the current point."""
        if self.slope is None:
            self.slope = self.derivative(self.t, self.x)
        return self.slope

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        if self.slope_before is None:
            self.slope_before = self.derivative(self.before, self.x_before)
        h = self.t - self.before
        s = ((times - self.before) / h)[:, None]
        rise = self.x - self.x_before
        bend_before, bend = h * self.slope_before - rise, rise - h * self.own_slope()
        values = self.x_before + s * rise
        if self.curved is None:
            self.curved = self._is_curve(rise, bend_before, bend)
        if self.curved:
            values += s * (1 - s) * ((1 - s) * bend_before + s * bend)
        values[times == self.t] = self.x
        return values

    def _is_curve(self, rise: np.ndarray, bend_before: np.ndarray, bend: np.ndarray) -> bool:
        """Return whether the slopes at the ends of the last step tell how the state has gone between them.

        Where they change it by more than it has risen, it may have turned near zero, or they belong to a transient: the
        derivative in the middle of the polynomial is the polynomial's own one, or it is not.
        """
        bends = np.abs(bend_before) + np.abs(bend)
        small = bends < np.abs(rise) + np.abs(self.x) + self.problem.atol / self.problem.rtol
        if small.all():
            return True
        h = self.t - self.before
        middle = self.x_before + rise / 2 + (bend_before + bend) / 8
        with np.errstate(all="ignore"):
            missed = h * self.derivative(self.before + h / 2, middle) - rise - (bend - bend_before) / 4
        return bool((small | (np.abs(missed) <= bends / 2)).all())
