"""Casadi functions with the values of a run, for free scenes with laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.ir.program import Program, program_rows, read, written
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, can_lower
from lmoc.numerics.plan.plan import Plan
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
