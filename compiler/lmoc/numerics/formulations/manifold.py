"""The closures of loops along a run: residuals, matrices, and the way back onto them.

Projection moves the coordinates to the nearest place that satisfies the closures, then the velocities to the nearest
ones that satisfy their derivatives (Eich, Convergence results for a coordinate projection method, SIAM J. Numer. Anal.
30, 1993; Hairer & Wanner, Solving Ordinary Differential Equations II, VII.2), near in the norm of the tolerances. Loops
that share no coordinate are treated apart, equal ones together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.program import program_rows
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.newton import dense_solve
from lmoc.numerics.formulations.closing import Closing, Stage, closing
from lmoc.numerics.formulations.landing import Landing, landing
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal, sample

_CHUNK = 2_000_000  # numbers held at once where many places are looked at
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
        self._interpreter = Interpreter(self.own.program, self.own.count)
        self._single = self._compiled()
        self.landing: Landing | None = landing(plan, self.base, scale)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Positions, then velocities."""
        return self.own.stages

    # ------------------------------------------------------------------ values

    def values(self, times: np.ndarray, states: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each stage the residuals (times, m) and the entries of their Jacobian (times, nnz)."""
        if self._single is not None:
            if len(times) == 1:
                return self._single(float(times[0]), states[0])
            places = zip(times.tolist(), states, strict=True)
            each = [[(r.copy(), e.copy()) for r, e in self._single(t, x)] for t, x in places]
        else:
            chunk = max(1, _CHUNK // self.own.count)
            each = [self._chunk(times[a : a + chunk], states[a : a + chunk]) for a in range(0, len(times), chunk)]
        return [tuple(map(np.concatenate, zip(*parts, strict=True))) for parts in zip(*each, strict=True)]

    def _chunk(self, times: np.ndarray, states: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        w = np.repeat(self.base[:, None], len(times), axis=1)
        w[self.plan.states] = states.T
        for register, (variable, order) in zip(self.plan.sampled.tolist(), self.plan.samplers, strict=True):
            w[register] = sample(self.signals[variable], order, times)
        self._interpreter.run(w, times)
        return [(w[s.residual].T, s.jacobian.values(w, times).T) for s in self.stages]

    def _compiled(self) -> Callable[[float, np.ndarray], list[tuple[np.ndarray, np.ndarray]]] | None:
        """Return the values at one place as a casadi function; None where the program is too large for that."""
        own, plan = self.own, self.plan
        if program_rows(own.program) > CASADI_ROWS or not can_lower(own.program):
            return None
        t, x, p = np.zeros(1), np.zeros(len(plan.states)), self.base[own.parameters]
        u = np.zeros(len(plan.sampled))
        call = Buffered(plan.once(_function), (t, x, p, u))
        results = [r[None] for r in call.results]
        pairs = list(zip(results[::2], results[1::2], strict=True))

        def values(time: float, state: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
            t[0], x[:] = time, state
            for k, (variable, order) in enumerate(plan.samplers):
                u[k] = self.signals[variable].value(time, order)
            call()
            return pairs

        return values

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

    def _correct(self, stage: Stage, residual: np.ndarray, entries: np.ndarray, x: np.ndarray) -> float:
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


def _function(plan: Plan):
    """``(t, x, p, u) -> residuals and Jacobian entries of each stage``."""
    import casadi as ca

    own = plan.once(closing)
    outputs = np.concatenate([s.residual for s in own.stages])
    low = Lowered(own.program, own.count, plan.states, own.parameters, plan.sampled, outputs)
    results, first = [], 0
    for stage in own.stages:
        residual = low.out[first : first + len(stage.residual)]
        matrix = ca.jacobian(residual, low.x)
        columns = stage.columns[stage.jacobian.columns].tolist()
        entries = [matrix[i, j] for i, j in zip(stage.jacobian.rows.tolist(), columns, strict=True)]
        results += [residual, ca.densify(ca.vertcat(*entries))]
        first += len(stage.residual)
    return ca.Function("closures", [low.time, low.x, low.p, low.u], results)
