"""One step of DOP853: what a system offers for it, and the way that any system can go, with numpy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from lmoc.numerics.integrate import dop853_table as table
from lmoc.support.records import dataclass


class RightHandSide(Protocol):
    """The interface of a system to a step."""

    n: int

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None: ...


@dataclass(frozen=True)
class Walked:
    """The outcome of a walk of many steps.

    Attributes
    ----------
    found : what C returns (``lmoc_dop853_walk``)
    steps, rejected : made
    reached : output times
    """

    found: int
    steps: int
    rejected: int
    reached: int


class Walker(Protocol):
    """The ability of a stepper to make many steps without Python between them."""

    def walk(
        self, kept: dict[str, float], given: dict[str, float | None], times: np.ndarray, out: np.ndarray
    ) -> Walked:
        """Make many steps with their output.

        Parameters
        ----------
        kept : the numbers that `Dop853` keeps between steps, by their names; they are brought up to date
        given : end, max_step, patience, most (steps and rejected ones together), hold (address of the ``lmoc_hold``
            that looks at each step, None for none)
        times, out : (k,) output times ahead, (room, n) the states at the first of them
        """


class Stepper(ABC):
    """Makes steps from (t, x).

    Attributes
    ----------
    x, f : state and derivative at the beginning of the step
    x_new : state at the end of the step tried last
    k : (16, n) derivatives at the stages of that step, as far as they are known
    walker : makes many steps without Python between them; None where it cannot
    """

    x: np.ndarray
    f: np.ndarray
    x_new: np.ndarray
    k: np.ndarray
    walker: Walker | None = None

    @abstractmethod
    def start(self, t: float, x: np.ndarray, rtol: float, atol: np.ndarray) -> None:
        """Stand at a point."""

    @abstractmethod
    def attempt(self, t: float, h: float) -> tuple[float, float]:
        """Try a step; the error (1 is what the tolerances allow) and the estimate of |h·λ|."""

    @abstractmethod
    def stages(self, t: float, h: float) -> np.ndarray:
        """Derivatives at all stages of the step just tried, those that only dense output needs among them: (16, n).

        They stand there until the next try.
        """

    @abstractmethod
    def accept(self) -> None:
        """Go to the end of the step just tried."""


class NumpyStepper(Stepper):
    """Any system."""

    def __init__(self, system: RightHandSide) -> None:
        self.system = system
        n = system.n
        self.k = np.zeros((16, n))
        self.x, self.f, self.x_new = np.zeros(n), np.zeros(n), np.zeros(n)

    def start(self, t, x, rtol, atol) -> None:
        self.x = x.copy()
        self.rtol, self.atol = rtol, atol
        self.system.rhs(t, self.x, self.f)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        k, rhs, x = self.k, self.system.rhs, self.x
        k[0] = self.f
        with np.errstate(all="ignore"):
            for i in range(1, 12):
                last = x + h * (table.A[i, :i] @ k[:i])
                rhs(t + table.C[i] * h, last, k[i])
            self.x_new = x + h * (table.B @ k[:12])
            rhs(t + h, self.x_new, k[12])
            scale = self.atol + self.rtol * np.maximum(np.abs(x), np.abs(self.x_new))
            e5 = float(((table.E5 @ k[:13] / scale) ** 2).sum())
            e3 = float(((table.E3 @ k[:13] / scale) ** 2).sum())
            error = h * e5 / np.sqrt((e5 + 0.01 * e3 + 1e-300) * len(x))
            change = float(((self.x_new - last) ** 2).sum())
            rise = float(((k[12] - k[11]) ** 2).sum())
            stiffness = h * np.sqrt(rise / change) if change > 0 else 0.0
        # the error components alone may hide a NaN at the end of the step
        return (float(error) if np.isfinite(k[12]).all() else float("nan")), float(stiffness)

    def stages(self, t: float, h: float) -> np.ndarray:
        k, x = self.k, self.x
        for i in range(13, 16):
            self.system.rhs(t + table.C[i] * h, x + h * (table.A[i, :i] @ k[:i]), k[i])
        return k

    def accept(self) -> None:
        self.x = self.x_new
        self.f = self.k[12].copy()
