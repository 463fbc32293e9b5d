"""Second-order forward differentiation: functions of coordinates with their gradient and Hessian at one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Jet:
    """A function of the coordinates at one point: value, gradient, Hessian."""

    value: float
    slope: np.ndarray
    bend: np.ndarray

    @classmethod
    def coordinates(cls, x: np.ndarray) -> list[Jet]:
        """The coordinates themselves."""
        n = len(x)
        return [cls(float(x[i]), np.eye(n)[i], np.zeros((n, n))) for i in range(n)]

    def __add__(self, other):
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.slope, self.bend)
        return Jet(self.value + other.value, self.slope + other.slope, self.bend + other.bend)

    def __sub__(self, other):
        return self + (-1.0) * other

    def __mul__(self, other: Jet) -> Jet:
        cross = np.outer(self.slope, other.slope)
        bend = self.value * other.bend + other.value * self.bend + cross + cross.T
        return Jet(self.value * other.value, self.value * other.slope + other.value * self.slope, bend)

    def __rmul__(self, factor: float):
        return Jet(factor * self.value, factor * self.slope, factor * self.bend)

    def sin(self):
        s, c = np.sin(self.value), np.cos(self.value)
        return Jet(s, c * self.slope, c * self.bend - s * np.outer(self.slope, self.slope))

    def cos(self):
        return (self + np.pi / 2).sin()
