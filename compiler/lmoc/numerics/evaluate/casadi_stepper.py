"""One step of DOP853 as one casadi function, for small systems.

It holds all sixteen stages and the error, so a step costs ten microseconds where numpy needs a hundred.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.dop853 import table
from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.problem.stepper import Stepper
from lmoc.numerics.problem.system import System

_UNROLLED = 20  # components up to which the stages are scalar operations; vector operations cost more to begin


class CasadiStepper(Stepper):
    """A system whose derivatives are a casadi function."""

    def __init__(self, system: System, rhs, p: np.ndarray) -> None:
        """
        Parameters
        ----------
        rhs : casadi function ``(t, x, p, u) -> f``
        p : parameter values, read at every step
        """
        self.system = system
        n, inputs = system.n, len(system.plan.sampled)
        self.t, self.h = np.zeros(1), np.zeros(1)
        self.x, self.f = np.zeros(n), np.zeros(n)
        self.u, self.rtol, self.atol = np.zeros((16, inputs)), np.zeros(1), np.zeros(n)
        function = step_function(rhs, n, inputs, len(p))
        self.call = Buffered(function, (self.t, self.h, self.x, self.f, p, self.u, self.rtol, self.atol))
        self.numbers, self.x_new, self.k = self.call.results
        self.k.shape = 16, n

    def start(self, t, x, rtol, atol) -> None:
        self.x[:], self.rtol[0], self.atol[:] = x, rtol, atol
        self.system.rhs(t, self.x, self.f)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        self.t[0], self.h[0] = t, h
        if self.system.samplers:
            self.system.sample_many(t + table.C * h, self.u)
        self.call()
        self.system.evaluations += 15
        error, stiffness = self.numbers.tolist()
        return error, stiffness

    def stages(self, t: float, h: float) -> np.ndarray:
        return self.k

    def accept(self) -> None:
        self.x[:] = self.x_new
        self.f[:] = self.k[12]


def step_function(rhs, n: int, inputs: int, parameters: int):
    """``(t, h, x, f, p, u, rtol, atol) -> ([error, |h·λ|], x_new, (n, 16) stages)`` as a casadi function."""
    import casadi as ca

    kind = ca.SX if n <= _UNROLLED else ca.MX
    t, h = kind.sym("t"), kind.sym("h")
    x, f, p = kind.sym("x", n), kind.sym("f", n), kind.sym("p", parameters)
    u, rtol, atol = kind.sym("u", inputs, 16), kind.sym("rtol"), kind.sym("atol", n)
    k, last = [f], x

    def combine(weights: np.ndarray):
        count = min(len(weights), len(k))
        return ca.mtimes(ca.horzcat(*k[:count]), ca.sparsify(ca.DM(weights[:count])))

    for i in range(1, 12):
        last = x + h * combine(table.A[i])
        k.append(rhs(t + float(table.C[i]) * h, last, p, u[:, i]))
    x_new = x + h * combine(table.B)
    k.append(rhs(t + h, x_new, p, u[:, 12]))
    for i in range(13, 16):
        k.append(rhs(t + float(table.C[i]) * h, x + h * combine(table.A[i]), p, u[:, i]))
    scale = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(x_new))
    e5, e3 = ca.sumsqr(combine(table.E5) / scale), ca.sumsqr(combine(table.E3) / scale)
    # no weight of the error estimates lies on the end of the step (casadi makes 0 of 0·f, whatever f is)
    finite = ca.sum1(ca.fabs(k[12])) < np.inf
    error = ca.if_else(finite, h * e5 / ca.sqrt((e5 + 0.01 * e3 + 1e-300) * n), np.nan)
    stiffness = h * ca.sqrt(ca.sumsqr(k[12] - k[11]) / (ca.sumsqr(x_new - last) + 1e-300))
    outputs = [ca.vertcat(error, stiffness), x_new, ca.horzcat(*k)]
    return ca.Function("step", [t, h, x, f, p, u, rtol, atol], [ca.densify(o) for o in outputs])
