"""One step of DOP853: what a system offers for it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from lmoc.engine.pieces import Bounds, Passing
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


class StepperWalk(Protocol):
    """The ability of a stepper to make many steps without Python between them."""

    def walk(
        self, kept: dict[str, float], given: dict[str, float | None], times: np.ndarray, out: np.ndarray
    ) -> Walked:
        """Make many steps with their output.

        Parameters
        ----------
        kept : the numbers that `Dop853` keeps between steps, by their names; they are brought up to date
        given : end, max_step, patience, most (steps and rejected ones together), hook (address of the
            ``lmoc_step_hook`` that looks at each step, None for none)
        times, out : (k,) output times ahead, (room, n) the states at the first of them
        """

    def pass_kinks(
        self,
        kept: dict[str, float],
        given: dict[str, float | None],
        bounds: Bounds,
        times: np.ndarray,
        out: np.ndarray,
        most: tuple[int, int, int],
    ) -> Passing:
        """Go on over kinks, where the last step has been accepted.

        Parameters
        ----------
        kept, given : as in `walk`
        bounds, times, out, most : as of `engine.pieces.passing`
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
    walker: StepperWalk | None = None

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
