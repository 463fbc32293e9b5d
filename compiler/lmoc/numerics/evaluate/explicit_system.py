"""Systems whose derivatives are one explicit casadi function: the way of small scenes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.numerics.evaluate.casadi_stepper import CasadiStepper
from lmoc.numerics.evaluate.casadi_system import Buffered, Lowered
from lmoc.numerics.evaluate.stepper import Stepper
from lmoc.numerics.evaluate.system import CasadiDAE, System
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


class CasadiSystem(System):
    """All derivatives are one casadi function."""

    description = "casadi"
    most_steps = 5_000

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.lowered = Lowered(plan.program, plan.count, plan.states, plan.parameters, plan.sampled, plan.derivatives)
        self.function = self.lowered.function()
        self.t, self.x = np.zeros(1), np.zeros(self.n)
        self.p, self.u = np.zeros(len(plan.parameters)), np.zeros(len(plan.sampled))
        self._rhs = Buffered(self.function, (self.t, self.x, self.p, self.u))
        self._jacobian: Buffered | None = None
        self._stepper: CasadiStepper | None = None
        self._dae: CasadiDAE | None = None

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.p[:] = base[self.plan.parameters]

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.evaluations += 1
        self.t[0] = t
        self.x[:] = x
        if self.samplers:
            self.sample(t, self.u)
        self._rhs()
        out[:] = self._rhs.results[0]

    def _buffered_jacobian(self) -> Buffered:
        if self._jacobian is None:
            self._jacobian = Buffered(self.lowered.jacobian(), self._rhs.arguments)
        return self._jacobian

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        sparsity = self._buffered_jacobian().function.sparsity_out(0)
        return np.array(sparsity.colind(), np.int32), np.array(sparsity.row(), np.int32)

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.jacobians += 1
        call = self._buffered_jacobian()
        self.t[0] = t
        self.x[:] = x
        if self.samplers:
            self.sample(t, self.u)
        call()
        out[:] = call.results[0]

    def stepper(self) -> Stepper:
        if self._stepper is None:  # kept, since it serves many runs
            self._stepper = CasadiStepper(self, self.function, self.p)
        return self._stepper

    def casadi_dae(self) -> CasadiDAE | None:
        if self.samplers:
            return None
        if self._dae is None:
            lowered = self.lowered
            equations = {"t": lowered.time, "x": lowered.x, "p": lowered.p, "ode": lowered.out}
            self._dae = CasadiDAE(equations, self.p)
        return self._dae
