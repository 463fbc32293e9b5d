"""Systems whose program is compiled C."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.native.kernel import Call, Kernel, Source
from lmoc.numerics.evaluate.native.stepper import NativeStepper
from lmoc.numerics.evaluate.newton import Retries
from lmoc.numerics.evaluate.stepper import NumpyStepper, Stepper
from lmoc.numerics.evaluate.system import InC
from lmoc.numerics.evaluate.vector_system import Runner, VectorSystem
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal

if TYPE_CHECKING:
    from lmoc.numerics.evaluate.native.slopes import Slopes


# Jacobians of a piece of a run that are computed by numpy, before the next ones are in C: an implicit method asks for
# many. For that of Andrews' mechanism numpy takes 5.8 ms and C 11 µs; its text takes 9 ms, the compiler 1.2 s, once.
_BY_NUMPY = 3
_SLOPE_ROWS = 5_000  # of a program with so many rows at the most


def has_branches(plan: Plan) -> bool:
    """Return whether nonlinear blocks are constraints of a mechanism, which can be closed in several ways."""
    return plan.reduced.guess is not None


class _Late:
    """The same program run by numpy: made when it is needed."""

    newtons = ()  # none that Python has to follow

    def __init__(self, program: Program, count: int) -> None:
        self._made: Interpreter | None = None
        self._program, self._count = program, count

    @property
    def interpreter(self) -> Interpreter:
        if self._made is None:
            self._made = Interpreter(self._program, self._count)
        return self._made

    def run(self, w: np.ndarray, time: float) -> None:
        self.interpreter.run(w, time)

    def reset(self) -> None:
        if self._made is not None:
            self._made.reset()


class NativeSystem(VectorSystem):
    """The program is compiled, blocks included; the first Jacobians come from numpy, the others are compiled, too.

    Python takes part where C does not find the solution of a nonlinear block: at a start, whose guesses may be far off,
    and where the matrix is singular at the solution.
    """

    description = "engine"

    def __init__(self, plan: Plan, source: Source | None = None) -> None:
        """
        Parameters
        ----------
        source : of the plan's program, where it has been written already

        Raises
        ------
        native.c_code.Unsupported
            The program has a block that is not written as C.
        OSError
            There is no compiler.
        """
        self.kernel = Kernel(plan.program, plan.count, has_branches(plan), source)
        super().__init__(plan)
        self.w = self.kernel.w[: plan.count]
        self._x = np.zeros(len(plan.states) + len(plan.sampled))
        self._own = self._call(np.arange(len(plan.states)))
        self._seeds = np.zeros(0)
        self._retries = Retries()
        self._slopes: Slopes | None = None
        self._requested = 0  # Jacobians since it was prepared
        self._in_c: InC | None = None

    def _runner(self) -> Runner:
        return _Late(self.plan.program, self.plan.count)

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.kernel.forget()
        if self._slopes is not None:
            self._slopes.forget()
        self._requested = 0
        self._retries = Retries()
        self._seeds = self.w[self.kernel.unknowns]
        if self.kernel.has_constant_blocks:
            own: Any = self.interpreter  # numpy, beside the compiled code
            self.kernel.factorize(lambda step: own.interpreter.sparse_matrix(step, self.w, np.nan))

    @property
    def unknowns(self) -> np.ndarray:
        return np.concatenate([np.zeros(0, int), *(s.unknowns[:, 0] for s in self.kernel.nonlinear)])

    def determinants(self) -> np.ndarray:
        return self.kernel.determinants()

    def _call(self, order: np.ndarray) -> Call:
        given = np.concatenate([self.plan.states[order], self.plan.sampled])
        return self.kernel.call(given, self.plan.derivatives[order], self._rescue)

    def _run(self, t: float, x: np.ndarray) -> None:
        self._x[: self.n] = x
        if self.samplers:
            self.sample(t, self._x[self.n :])
        if not self.kernel.evaluate(self._own, t, self._x):
            self.w[self.plan.derivatives] = np.nan

    def _rescue(self, time: float) -> bool:
        """Take damped steps from where C has come to; not where that might lead to another branch.

        Nor from states that an attempt without a solution has made NaN, nor where that has been in vain just before.
        """
        w, unknowns = self.w, self.kernel.unknowns
        if self._own.solved and (has_branches(self.plan) or not self._retries.due(self.evaluations)):
            return False
        if not np.isfinite(w[self.plan.states]).all():
            return False
        w[unknowns] = np.where(np.isfinite(w[unknowns]), w[unknowns], self._seeds)
        self.interpreter.reset()
        self.interpreter.run(w, time)
        found = bool(np.isfinite(w[unknowns]).all())
        self._retries.note(found, self.evaluations)
        return found

    def compiled_slopes(self) -> Slopes:
        """Return the Jacobian in C.

        Raises
        ------
        OSError
            The compiler refuses it.
        """
        from lmoc.numerics.evaluate.native.slopes import Slopes

        if self._slopes is None:
            self.pattern()
            self._slopes = Slopes(self.plan.program, self._derivative, self.plan.count)
        return self._slopes

    def _slopes_in_use(self) -> Slopes | None:
        """Return the Jacobian in C; None as long as few have been asked for, and of large programs."""
        self._requested += 1
        if self._requested <= _BY_NUMPY or self.plan.row_count > _SLOPE_ROWS:
            return None
        try:
            return self.compiled_slopes()
        except OSError:
            return None

    def _entries(self, t: float) -> np.ndarray:
        slopes = self._slopes_in_use()
        if slopes is not None:
            found = slopes(self.w, t)
            if np.isfinite(found).all():
                return found  # else a block is singular: numpy knows which unknowns it still determines
        return super()._entries(t)

    def mark(self) -> None:
        self.kernel.mark(self._own)

    def callback(self, order: np.ndarray | None, implicit: bool = False):
        """As SUNDIALS calls it, for states in a new order; None if inputs are asked from Python."""
        if self.samplers:
            return None
        return self.kernel.callback(self._call(np.arange(self.n) if order is None else order), implicit)

    def in_c(self) -> InC | None:
        if self.samplers:
            return None
        if self._in_c is None:
            evaluate, mark = self.kernel.address("lmoc_evaluate"), self.kernel.address("lmoc_mark")
            self._in_c = InC(ctypes.addressof(self._own), evaluate, mark, self.w.ctypes.data)
        return self._in_c

    def stepper(self) -> Stepper:
        return NumpyStepper(self) if self.samplers else NativeStepper(self)

    def shared_call(self) -> Call:
        """Return the arguments of the C code of a stepper."""
        return self._own
