"""IDA: BDF for implicit systems, x' - f(t, x) = 0, or with the unknowns of large blocks as algebraic variables."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.steps.cvode import Multistep

PROPERTIES = Properties(
    "ida", "BDF", "BDF", "1-5", "1-5", "SUNDIALS",
    stability="A(α)", implicit=True,
    good_for="stiff systems with large blocks, which it leaves open",
)  # fmt: skip


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem.

    Raises
    ------
    NotFound
        The libraries are not at hand.
    """
    return Ida(problem)


class Ida(Multistep):
    """IDA at work."""

    def __init__(self, problem: Problem) -> None:
        from lmoc.numerics.sundials import ida

        self.opened = problem.index_one or problem.system.opened()
        super().__init__(problem, self.opened or problem.system)
        atol, mass = problem.atol, np.ones(problem.system.n)
        y = self._whole(problem.x)
        if self.opened is not None:
            atol = np.concatenate([atol, problem.rtol * np.maximum(self.opened.algebraic_size, np.abs(y[len(mass) :]))])
            mass = self.opened.differential.astype(float)
            self.evaluation = self.opened.description
        self.mass = self.arrange(mass)
        y, yp = self._consistent(y)
        given = self.given(y, self.arrange(atol), self._fill)
        compiled = None if self.opened is not None else problem.system.callback(self.order, implicit=True)
        self.session = ida.IdaSession(given, compiled or self._residual, yp, self.mass > 0)

    def _whole(self, x: np.ndarray) -> np.ndarray:
        """The states with the algebraic variables that belong to them."""
        return x if self.opened is None else self.opened.start(self.t, x)

    def _consistent(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and derivatives in the solver's order."""
        y = self.arrange(y)
        yp = np.empty_like(y)
        self.rhs(self.t, y, yp)
        return y, self.mass * yp

    def _residual(self, t: float, y: np.ndarray, yp: np.ndarray, out: np.ndarray) -> None:
        self.rhs(t, y, out)
        np.subtract(self.mass * yp, out, out=out)

    def _fill(self, t: float, y: np.ndarray, target: np.ndarray, cj: float) -> None:
        self.fill(t, y, target, -1.0, cj * self.mass)

    def jump(self, x: np.ndarray) -> None:
        self.before, self._x = self.t, x
        self.session.restart(self.t, *self._consistent(self._whole(x)))  # type: ignore[attr-defined]

    def counts(self) -> dict[str, int]:
        more = {} if self.opened is None else {"algebraic": self.opened.n - self.problem.system.n}
        return super().counts() | more
