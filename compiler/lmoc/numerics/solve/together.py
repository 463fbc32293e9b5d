"""A program at many times at once, its nonlinear blocks too: where a first guess is known near each solution.

Along a trajectory the solutions at the ends of the steps are known, and those in between lie near the straight line
between them. So Newton's method need not go from one time to the next; where it does not converge to a solution near
its first guess, the caller has to.
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program, Solve
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.newton import LOOSE, NEAR, TIGHT, dense_solve

_ITERATIONS = 10
_RATE = 0.5  # by which each correction has to be shorter than the one before


class Together(Interpreter):
    """A program at many times at once."""

    def fill(self, w: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Fill w (registers, times), where the unknowns of nonlinear blocks stand as first guesses.

        Returns
        -------
        (times,) where solutions near the guesses have been found for all blocks; at other times nothing in w counts.
        """
        self._good = np.ones(len(times), bool)
        with np.errstate(all="ignore"):
            self.steps(self.program, w, times)
        return self._good

    def steps(self, program: Program, w: np.ndarray, time: float | np.ndarray) -> None:
        for step in program:
            if isinstance(step, Solve) and not step.linear:
                self._good &= self._solve(step, w, time)
                super().steps(step.inner, w, time)
            else:
                super().steps((step,), w, time)

    def _solve(self, step: Solve, w: np.ndarray, time: float | np.ndarray) -> np.ndarray:
        """Newton's method at all times; (times,) where it has converged nearby."""
        block = self._blocks[id(step)]
        start = target = w[step.unknowns]
        before, left = np.full(start.shape[2], np.inf), np.isfinite(start).all(axis=(0, 1))
        good = np.zeros(len(left), bool)
        for iteration in range(_ITERATIONS):
            super().steps(step.inner, w, time)
            residual = np.moveaxis(w[step.residuals], 2, 1)
            change = -np.moveaxis(dense_solve(block.matrix(w, time), residual[..., None])[..., 0], 1, 2)
            length, size = np.abs(change).max(axis=(0, 1)), 1.0 + np.abs(w[step.unknowns]).max(axis=(0, 1))
            stays = (length <= LOOSE * size) & (length > _RATE * before)
            left &= (length <= _RATE * before) | stays  # NaN ends it
            w[step.unknowns] += np.where(left & ~stays, change, 0.0)
            if not iteration:
                target = w[step.unknowns]
            good |= left & (stays | (length <= TIGHT * size))
            left &= ~good
            if not left.any():
                break
            before = length
        found = w[step.unknowns]
        size, way = 1.0 + np.abs(found), np.abs(found - start)
        missed = np.abs(found - target).max(axis=(0, 1))
        near = (missed <= NEAR * way.max(axis=(0, 1)) + LOOSE * size.max(axis=(0, 1))) & (way <= NEAR * size).all(
            (0, 1)
        )
        return good & near
