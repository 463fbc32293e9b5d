"""Closures as equations of an implicit solver: of index 3 as they stand, or of index 2 with their derivatives.

C. W. Gear, B. Leimkuhler and G. K. Gupta, Automatic integration of Euler-Lagrange equations with constraints, J.
Comput. Appl. Math. 12 (1985): velocities and positions both satisfy their closures, each with a multiplier. In place of
the forces in the joints the unknown multipliers are here the highest derivatives of the closures, which vanish along
the motion: one belongs to the other at each place, so that the discretized equations are the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lmoc.ir.program import needed_steps, written
from lmoc.numerics.formulations.manifold import Manifold
from lmoc.numerics.laws.select import make_system
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal


def with_multipliers(plan: Plan) -> Plan:
    """Return a plan with the highest derivatives of the closures as its last states.

    In place of their rates stand the closures of velocities.
    """
    own = plan.reduced.invariants
    free = tuple(step for step in plan.program if not np.isin(written(step), own.acceleration).any())
    count = max(own.count, plan.count)
    filled = np.concatenate([plan.states, *map(written, free)])
    program = needed_steps(plan.full_program + own.program, own.lower[0], count)
    more = tuple(step for step in program if not np.isin(written(step), [*filled, *own.acceleration]).all())
    return replace(
        plan,
        count=count,
        states=np.concatenate([plan.states, own.acceleration]),
        derivatives=np.concatenate([plan.derivatives, own.lower[0]]),
        program=free + more,
        _made={},
    )


def stabilized(plan: Plan) -> IndexTwo:
    """Return the equations of index 2 after Gear, Gupta and Leimkuhler."""
    return IndexTwo(plan, True)


def unstabilized(plan: Plan) -> IndexTwo:
    """Return the equations of index 3."""
    return IndexTwo(plan, False)


class IndexTwo:
    """``x' = f(t, x, s) - Gᵀμ, 0 = ġ, 0 = g`` for y = (x, s, μ); without stabilization ``0 = g`` in place of ``0 = ġ``.

    As `IndexOne`, although its index is 2 or 3: the solver need not know.
    """

    algebraic_size = 1e30  # Newton's method shall not wait for the multipliers

    def __init__(self, plan: Plan, stabilized: bool) -> None:
        self.plan, self.stabilized = plan, stabilized
        self.system: System = make_system(plan.once(with_multipliers))
        own = plan.reduced.invariants
        self.states, self.rates = len(plan.states), len(own.acceleration)
        self.inner = self.states + self.rates
        self.description = self.system.description
        self.position = np.flatnonzero(own.lower[1] >= 0)  # closures with a position level
        self.n = self.inner + stabilized * len(self.position)
        self.differential = np.arange(self.n) < self.states

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal], manifold: Manifold) -> None:
        """Take the parameter values and signals of a run."""
        count = self.system.plan.count
        self.system.prepare(np.concatenate([base, np.full(count - len(base), np.nan)]), signals)
        self.manifold = manifold
        own, stage = self.plan.reduced.invariants, manifold.stages[0]
        number = {int(r): i for i, r in enumerate(own.lower[1, self.position])}
        self.row = np.array([number.get(int(r), -1) for r in stage.residual], int)
        jacobian = stage.jacobian
        self.entry_row, self.entry_column = self.row[jacobian.rows], stage.columns[jacobian.columns]
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None

    def start(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (x, 0): along the motion all multipliers vanish."""
        return np.concatenate([x, np.zeros(self.n - self.states)])

    def rhs(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        inner = y[: self.inner].copy()
        found = np.empty(self.inner)
        self.system.rhs(t, inner, found)
        out[: self.inner] = found
        if not len(self.position):
            return
        residual, entries = (a[0] for a in self.manifold.values(np.array([t]), y[None, : self.states])[0])
        if not self.stabilized:
            out[self.states + self.position[self.row]] = residual
            return
        out[self.inner + self.row] = residual
        force = np.bincount(self.entry_column, entries * y[self.inner + self.entry_row], self.states)
        out[: self.states] -= force * self.manifold.scale**2

    # ------------------------------------------------------------------ the Jacobian

    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of all entries, and which of the system's are kept."""
        indptr, row = self.system.pattern()
        column = np.repeat(np.arange(self.inner), np.diff(indptr))
        if not len(self.position):
            return row, column, np.ones(len(row), bool)
        if self.stabilized:
            kept = np.ones(len(row), bool)
            rows = [row, self.inner + self.entry_row, self.entry_column]
            columns = [column, self.entry_column, self.inner + self.entry_row]
        else:
            replaced = np.zeros(self.inner, bool)
            replaced[self.states + self.position] = True
            kept = ~replaced[row]
            rows = [row[kept], self.states + self.position[self.entry_row]]
            columns = [column[kept], self.entry_column]
        return np.concatenate(rows), np.concatenate(columns), kept

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        if self._pattern is None:
            row, column, self._kept = self._entries()
            self._order = np.lexsort((row, column))
            indptr = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=self.n))])
            self._pattern = indptr.astype(np.int32), row[self._order].astype(np.int32)
        return self._pattern

    def jacobian_values(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        """Second derivatives of the closures, times multipliers that vanish, are left out."""
        self.pattern()
        own = np.empty(len(self._kept))
        self.system.jacobian_values(t, y[: self.inner].copy(), own)
        entries = self.manifold.values(np.array([t]), y[None, : self.states])[0][1][0]
        parts = [own[self._kept]] + ([entries] if len(self.position) else [])
        if self.stabilized and len(self.position):
            parts.append(-entries * self.manifold.scale[self.entry_column] ** 2)
        out[:] = np.concatenate(parts)[self._order]
