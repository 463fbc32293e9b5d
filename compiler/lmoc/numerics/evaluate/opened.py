"""The index-1 form: unknowns of large blocks become algebraic variables of the integrator.

In a network of massless nodes their positions form one sparse block, in a long mechanism the accelerations and
reactions. Solved inside the right-hand side, it makes the Jacobian dense (an inverse); left open, the integrator's own
sparse Newton matrix contains it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.program import Program, Solve
from lmoc.numerics.evaluate.system import VectorSystem
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal

LARGE = 60  # unknowns of a block that is worth opening


def open_blocks(program: Program, smallest: int = LARGE) -> tuple[Program, np.ndarray, np.ndarray]:
    """The program with its large blocks replaced by their inner steps; their unknowns and residuals."""
    steps, unknowns, residuals = [], [np.zeros(0, int)], [np.zeros(0, int)]
    for step in program:
        if isinstance(step, Solve) and step.unknowns.shape[1] >= smallest:
            inner, u, r = open_blocks(step.inner, smallest)
            steps += inner
            unknowns += [step.unknowns.ravel(), u]
            residuals += [step.residuals.ravel(), r]
        else:
            steps.append(step)
    return tuple(steps), np.concatenate(unknowns), np.concatenate(residuals)


class OpenedSystem(VectorSystem):
    """``x' = f(t, x, z), 0 = g(t, x, z)`` for y = (x, z); `rhs` writes (f, g).

    Attributes
    ----------
    closed : the system in which the blocks are solved, for starts
    differential : (n,) which components have derivatives
    """

    kind = "numpy, index 1"

    def __init__(self, plan: Plan, smallest: int = LARGE) -> None:
        self.closed = VectorSystem(plan)
        program, self.unknowns, residuals = open_blocks(plan.program, smallest)
        super().__init__(
            plan,
            program,
            np.concatenate([plan.states, self.unknowns]),
            np.concatenate([plan.derivatives, residuals]),
        )
        self.differential = np.arange(self.n) < len(plan.states)

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.closed.prepare(base, signals)

    def start(self, t: float, x: np.ndarray) -> np.ndarray:
        """(x, z) with z from solving the blocks."""
        self.closed.rhs(t, x, np.empty(len(x)))
        return np.concatenate([x, self.closed.w[self.unknowns]])
