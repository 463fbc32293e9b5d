"""Systems whose program is compiled C, and DOP853's step in C for them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from lmoc.numerics.evaluate.native.kernel import Kernel
from lmoc.numerics.evaluate.stepper import NumpyStepper, Stepper
from lmoc.numerics.evaluate.vector_system import VectorSystem
from lmoc.numerics.integrate import dop853_table as table
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


class NativeSystem(VectorSystem):
    """The program is one compiled loop a step; Jacobians come from numpy, which is asked for them rarely."""

    description = "C"

    def __init__(self, plan: Plan) -> None:
        """
        Raises
        ------
        native.c_code.Unsupported
            The program has a block that is not written as C.
        OSError
            There is no compiler.
        """
        kernel = Kernel(plan.program, plan.count)
        super().__init__(plan)
        self.kernel = kernel
        self.w = kernel.w[: plan.count]

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.kernel.factorize(lambda step: self.interpreter.sparse_matrix(step, self.w, np.nan))

    def _run(self, t: float, x: np.ndarray) -> None:
        self.w[self.plan.states] = x
        if self.samplers:
            self.sample(t, self._u)
            self.w[self.plan.sampled] = self._u
        self.kernel(t)

    def callback(self, order: np.ndarray | None):
        """The right-hand side as SUNDIALS calls it, for states in a new order; None if inputs are asked from Python."""
        if self.samplers:
            return None
        states, derivatives = self.plan.states, self.plan.derivatives
        if order is not None:
            states, derivatives = states[order], derivatives[order]
        return self.kernel.callback(states, derivatives)

    def stepper(self) -> Stepper:
        return NumpyStepper(self) if self.samplers else NativeStepper(self)


class NativeStepper(Stepper):
    """All stages of a step in one C call."""

    def __init__(self, system: NativeSystem) -> None:
        n = system.n
        self.system = system
        self.x, self.f, self.x_new, self.last = (np.zeros(n) for _ in range(4))
        self.k, self.atol = np.zeros((16, n)), np.zeros(n)
        self.result = np.zeros(2)
        self.table, self.times = _weights(), np.ascontiguousarray(table.C)
        self._call = system.kernel.call(system.plan.states, system.plan.derivatives)
        library = system.kernel.library
        self._attempt, self._more = library.lmoc_dop853_attempt, library.lmoc_dop853_more
        real, pointer = ctypes.c_double, ctypes.c_void_p
        self._attempt.argtypes = [pointer, real, real, real, *[pointer] * 8]
        self._more.argtypes = [pointer, real, real, *[pointer] * 5]
        self._attempt.restype = self._more.restype = None

    def start(self, t, x, rtol, atol) -> None:
        self.x[:], self.atol[:], self.rtol = x, atol, float(rtol)
        self.system.rhs(t, self.x, self.f)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        k = self.k
        k[0] = self.f
        arrays = (self.table, self.times, self.x, self.atol, k, self.x_new, self.last, self.result)
        self._attempt(ctypes.byref(self._call), t, h, self.rtol, *(a.ctypes.data for a in arrays))
        self.system.evaluations += 12
        error, stiffness = self.result.tolist()
        return error, stiffness

    def stages(self, t: float, h: float) -> np.ndarray:
        arrays = (self.table, self.times, self.x, self.k, self.last)
        self._more(ctypes.byref(self._call), t, h, *(a.ctypes.data for a in arrays))
        self.system.evaluations += 3
        return self.k

    def accept(self) -> None:
        self.x, self.x_new = self.x_new, self.x
        self.f[:] = self.k[12]


@lru_cache(maxsize=1)
def _weights() -> np.ndarray:
    """(19, 16) the coefficients of the 16 stages, then those of the new state and of the two error estimates."""
    rows = [*table.A, table.B, table.E5, table.E3]
    return np.array([np.pad(row, (0, 16 - len(row))) for row in rows])
