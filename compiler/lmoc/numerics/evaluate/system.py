"""The numeric system: x' = f(t, x) with its Jacobian, whatever evaluates it.

A run has one `System`; parameters are data of it, set by `prepare`. Small explicit programs are casadi functions, large
ones are compiled C where there is a compiler, and what neither takes is run by numpy over groups of rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.evaluate.follow import Follower
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.segments import SegmentedProgram, can_segment
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal, sample

COMPILED_ROWS = 2500  # programs with more rows are worth a call of the C compiler


class System(ABC):
    """x' = f(t, x).

    Attributes
    ----------
    n : number of integrated components
    kind : how it is evaluated, for the statistics of a run
    evaluations, jacobians : calls so far
    mode : the set of active laws that the equations belong to (empty: no laws)
    """

    kind = ""
    mode: tuple[int, ...] = ()

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.n = len(plan.states)
        self.evaluations = 0
        self.jacobians = 0
        self.samplers: list[Callable[[float], float]] = []
        self._sampled: list[tuple[Signal, int]] = []

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the parameter values of a run (`Plan.base`) and the functions behind sampled inputs."""
        self.evaluations = self.jacobians = 0
        self.samplers = [_sampler(signals[v], order) for v, order in self.plan.samplers]
        self._sampled = [(signals[v], order) for v, order in self.plan.samplers]

    def sample(self, t: float, out: np.ndarray) -> None:
        """Values of the sampled inputs at one time."""
        for k, call in enumerate(self.samplers):
            out[k] = call(t)

    def sample_many(self, times: np.ndarray, out: np.ndarray) -> None:
        """Values of the sampled inputs at several times, (times, inputs); tables take all times at once."""
        for k, (signal, order) in enumerate(self._sampled):
            out[:, k] = sample(signal, order, times)

    def opened(self) -> System | None:
        """The index-1 form with the unknowns of large blocks as algebraic variables; None: there are no such blocks."""
        return None

    @abstractmethod
    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        """Write f(t, x) into `out`."""

    @abstractmethod
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """CSC pattern (indptr, indices) of ∂f/∂x."""

    @abstractmethod
    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        """Write the entries of ∂f/∂x in the order of `pattern` into `out`."""

    @property
    def registers(self) -> np.ndarray | None:
        """(plan.count,) all registers as the last evaluation has left them, where it keeps them."""
        return None

    def callback(self, order: np.ndarray | None):
        """The right-hand side as a compiled SUNDIALS callback with its data, states in a new order, or None."""
        return None

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        """∂f/∂x as a dense matrix."""
        indptr, indices = self.pattern()
        values = np.empty(len(indices))
        self.jacobian_values(t, x, values)
        matrix = np.zeros((self.n, self.n))
        matrix[indices, np.repeat(np.arange(self.n), np.diff(indptr))] = values
        return matrix


def _sampler(signal: Signal, order: int) -> Callable[[float], float]:
    return lambda t: float(signal.value(t, order))


class CasadiSystem(System):
    """All derivatives are one casadi function."""

    kind = "casadi"

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.lowered = Lowered(plan.program, plan.count, plan.states, plan.parameters, plan.sampled, plan.derivatives)
        self.function = self.lowered.function()
        self.t, self.x = np.zeros(1), np.zeros(self.n)
        self.p, self.u = np.zeros(len(plan.parameters)), np.zeros(len(plan.sampled))
        self._rhs = Buffered(self.function, (self.t, self.x, self.p, self.u))
        self._jacobian: Buffered | None = None
        self.stepper: object | None = None  # an integrator's own function of this system, kept for the next run
        self.native_integrators: dict[tuple, object] = {}  # casadi's, by times and tolerances

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


class VectorSystem(System):
    """The program is run step by step by numpy."""

    kind = "numpy"

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
        self._follow(Interpreter(self.program, plan.count))
        self.w = np.full(plan.count, np.nan)
        self._derivative: Jacobian | None = None
        self._order: np.ndarray | None = None
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None
        self._u = np.zeros(len(plan.sampled))
        self._given: tuple[np.ndarray, Mapping[int, Signal]] | None = None

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.w[:] = base
        self.interpreter.reset()
        self.follower.forget()
        self._given = base, signals

    @property
    def registers(self) -> np.ndarray:
        return self.w

    def _follow(self, interpreter: Interpreter | SegmentedProgram) -> None:
        self.interpreter = interpreter
        self.follower = Follower(interpreter.run, interpreter.newtons)

    def opened(self) -> System | None:
        from lmoc.numerics.evaluate.opened import OpenedSystem, open_blocks

        if not len(open_blocks(self.plan.program)[1]):
            return None
        opened = OpenedSystem(self.plan)
        opened.prepare(*self._given)
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
        out[:] = self._derivative.values(self.w, t)[self._order]


class SegmentedSystem(VectorSystem):
    """A small program with blocks that casadi does not solve: casadi functions between and inside the blocks."""

    kind = "casadi, blocks"

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.segments = SegmentedProgram(plan.program, plan.count)
        self._follow(self.segments)

    def restart(self) -> None:
        """Forget the solutions of blocks: the next evaluation is at the start again."""
        self.prepare(*self._given)

    @property
    def unknowns(self) -> np.ndarray:
        """One register of each instance of a nonlinear block."""
        return self.segments.unknowns

    def determinants(self) -> np.ndarray:
        """Of the Jacobians of the nonlinear blocks' instances, at the evaluation made last."""
        return self.segments.determinants()


def make_system(plan: Plan) -> System:
    """The way of evaluating that suits the size and the blocks of a plan."""
    if plan.row_count > COMPILED_ROWS or (plan.has_large_blocks and not can_lower(plan.program)):
        from lmoc.numerics.evaluate.native.c_code import Unsupported
        from lmoc.numerics.evaluate.native.system import NativeSystem

        try:
            return NativeSystem(plan)
        except (Unsupported, OSError):  # a block that C does not take, or no compiler: the others give the same values
            pass
    if plan.row_count <= CASADI_ROWS and can_lower(plan.program):
        return CasadiSystem(plan)
    if plan.row_count <= CASADI_ROWS and can_segment(plan.program):
        return SegmentedSystem(plan)
    return VectorSystem(plan)
