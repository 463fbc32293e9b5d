"""The implicit midpoint rule with steps of equal length: symplectic, symmetric, and stable whatever the stiffness."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.steps.implicit_step import ImplicitStep

PROPERTIES = Properties(
    "midpoint", "implicit midpoint rule", "symplectic", "2", "3", "own",
    stability="A", implicit=True, symplectic=True, lengths="fixed",
    good_for="conservative scenes, stiff or not, at low accuracy",
)  # fmt: skip


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem."""
    return Midpoint(problem)


class Midpoint(ImplicitStep):
    """The method at work (Hairer, Lubich, Wanner, Geometric Numerical Integration, II.1.1 and VI.3)."""

    shift = 2.0
    _slope: np.ndarray | None = None  # of the step before

    def advanced(self, t: float, x: np.ndarray, h: float) -> np.ndarray | None:
        guess = self.own_slope() if self._slope is None else self._slope
        self._slope = self.solved(t + h / 2, x, h, guess)
        return None if self._slope is None else x + h * self._slope
