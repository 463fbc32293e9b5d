"""Systems whose program is run step by step by numpy, and their index-1 form with large blocks laid open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.evaluate.follow import Follower
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.newton import Newton
from lmoc.numerics.evaluate.opened import open_blocks
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


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

    def opened(self) -> OpenedSystem | None:
        if not len(open_blocks(self.plan.program)[1]):
            return None
        opened = OpenedSystem(self.plan)
        opened.prepare(*self.given)
        return opened

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


class OpenedSystem(VectorSystem):
    """``x' = f(t, x, z), 0 = g(t, x, z)`` for y = (x, z); `rhs` writes (f, g).

    Attributes
    ----------
    closed : the system in which the blocks are solved, for starts
    differential : (n,) which components have derivatives
    """

    description = "numpy, index 1"
    algebraic_size = 1.0

    def __init__(self, plan: Plan) -> None:
        self.closed = VectorSystem(plan)
        program, self.algebraic, residuals = open_blocks(plan.program)
        super().__init__(
            plan,
            program,
            np.concatenate([plan.states, self.algebraic]),
            np.concatenate([plan.derivatives, residuals]),
        )
        self.differential = np.arange(self.n) < len(plan.states)

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.closed.prepare(base, signals)

    def start(self, t: float, x: np.ndarray) -> np.ndarray:
        """(x, z) with z from solving the blocks."""
        self.closed.rhs(t, x, np.empty(len(x)))
        return np.concatenate([x, self.closed.w[self.algebraic]])
