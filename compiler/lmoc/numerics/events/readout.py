"""Some registers of a plan as a function of time and state, for discrete values that change from call to call."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.program import Program, needed_steps, program_rows, read, written
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.observe.slices import Slice
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


class Readout:
    """Values of registers; one casadi function where the program is small and explicit, else numpy.

    Parameters
    ----------
    program, count : what fills the registers, among how many
    """

    def __init__(self, plan: Plan, program: Program, count: int, registers: np.ndarray) -> None:
        program = needed_steps(program, registers, count)
        self.plan, self.size = plan, len(registers)
        self._call: Buffered | None = None
        self._slice: Slice | None = None
        if not len(registers):
            return
        if can_lower(program) and program_rows(program) <= CASADI_ROWS:
            self._lower(program, count, registers)
        else:
            self._slice = Slice(plan, registers, program, count)

    def _lower(self, program: Program, count: int, registers: np.ndarray) -> None:
        plan = self.plan
        given = np.zeros(count, bool)
        given[registers] = True
        for step in program:
            given[read(step)] = True
        for filled in (plan.states, plan.sampled, *map(written, program)):
            given[filled] = False
        self._parameters = np.flatnonzero(given)
        lowered = Lowered(program, count, plan.states, self._parameters, plan.sampled, registers)
        self._t, self._x = np.zeros(1), np.zeros(len(plan.states))
        self._p, self._u = np.zeros(len(self._parameters)), np.zeros(len(plan.sampled))
        self._call = Buffered(lowered.function("readout"), (self._t, self._x, self._p, self._u))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers (count,) that do not change between events, and the inputs."""
        if self._call is not None:
            self._p[:] = base[self._parameters]
            self._samplers = [(signals[v], order) for v, order in self.plan.samplers]
        elif self._slice is not None:
            self._evaluate = self._slice.bind(base, signals)

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values; a view that the next call overwrites."""
        if self._call is not None:
            self._t[0] = t
            self._x[:] = x
            for k, (signal, order) in enumerate(self._samplers):
                self._u[k] = signal.value(t, order)
            self._call()
            return self._call.results[0]
        if self._slice is not None:
            return self._evaluate(np.array([t]), x[None])[0]
        return np.zeros(0)
