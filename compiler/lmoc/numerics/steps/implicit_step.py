"""One unknown slope a step: Newton's method for the implicit midpoint rule and its relatives."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.limits import LEFT_BY_NEWTON
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.steps.fixed_step import FixedStep
from lmoc.numerics.steps.resolvent import Resolvent

_EXACT = 1e-14  # of the states: what rounding leaves; conserved quantities are only so if the equations hold so well
_ITERATIONS = 12
_SLOW = 0.1  # ratio of two corrections from which on another Jacobian pays


class ImplicitStep(FixedStep):
    """Steps whose equations are ``k = f(t, y + h/shift·k)`` in an unknown slope k (n,)."""

    shift: float

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.resolvent = Resolvent(problem.system, np.array([self.shift]))
        self.stale = True  # the Jacobian kept is none, or converges slowly
        self.smallest = problem.atol / problem.rtol

    def solved(self, t: float, y: np.ndarray, h: float, guess: np.ndarray) -> np.ndarray | None:
        """Return the slope of a step, None where Newton's method does not find it with a Jacobian of this place."""
        fresh = False
        while True:
            if self.stale:
                self.resolvent.at(t, y)
                self.stale, fresh = False, True
            found = self._newton(t, y, h, guess) if self.resolvent.factorize(h) else None
            if found is not None or fresh:
                return found
            self.stale = True

    def _newton(self, t: float, y: np.ndarray, h: float, k: np.ndarray) -> np.ndarray | None:
        scale, last = np.abs(y) + self.smallest, np.inf
        for _ in range(_ITERATIONS):
            rest = self.derivative(t, y + h / self.shift * k) - k
            change = self.shift / h * self.resolvent.solve(0, rest)
            k = k + change
            size = float((np.abs(h * change) / scale).max())
            if size <= _EXACT or size > last / 2 and last < LEFT_BY_NEWTON:
                return k
            if not size < 2 * last:
                return None
            self.stale |= size > _SLOW * last
            last = size
        return None

    def counts(self) -> dict[str, int]:
        return super().counts() | {"jacobians": self.resolvent.evaluations}
