"""One step of DOP853: with numpy, or as one casadi function for small systems.

The casadi function holds all sixteen stages and the error, so a step costs ten microseconds where numpy needs a
hundred.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.evaluate.system import CasadiSystem, System
from lmoc.numerics.integrate import dop853_table as table

_UNROLLED = 20  # components up to which the stages are scalar operations; vector operations cost more to begin


class Stepper(ABC):
    """Makes steps from (t, x).

    Attributes
    ----------
    x, f : state and derivative at the beginning of the step
    x_new : state at the end of the step tried last
    """

    x: np.ndarray
    f: np.ndarray
    x_new: np.ndarray

    @abstractmethod
    def start(self, t: float, x: np.ndarray, rtol: float, atol: np.ndarray) -> None:
        """Stand at a point."""

    @abstractmethod
    def attempt(self, t: float, h: float) -> tuple[float, float]:
        """Try a step; the error (1 is what the tolerances allow) and the estimate of |h·λ|."""

    @abstractmethod
    def stages(self, t: float, h: float) -> np.ndarray:
        """Derivatives at all stages of the step just tried, those that only dense output needs among them: (16, n).

        They stand there until the next try.
        """

    @abstractmethod
    def accept(self) -> None:
        """Go to the end of the step just tried."""


class NumpyStepper(Stepper):
    """Any system."""

    def __init__(self, system: System) -> None:
        self.system = system
        n = system.n
        self.k = np.zeros((16, n))
        self.x, self.f, self.x_new = np.zeros(n), np.zeros(n), np.zeros(n)

    def start(self, t, x, rtol, atol) -> None:
        self.x = x.copy()
        self.rtol, self.atol = rtol, atol
        self.system.rhs(t, self.x, self.f)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        k, rhs, x = self.k, self.system.rhs, self.x
        k[0] = self.f
        with np.errstate(all="ignore"):
            for i in range(1, 12):
                last = x + h * (table.A[i, :i] @ k[:i])
                rhs(t + table.C[i] * h, last, k[i])
            self.x_new = x + h * (table.B @ k[:12])
            rhs(t + h, self.x_new, k[12])
            scale = self.atol + self.rtol * np.maximum(np.abs(x), np.abs(self.x_new))
            e5 = float(((table.E5 @ k[:13] / scale) ** 2).sum())
            e3 = float(((table.E3 @ k[:13] / scale) ** 2).sum())
            error = h * e5 / np.sqrt((e5 + 0.01 * e3 + 1e-300) * len(x))
            change = float(((self.x_new - last) ** 2).sum())
            rise = float(((k[12] - k[11]) ** 2).sum())
            stiffness = h * np.sqrt(rise / change) if change > 0 else 0.0
        # the error components alone may hide a NaN at the end of the step
        return (float(error) if np.isfinite(k[12]).all() else float("nan")), float(stiffness)

    def stages(self, t: float, h: float) -> np.ndarray:
        k, x = self.k, self.x
        for i in range(13, 16):
            self.system.rhs(t + table.C[i] * h, x + h * (table.A[i, :i] @ k[:i]), k[i])
        return k

    def accept(self) -> None:
        self.x = self.x_new
        self.f = self.k[12].copy()


class CasadiStepper(Stepper):
    """A system whose derivatives are a casadi function."""

    def __init__(self, system: CasadiSystem) -> None:
        self.system = system
        n, inputs = system.n, len(system.plan.sampled)
        self.t, self.h = np.zeros(1), np.zeros(1)
        self.x, self.f = np.zeros(n), np.zeros(n)
        self.u, self.rtol, self.atol = np.zeros((16, inputs)), np.zeros(1), np.zeros(n)
        function = step_function(system.function, n, inputs, len(system.p))
        self.call = Buffered(function, (self.t, self.h, self.x, self.f, system.p, self.u, self.rtol, self.atol))
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
        return sum(float(weights[j]) * k[j] for j in np.flatnonzero(weights).tolist())

    for i in range(1, 12):
        last = x + h * combine(table.A[i])
        k.append(rhs(t + float(table.C[i]) * h, last, p, u[:, i]))
    x_new = x + h * combine(table.B)
    k.append(rhs(t + h, x_new, p, u[:, 12]))
    for i in range(13, 16):
        k.append(rhs(t + float(table.C[i]) * h, x + h * combine(table.A[i]), p, u[:, i]))
    scale = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(x_new))
    e5, e3 = ca.sumsqr(combine(table.E5) / scale), ca.sumsqr(combine(table.E3) / scale)
    # 0·Σf carries a NaN at the end of the step into the error
    poison = 0 * ca.sum1(k[12])
    error = h * e5 / ca.sqrt((e5 + 0.01 * e3 + 1e-300) * n) + poison
    stiffness = h * ca.sqrt(ca.sumsqr(k[12] - k[11]) / (ca.sumsqr(x_new - last) + 1e-300))
    outputs = [ca.vertcat(error, stiffness), x_new, ca.horzcat(*k)]
    return ca.Function("step", [t, h, x, f, p, u, rtol, atol], [ca.densify(o) for o in outputs])


def make_stepper(system: System) -> Stepper:
    """The stepper of a system; a casadi one is kept with it, because it serves many runs."""
    if system.kind == "C" and not system.samplers:
        from lmoc.numerics.evaluate.native.system import NativeStepper

        return NativeStepper(system)
    if not isinstance(system, CasadiSystem):
        return NumpyStepper(system)
    if system.stepper is None:
        system.stepper = CasadiStepper(system)
    return system.stepper
