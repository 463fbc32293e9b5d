"""Systems whose program is run step by step by numpy, and their steps of DOP853: what the engine is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.dop853 import table
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.stepper import RightHandSide, Stepper
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.solve.follow import Follower
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.newton import Newton


class Runner(Protocol):
    """A program made ready to run on a register vector many times."""

    newtons: Sequence[Newton]

    def run(self, w: np.ndarray, time: float) -> None: ...

    def reset(self) -> None: ...


class VectorSystem(System):
    """The program is run step by step by numpy."""

    description = "numpy"

    def __init__(
        self,
        plan: Plan,
        program: Program | None = None,
        inputs: np.ndarray | None = None,
        outputs: np.ndarray | None = None,
    ) -> None:
        super().__init__(plan)
        self.program = plan.program if program is None else program
        self.inputs = plan.states if inputs is None else inputs
        self.outputs = plan.derivatives if outputs is None else outputs
        self.n = len(self.inputs)
        self._follow(self._runner())
        self.w = np.full(plan.count, np.nan)
        self._derivative: Jacobian | None = None
        self._order: np.ndarray | None = None
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None
        self._u = np.zeros(len(plan.sampled))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.w[:] = base
        self.interpreter.reset()
        self.follower.forget()

    @property
    def registers(self) -> np.ndarray:
        return self.w

    def _runner(self) -> Runner:
        return Interpreter(self.program, self.plan.count)

    def restart(self) -> None:
        self.prepare(*self.given)

    def _follow(self, interpreter: Runner) -> None:
        self.interpreter = interpreter
        self.follower = Follower(interpreter.run, interpreter.newtons)

    def mark(self) -> None:
        self.follower.mark()

    def go_back(self) -> None:
        self.follower.go_back()

    def stepper(self) -> Stepper:
        return NumpyStepper(self)

    def _run(self, t: float, x: np.ndarray) -> None:
        self.w[self.inputs] = x
        if self.samplers:
            self.sample(t, self._u)
            self.w[self.plan.sampled] = self._u
        if self.follower.newtons:
            self.follower.go(self.w, t)
        else:
            self.interpreter.run(self.w, t)

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.evaluations += 1
        self._run(t, x)
        out[:] = self.w[self.outputs]

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        if self._pattern is None:
            self._derivative = Jacobian(self.program, self.inputs, self.outputs, self.plan.count)
            rows, columns = self._derivative.rows, self._derivative.columns
            self._order = np.lexsort((rows, columns))
            lengths = np.bincount(columns, minlength=self.n)
            indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
            self._pattern = indptr, rows[self._order].astype(np.int32)
        return self._pattern

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.pattern()
        self.jacobians += 1
        self._run(t, x)
        np.take(self._entries(t), self._order, out=out)

    def _entries(self, t: float) -> np.ndarray:
        """Return the entries of the Jacobian in the order of `Jacobian.rows`, for the registers as they stand."""
        return self._derivative.values(self.w, t)


class NumpyStepper(Stepper):
    """Any system."""

    def __init__(self, system: RightHandSide) -> None:
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
