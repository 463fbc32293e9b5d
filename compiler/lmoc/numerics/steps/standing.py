"""A run without states: nothing moves, but functions of time may have roots."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Outcome, Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.steps import loop

_STEPS = 400  # looks at the functions over a run


class Standing(Integration):
    """Even steps in time."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.t = self.before = problem.t
        self.x = problem.x
        self._step = min((problem.end - problem.t) / _STEPS, problem.max_step)

    def step(self) -> Status:
        self.before = self.t
        self.t = min(self.t + self._step, self.problem.end)
        self.steps += 1
        return Status.OK

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return np.zeros((len(times), 0))

    def counts(self) -> dict[str, int]:
        return {}  # nothing is integrated

    def jump(self, x: np.ndarray) -> None:
        self.x = x


def standing(problem: Problem) -> Outcome:
    """Go to the end of a problem without states, or to its first root."""
    return loop.integrate(problem, Standing(problem))
