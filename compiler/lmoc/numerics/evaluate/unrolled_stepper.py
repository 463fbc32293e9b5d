"""One step of DOP853 as one casadi function, for systems with Newton's iterations written out.

Each stage begins at the solution of the one before. Where one of them has not converged to a solution near by, the step
is tried again stage by stage, in the ways that `unrolled` knows then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.evaluate.stepper import NumpyStepper, RightHandSide
from lmoc.numerics.integrate import dop853_table as table
from lmoc.numerics.plan import Plan

if TYPE_CHECKING:
    import casadi


class Unrolled(RightHandSide, Protocol):
    """The part of `unrolled.UnrolledSystem` that the steps need."""

    evaluations: int

    @property
    def last_solution(self) -> np.ndarray: ...

    @property
    def read_values(self) -> np.ndarray: ...

    def stands_at(self, t: float, x: np.ndarray, solution: np.ndarray) -> None: ...


class UnrolledStepper(NumpyStepper):
    """All stages of a step in one call."""

    def __init__(self, system: Unrolled, step: casadi.Function, more: casadi.Function) -> None:
        """
        Parameters
        ----------
        step, more : from `steps_of`
        """
        super().__init__(system)
        n, unknowns = system.n, len(system.last_solution)
        self._system = system
        self._numbers, self._at, self._f = np.zeros(3), np.zeros(n), np.zeros(n)
        self._given, self._start, self._atol = system.read_values, np.zeros(unknowns), np.zeros(n)
        arguments = self._numbers, self._at, self._f, self._given, self._start, self._atol
        self._step = Buffered(step, arguments)
        self._k = np.zeros(13 * n)
        self._more = Buffered(more, (self._numbers, self._at, self._k, self._given, self._start))
        self._together = False  # whether the stages of the last step were one call

    def start(self, t, x, rtol, atol) -> None:
        super().start(t, x, rtol, atol)
        self._atol[:] = atol
        self._given[:] = self._system.read_values
        self._start[:] = self._system.last_solution

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        self._numbers[:] = t, h, self.rtol
        self._at[:], self._f[:] = self.x, self.f
        self._step()
        (error, stiffness, good), x_new, stages, _ = self._step.results
        self._together = good == 1.0
        if not self._together:
            self._system.stands_at(t, self.x, self._start)
            return super().attempt(t, h)
        self._system.evaluations += 12
        self.k[:13] = stages.reshape(13, -1)
        self.x_new = x_new.copy()
        self._end = t + h
        return float(error), float(stiffness)

    def stages(self, t: float, h: float) -> np.ndarray:
        if self._together:
            self._k[:] = self.k[:13].ravel()
            self._more()
            further, good = self._more.results
            if good[0] == 1.0:
                self._system.evaluations += 3
                self.k[13:] = further.reshape(3, -1)
                return self.k
            self._system.stands_at(t, self.x, self._start)
        return super().stages(t, h)

    def accept(self) -> None:
        super().accept()
        if self._together:
            self._start[:] = self._step.results[3]
            self._system.stands_at(self._end, self.x, self._start)
        else:
            self._start[:] = self._system.last_solution


def steps_of(function, reads: np.ndarray, writes: np.ndarray, plan: Plan) -> tuple[casadi.Function, casadi.Function]:
    """Return ``((t, h, rtol), x, f, values read, solution, atol) -> (error, |h·λ|, good), x_new, stages, solution`` and
    ``((t, h, rtol), x, 13 stages, values read, solution) -> (3 stages, good)``.

    Parameters
    ----------
    function : ``(t, values read, solution) -> (values written, solution, (good, converged))``
    reads, writes : registers of the values
    """
    import casadi as ca

    n, unknowns = len(plan.states), function.nnz_in(2)
    numbers, x, f = ca.MX.sym("numbers", 3), ca.MX.sym("x", n), ca.MX.sym("f", n)
    given, solution, atol = ca.MX.sym("given", len(reads)), ca.MX.sym("z", unknowns), ca.MX.sym("atol", n)
    t, h, rtol = ca.vertsplit(numbers)
    rhs = _of_states(function, reads, writes, plan)

    def combine(weights: np.ndarray, k: list):
        return sum(float(weights[j]) * k[j] for j in np.flatnonzero(weights).tolist())

    k, z, good, last = [f], solution, ca.MX(1), x
    for i in range(1, 12):
        last = x + h * combine(table.A[i], k)
        slope, z, fine = rhs(t + float(table.C[i]) * h, last, given, z)
        k.append(slope)
        good = good * fine
    x_new = x + h * combine(table.B, k)
    slope, z, fine = rhs(t + h, x_new, given, z)
    k.append(slope)
    scale = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(x_new))
    e5, e3 = ca.sumsqr(combine(table.E5, k) / scale), ca.sumsqr(combine(table.E3, k) / scale)
    finite = ca.sum1(ca.fabs(k[12])) < np.inf  # casadi makes 0 of 0·f, whatever f is
    error = h * e5 / ca.sqrt((e5 + 0.01 * e3 + 1e-300) * n)
    stiffness = h * ca.sqrt(ca.sumsqr(k[12] - k[11]) / (ca.sumsqr(x_new - last) + 1e-300))
    told = ca.vertcat(error, stiffness, good * fine * finite)
    step = ca.Function("step", [numbers, x, f, given, solution, atol], [told, x_new, ca.horzcat(*k), z])

    stages = ca.MX.sym("k", n, 13)
    k, z, good = ca.horzsplit(stages), solution, ca.MX(1)
    for i in range(13, 16):
        slope, z, fine = rhs(t + float(table.C[i]) * h, x + h * combine(table.A[i], k), given, z)
        k.append(slope)
        good = good * fine
    return step, ca.Function("more", [numbers, x, stages, given, solution], [ca.horzcat(*k[13:]), good])


def _of_states(function, reads: np.ndarray, writes: np.ndarray, plan: Plan) -> casadi.Function:
    """``(t, x, values read, solution) -> derivatives, solution, good``."""
    import casadi as ca

    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", len(plan.states)), ca.SX.sym("z", function.nnz_in(2))
    given = ca.SX.sym("given", len(reads))
    values = dict(zip(reads.tolist(), ca.vertsplit(given), strict=True))
    values |= zip(plan.states.tolist(), ca.vertsplit(x), strict=True)
    written, solution, told = function(t, ca.vertcat(*[values[r] for r in reads.tolist()]), z)
    values |= zip(writes.tolist(), ca.vertsplit(written), strict=True)
    slopes = ca.densify(ca.vertcat(*[values[r] for r in plan.derivatives.tolist()]))
    return ca.Function("rhs", [t, x, given, z], [slopes, solution, told[0]])
