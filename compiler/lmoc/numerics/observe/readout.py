"""Some registers of a plan as a function of time and state, for discrete values that change from call to call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.ir.program import Program, needed_steps, program_rows, read, written
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.observe.slices import Evaluate, Slice
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


def fits_casadi(program: Program) -> bool:
    """Return whether a program is short and explicit enough for one casadi function."""
    return can_lower(program) and program_rows(program) <= CASADI_ROWS


def given_registers(program: Program, count: int, plan: Plan, registers: np.ndarray) -> np.ndarray:
    """Return which registers a program reads, or are requested, and nothing fills: they stay as they are."""
    given = np.zeros(count, bool)
    given[registers] = True
    for step in program:
        given[read(step)] = True
    for filled in (plan.states, plan.sampled, *map(written, program)):
        given[filled] = False
    return np.flatnonzero(given)


class BoundFunction:
    """A casadi function of time, states, parameters and inputs, with the values of a run.

    Parameters
    ----------
    function : ``(t, x, p, u) -> results``
    parameters : registers of p
    samplers : (variable, order) of u
    states : number of components of x
    """

    def __init__(self, function, parameters: np.ndarray, samplers: Sequence[tuple[int, int]], states: int) -> None:
        self.parameters, self._inputs = parameters, samplers
        self._t, self._x = np.zeros(1), np.zeros(states)
        self._p, self._u = np.zeros(len(parameters)), np.zeros(len(samplers))
        self._samplers: list[tuple[Signal, int]] = []
        self._call = Buffered(function, (self._t, self._x, self._p, self._u))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers (count,) that do not change between events, and the inputs."""
        self._p[:] = base[self.parameters]
        self._samplers = [(signals[v], order) for v, order in self._inputs]

    def __call__(self, t: float, x: np.ndarray) -> list[np.ndarray]:
        """Return the results; views that the next call overwrites."""
        self._t[0] = t
        self._x[:] = x
        for k, (signal, order) in enumerate(self._samplers):
            self._u[k] = signal.value(t, order)
        self._call()
        return self._call.results

    def many(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the first result at several times, (times, size)."""
        found = np.empty((len(times), len(self._call.results[0])))
        for row, t, x in zip(found, times.tolist(), states):
            row[:] = self(t, x)[0]
        return found


class Readout:
    """Values of registers; one casadi function where the program is small and explicit, else numpy.

    Parameters
    ----------
    program, count : what fills the registers, among how many
    """

    def __init__(self, plan: Plan, program: Program, count: int, registers: np.ndarray) -> None:
        program = needed_steps(program, registers, count)
        self.plan, self.size = plan, len(registers)
        self._function = None
        self._slice: Slice | None = None
        if not len(registers):
            return
        if fits_casadi(program):
            self._parameters = given_registers(program, count, plan, registers)
            lowered = Lowered(program, count, plan.states, self._parameters, plan.sampled, registers)
            self._function = lowered.function("readout")
            self._call = self._bound()
        else:
            self._slice = Slice(plan, registers, program, count)

    def _bound(self) -> BoundFunction:
        return BoundFunction(self._function, self._parameters, self.plan.samplers, len(self.plan.states))

    def bind(self, base: np.ndarray, signals: Mapping[int, Signal]) -> Evaluate:
        """Return ``(times, states) -> (times, registers)`` with the values of a run."""
        if self._function is None:
            return self._slice.bind(base, signals)
        bound = self._bound()
        bound.prepare(base, signals)
        return bound.many

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers (count,) that do not change between events, and the inputs."""
        if self._function is not None:
            self._call.prepare(base, signals)
        elif self._slice is not None:
            self._evaluate = self._slice.bind(base, signals)

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values; a view that the next call overwrites."""
        if self._function is not None:
            return self._call(t, x)[0]
        if self._slice is not None:
            return self._evaluate(np.array([t]), x[None])[0]
        return np.zeros(0)


def readout_of(plan: Plan, registers: np.ndarray) -> Readout:
    """Return the values of some registers of a plan, made once."""
    kept, key = plan.once(_kept), registers.tobytes()
    if key not in kept:
        kept[key] = Readout(plan, plan.full_program, plan.count, registers)
    return kept[key]


def _kept(_: Plan) -> dict[bytes, Readout]:
    """Return where the readouts of a plan are kept, by their registers."""
    return {}
