"""The classical Runge–Kutta method of order 4 with steps of equal length, for comparisons."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.steps.fixed_step import FixedStep

PROPERTIES = Properties(
    "rk4", "Runge–Kutta", "explicit Runge–Kutta", "4", "3", "own",
    lengths="fixed",
    good_for="comparisons",
)  # fmt: skip


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem."""
    return Rk4(problem)


class Rk4(FixedStep):
    """The method at work (Kutta, Beitrag zur näherungsweisen Integration totaler Differentialgleichungen, 1901)."""

    def advanced(self, t: float, x: np.ndarray, h: float) -> np.ndarray:
        k1 = self.own_slope()
        k2 = self.derivative(t + h / 2, x + h / 2 * k1)
        k3 = self.derivative(t + h / 2, x + h / 2 * k2)
        k4 = self.derivative(t + h, x + h * k3)
        return x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
