"""The closures of loops along a run: residuals, matrices, and the way back onto them.

Projection moves the coordinates to the nearest place that satisfies the closures, then the velocities to the nearest
ones that satisfy their derivatives (Eich, Convergence results for a coordinate projection method, SIAM J. Numer. Anal.
30, 1993; Hairer & Wanner, Solving Ordinary Differential Equations II, VII.2), near in the norm of the tolerances. Loops
that share no coordinate are treated apart, equal ones together.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.lower.tape import Tape
from lmoc.numerics.evaluate.function import TapeFunction
from lmoc.numerics.formulations.closing import Closing, ClosureStage, closing
from lmoc.numerics.formulations.landing import Landing, landing, stage_tapes
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.solve.newton import dense_solve

_CORRECTIONS = 10
_SMALL = 1e-9  # of the size of a coordinate: a correction behind which nothing is left to correct


class Manifold:
    """The closures for the parameter values and signals of one run."""

    def __init__(self, plan: Plan, base: np.ndarray, signals: Mapping[int, Signal], scale: np.ndarray) -> None:
        """
        Parameters
        ----------
        scale : (n,) sizes of the states, in which their changes are compared
        """
        self.plan, self.signals, self.scale = plan, signals, scale
        self.own: Closing = plan.once(closing)
        self.base = np.concatenate([base, np.full(self.own.count - len(base), np.nan)])
        self._calls = [self._call(s, t) for s, t in zip(self.stages, plan.once(stage_tapes), strict=True)]
        self.landing: Landing | None = landing(plan, self.base, scale)

    @property
    def stages(self) -> tuple[ClosureStage, ...]:
        """Positions, then velocities."""
        return self.own.stages

    # ------------------------------------------------------------------ values

    def values(self, times: np.ndarray, states: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each stage the residuals (times, m) and the entries of their Jacobian (times, nnz)."""
        found = [call.many(times, states) for call in self._calls]
        entries = [len(s.jacobian.source) for s in self.stages]
        return [(own[:, n:], own[:, :n]) for own, n in zip(found, entries, strict=True)]

    def _call(self, stage: ClosureStage, tape: Tape) -> TapeFunction:
        """Return the entries and residuals of a stage."""
        call = TapeFunction(tape, self.plan, np.concatenate([tape.results, stage.residual]))
        call.prepare(self.base, self.signals)
        return call

    def residuals(self, times: np.ndarray, states: np.ndarray) -> tuple[float, float]:
        """Return the largest residuals of positions and of velocities."""
        found = dict.fromkeys((2, 1), 0.0)
        for stage, (residual, _) in zip(self.stages, self.values(times, states), strict=True):
            k = 2 if stage is self.stages[0] and len(self.stages) > 1 else 1
            found[k] = float(np.abs(residual).max(initial=0.0))
        return found[2], found[1]

    # ------------------------------------------------------------------ projection

    def project(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the states moved onto the closures, positions before velocities; NaN where that does not converge."""
        x = states.copy()
        if self.landing is not None and self.landing.land(times, x):
            return x
        x[:] = states
        with np.errstate(all="ignore"):
            for k, stage in enumerate(self.stages):
                for _ in range(_CORRECTIONS):
                    if not self._correct(stage, *self.values(times, x)[k], x) > _SMALL:
                        break
                else:
                    x[:] = np.nan
        return x

    def _correct(self, stage: ClosureStage, residual: np.ndarray, entries: np.ndarray, x: np.ndarray) -> float:
        """Make one correction of Newton's method; return the largest, in sizes of the coordinates."""
        largest = 0.0
        for own in stage.loops:
            scale = self.scale[own.columns]
            move = shortest(own.matrices(entries) * scale[:, None, :], residual[:, own.rows]) * scale
            x[:, own.columns] -= move
            largest = max(largest, float((np.abs(move) / np.maximum(np.abs(x[:, own.columns]), scale)).max()))
        return largest


def shortest(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the shortest solutions (…, n) of ``matrix·x = right`` for matrices (…, m, n) of full rank.

    By the normal equations of the second kind with rows of one length, which lose twice the digits that the condition
    costs: Newton's corrections do not need more.
    """
    size = np.sqrt(np.einsum("...ij,...ij->...i", matrix, matrix))
    rows, right = matrix / size[..., None], right / size
    if rows.shape[-2] == 1:
        return rows[..., 0, :] * right
    product = rows @ np.swapaxes(rows, -1, -2)
    return (np.swapaxes(dense_solve(product, right[..., None]), -1, -2) @ rows)[..., 0, :]
