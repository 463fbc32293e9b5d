"""The generalized-α method with steps of equal length, as codes of structural dynamics use it.

Chung and Hulbert, J. Appl. Mech. 60 (1993), in the form for equations of first order: Jansen, Whiting, Hulbert,
Comput. Methods Appl. Mech. Engrg. 190 (2000). Motion too fast for the steps is damped by the factor `RADIUS` a step.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.steps.implicit_step import ImplicitStep

PROPERTIES = Properties(
    "generalized-alpha", "generalized α", "structural dynamics", "2", "3", "own",
    stability="A", implicit=True, lengths="fixed",
    good_for="vibrating structures, whose fastest modes it damps",
)  # fmt: skip

RADIUS = 0.8  # spectral radius at infinite frequency
_MEAN = 0.5 * (3 - RADIUS) / (1 + RADIUS)  # αm
_AHEAD = 1 / (1 + RADIUS)  # αf
_GAMMA = 0.5 + _MEAN - _AHEAD


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem."""
    return GeneralizedAlpha(problem)


class GeneralizedAlpha(ImplicitStep):
    """The method at work; besides the state it carries an approximation of the derivative."""

    shift = _MEAN / (_AHEAD * _GAMMA)
    _rate: np.ndarray | None = None

    def jump(self, x: np.ndarray) -> None:
        super().jump(x)
        self._rate = None

    def advanced(self, t: float, x: np.ndarray, h: float) -> np.ndarray | None:
        rate = self.own_slope() if self._rate is None else self._rate
        fixed = x + _AHEAD * h * (1 - _GAMMA / _MEAN) * rate
        slope = self.solved(t + _AHEAD * h, fixed, h, rate)
        if slope is None:
            return None
        self._rate = (slope - (1 - _MEAN) * rate) / _MEAN
        return x + h * ((1 - _GAMMA) * rate + _GAMMA * self._rate)
