"""Some registers of a plan as a function of time and state, for discrete values that change from call to call."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.engine.accelerator import TapeAccelerator
from lmoc.ir.program import Program, Solve, needed_steps, walk
from lmoc.lower.blocks import values_tape
from lmoc.numerics.evaluate.engine_system import EngineSystem, has_branches
from lmoc.numerics.evaluate.function import TapeFunction
from lmoc.numerics.observe.slices import Evaluate, Slice
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal


class Readout:
    """Values of registers; where nonlinear blocks of mechanisms are followed, by slices.

    Parameters
    ----------
    program, count : what fills the registers, among how many
    """

    def __init__(self, plan: Plan, program: Program, count: int, registers: np.ndarray) -> None:
        program = needed_steps(program, registers, count)
        self.plan, self.size, self._registers = plan, len(registers), registers
        self._function: TapeFunction | None = None
        self._slice: Slice | None = None
        self._solved: _Solved | None = None
        if not len(registers):
            return
        if all(step.linear for step in walk(program) if isinstance(step, Solve)):
            self._tape = values_tape(program, count)
            self._function = self._bound()
        elif has_branches(plan):
            self._slice = Slice(plan, registers, program, count)
        else:
            self._program, self._count = program, count
            self._accelerator = TapeAccelerator(values_tape(program, count))
            self._solved = self._solver()

    def _bound(self) -> TapeFunction:
        return TapeFunction(self._tape, self.plan, self._registers)

    def _solver(self) -> _Solved:
        return _Solved(self.plan, self._program, self._registers, self._accelerator)

    def bind(self, base: np.ndarray, signals: Mapping[int, Signal]) -> Evaluate:
        """Return ``(times, states) -> (times, registers)`` with the values of a run."""
        return self.binder()(base, signals)

    def binder(self) -> Callable[[np.ndarray, Mapping[int, Signal]], Evaluate]:
        """Return `bind` for pieces of one run that follow each other: what it has returned last counts, no other."""
        if self._slice is not None:
            return self._slice.bind
        if not self.size:
            return lambda base, signals: lambda times, states, known=None: np.zeros((len(times), 0))
        if self._solved is not None:
            return self._solver().bind
        function = self._bound()

        def bind(base: np.ndarray, signals: Mapping[int, Signal]) -> Evaluate:
            function.prepare(base, signals)
            return function.many

        return bind

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers (count,) that do not change between events, and the inputs."""
        if self._function is not None:
            self._function.prepare(base, signals)
        elif self._solved is not None:
            self._evaluate = self._solved.bind(base, signals)
        elif self._slice is not None:
            self._evaluate = self._slice.bind(base, signals)

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values."""
        if self._function is not None:
            return self._function(t, x)
        if self.size:
            return self._evaluate(np.array([t]), x[None])[0]
        return np.zeros(0)


class _Solved:
    """Registers behind nonlinear blocks, solved in C from the last solution, of an earlier piece too."""

    def __init__(self, plan: Plan, program: Program, registers: np.ndarray, accelerator: TapeAccelerator) -> None:
        outputs = np.concatenate([registers, plan.states])  # a system has no fewer outputs than states
        self._system, self._size = EngineSystem(plan, program, plan.states, outputs, accelerator), len(registers)

    def bind(self, base: np.ndarray, signals: Mapping[int, Signal]) -> Evaluate:
        """As `Readout.bind`."""
        system = self._system
        unknowns = system.kernel.unknowns
        last = system.w[unknowns].copy()
        count = system.plan.count
        own = base[:count], signals
        system.w[count : len(base)] = base[count:]  # what is given beside a plan's registers: rates that jump
        system.prepare(*own)
        solved = np.isfinite(last)
        system.w[unknowns[solved]] = last[solved]

        def evaluate(times: np.ndarray, states: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
            found = np.empty((len(times), len(system.outputs)))
            for t, x, out in zip(times.tolist(), states, found, strict=True):
                system.rhs(t, x, out)
                if not np.isfinite(out).all():
                    system.prepare(*own)
                    system.rhs(t, x, out)
            return np.ascontiguousarray(found[:, : self._size])

        return evaluate


def readout_of(plan: Plan, registers: np.ndarray) -> Readout:
    """Return the values of some registers of a plan, made once."""
    kept, key = plan.once(_kept), registers.tobytes()
    if key not in kept:
        kept[key] = Readout(plan, plan.full_program, plan.count, registers)
    return kept[key]


def _kept(_: Plan) -> dict[bytes, Readout]:
    """Return where the readouts of a plan are kept, by their registers."""
    return {}
