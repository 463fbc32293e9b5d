"""Systems evaluated by the engine: the only way to values and derivatives of what is integrated."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from lmoc.engine.accelerator import TapeAccelerator
from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import address
from lmoc.engine.tables import Tables
from lmoc.ir.program import Program
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.evaluate.engine_stepper import EngineStepper
from lmoc.numerics.evaluate.function import tables_of
from lmoc.numerics.evaluate.opened import open_blocks
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.stepper import Stepper
from lmoc.numerics.problem.system import CasadiDAE, InC, Programs, System
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.newton import Retries
from lmoc.numerics.sundials import sundials
from lmoc.support.records import dataclass


def has_branches(plan: Plan) -> bool:
    """Return whether nonlinear blocks are constraints of a mechanism, which can be closed in several ways."""
    return plan.reduced.guess is not None


def plan_tape(plan: Plan) -> Tape:
    """Return the tape of a plan's program; to be asked for by `Plan.once`."""
    return values_tape(plan.program, plan.count)


def plan_accelerator(plan: Plan) -> TapeAccelerator:
    """Return what compiles a plan's tape when it has been worked with for long; to be asked for by `Plan.once`."""
    return TapeAccelerator(plan.once(plan_tape))


@dataclass(frozen=True, eq=False)
class Slopes:
    """The derivatives of a system, and how their entries are ordered by columns."""

    jacobian: Jacobian
    tape: Tape
    order: np.ndarray
    pattern: tuple[np.ndarray, np.ndarray]


def slopes(program: Program, inputs: np.ndarray, outputs: np.ndarray, count: int) -> Slopes:
    """Return the derivatives of some registers of a program by others."""
    rule = Jacobian(program, inputs, outputs, count)
    order = np.lexsort((rule.rows, rule.columns))
    lengths = np.bincount(rule.columns, minlength=len(inputs))
    indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    tape = derivatives_tape(program, rule, count)
    return Slopes(rule, tape, order, (indptr, rule.rows[order].astype(np.int32)))


def _plan_slopes(plan: Plan) -> Slopes:
    return slopes(plan.program, plan.states, plan.derivatives, plan.count)


class EngineSystem(System):
    """A plan's program on a tape, blocks included.

    Python takes part where Newton's method in C does not find the solution of a block: at a start, whose guesses may be
    far off, and where the matrix is singular at the solution.
    """

    description = "engine"

    def __init__(
        self,
        plan: Plan,
        program: Program | None = None,
        inputs: np.ndarray | None = None,
        outputs: np.ndarray | None = None,
        accelerator: TapeAccelerator | None = None,
    ) -> None:
        """
        Parameters
        ----------
        program, inputs, outputs : others than those of the plan
        accelerator : of a tape that does more than run the program; `outputs` are places of it then
        """
        super().__init__(plan)
        self._whole = program is None
        self.program = plan.program if program is None else program
        self.inputs = plan.states if inputs is None else inputs
        self.outputs = plan.derivatives if outputs is None else outputs
        self.n = len(self.inputs)
        if accelerator is None:
            own = None if program is None else TapeAccelerator(values_tape(program, plan.count))
            accelerator = own or plan.once(plan_accelerator)
        tape, self._accelerator = accelerator.tape, accelerator
        self.kernel = self._kernel(tape)
        self.w = self.kernel.w[: tape.registers]
        self._accelerated, self._noted = False, 0
        self._x = np.zeros(self.n + len(plan.sampled))
        self._tables: Tables | None = None  # of the inputs, where all of them follow tables
        self._own = self._call(np.arange(self.n))
        self._seeds = np.zeros(0)
        self._retries = Retries()
        self._numpy: Interpreter | None = None
        self._slopes: Slopes | None = None
        self._derivatives: Kernel | None = None
        self._in_c: InC | None = None
        self._dae: CasadiDAE | None = None

    def _kernel(self, tape: Tape) -> Kernel:
        return Kernel(tape, not has_branches(self.plan))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        self.note_work()
        before = self._sampled
        super().prepare(base, signals)
        if self._sampled != before:
            self._follow_tables()
        self._noted = 0
        self.w[: self.plan.count] = base
        self.kernel.forget()
        if self._derivatives is not None:
            self._derivatives.forget()
        self._retries = Retries()
        self._seeds = self.w[self.kernel.unknowns]
        if self._dae is not None:
            self._dae.parameters[:] = base[self.plan.parameters]

    def _follow_tables(self) -> None:
        """Have C look at the signals behind the inputs where all of them are tables; else Python does."""
        self._tables = tables_of(self.plan.sampled, self._sampled)
        self._own, self._in_c = self._call(np.arange(self.n)), None

    @property
    def python_inputs(self) -> int:
        return 0 if self._tables is not None else len(self.samplers)

    def put(self, register: int, value: float) -> None:
        if len(self.kernel.nonlinear) or self._derivatives is not None or self._dae is not None:
            super().put(register, value)
            return
        self.given[0][register] = self.w[register] = value
        if self.kernel.blocks:
            self.kernel.forget()  # the order of pivots

    def restart(self) -> None:
        self.prepare(*self.given)

    @property
    def registers(self) -> np.ndarray:
        return self.w

    @property
    def unknowns(self) -> np.ndarray:
        return np.concatenate([np.zeros(0, int), *(b.unknowns[:, 0] for b in self.kernel.nonlinear)])

    def determinants(self) -> np.ndarray:
        return self.kernel.determinants()

    def _call(self, order: np.ndarray) -> Call:
        sampled = self.plan.sampled if self._tables is None else None
        call = self.kernel.call(self.inputs[order], self.outputs[order], sampled, self._rescue)
        call.tables = None if self._tables is None else self._tables.address
        return call

    # ------------------------------------------------------------------ values

    def _run(self, t: float, x: np.ndarray, near: bool = False) -> None:
        self._x[: self.n] = x
        if self.python_inputs:
            self.sample(t, self._x[self.n :])
        evaluate = self.kernel.evaluate_near if near else self.kernel.evaluate
        if not evaluate(self._own, t, self._x):
            self.kernel.w[self.outputs] = np.nan

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.evaluations += 1
        self._run(t, x)
        np.take(self.kernel.w, self.outputs, out=out)

    def rhs_near(self, t: float, x: np.ndarray, unknowns: np.ndarray, solutions: np.ndarray, out: np.ndarray) -> None:
        self.w[unknowns] = solutions
        self._run(t, x, near=True)
        np.take(self.w, self.outputs, out=out)

    @property
    def _interpreter(self) -> Interpreter:
        """The same program run by numpy, which knows ways to a solution that C does not."""
        if self._numpy is None:
            self._numpy = Interpreter(self.program, len(self.w))
        return self._numpy

    def _rescue(self, time: float) -> bool:
        """Take damped steps from where C has come to; not where that might lead to another branch.

        Nor from states that an attempt without a solution has made NaN, nor where that has been in vain just before.
        """
        w, unknowns = self.w, self.kernel.unknowns
        if self._own.solved and (has_branches(self.plan) or not self._retries.due(self.evaluations)):
            return False
        if not np.isfinite(w[self.inputs]).all():
            return False
        w[unknowns] = np.where(np.isfinite(w[unknowns]), w[unknowns], self._seeds)
        self._interpreter.reset()
        self._interpreter.run(w, time)
        found = bool(np.isfinite(w[unknowns]).all())
        self._retries.note(found, self.evaluations)
        return found

    def note_work(self) -> None:
        """Go on with compiled code if it is there by now: with the same bits."""
        if self._accelerated:
            return
        made, self._noted = self.evaluations - self._noted, self.evaluations
        self._accelerator.note(max(made, 0))  # the count has begun anew
        if self._accelerator.library is not None:
            self.kernel.accelerate(self._accelerator.library)
            self._accelerated = True

    def mark(self) -> None:
        self.kernel.mark(self._own)

    def go_back(self) -> None:
        self.kernel.go_back(self._own)

    # ------------------------------------------------------------------ derivatives

    def _ready_slopes(self) -> Slopes:
        if self._slopes is None:
            own = self.program, self.inputs, self.outputs, self.plan.count
            self._slopes = self.plan.once(_plan_slopes) if self._whole else slopes(*own)
            self._derivatives = Kernel(self._slopes.tape)
        return self._slopes

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        return self._ready_slopes().pattern

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        own = self._ready_slopes()
        assert self._derivatives is not None
        self.jacobians += 1
        self.note_work()
        self._run(t, x)
        self._derivatives.w[: self.plan.count] = self.w
        self._derivatives(t)
        found = self._derivatives.results()
        if own.tape.blocks and not np.isfinite(found).all():
            found = own.jacobian.values(self.w, t)  # of a singular block: which unknowns it still determines
        np.take(found, own.order, out=out)

    # ------------------------------------------------------------------ for steps without Python

    def callback(self, order: np.ndarray | None, implicit: bool = False):
        """As SUNDIALS calls it, for states in a new order; None if inputs are asked from Python."""
        if self.python_inputs:
            return None
        call = self._call(np.arange(self.n) if order is None else order)
        call.data = ctypes.cast(sundials.load().N_VGetArrayPointer, ctypes.c_void_p).value
        kind, name = (sundials.RESIDUAL, "lmoc_residual") if implicit else (sundials.RHS, "lmoc_rhs")
        return kind(address(name)), call.reference

    def in_c(self) -> InC | None:
        if self.python_inputs:
            return None
        if self._in_c is None:
            functions = address("lmoc_evaluate"), address("lmoc_mark")
            self._in_c = InC(ctypes.addressof(self._own), *functions, self.w.ctypes.data)
        return self._in_c

    def programs(self) -> Programs:
        return ((self.kernel, self._own),)

    def stepper(self) -> Stepper:
        return EngineStepper(self)

    def shared_call(self) -> Call:
        """Return the arguments of the C code of a stepper."""
        return self._own

    # ------------------------------------------------------------------ other forms

    def opened(self) -> OpenedSystem | None:
        if not len(open_blocks(self.plan.program)[1]):
            return None
        opened = OpenedSystem(self.plan)
        opened.prepare(*self.given)
        return opened

    def casadi_dae(self) -> CasadiDAE | None:
        from lmoc.numerics.evaluate.casadi_system import CasadiDerivatives, can_lower

        plan = self.plan
        if self.samplers or not can_lower(plan.program):
            return None
        if self._dae is None:
            own = CasadiDerivatives(
                plan.program, plan.count, plan.states, plan.parameters, plan.sampled, plan.derivatives
            )
            equations = {"t": own.time, "x": own.x, "p": own.p, "ode": own.out}
            self._dae = CasadiDAE(equations, self.given[0][plan.parameters])
        return self._dae


class OpenedSystem(EngineSystem):
    """``x' = f(t, x, z), 0 = g(t, x, z)`` for y = (x, z); `rhs` writes (f, g).

    Attributes
    ----------
    closed : the system in which the blocks are solved, for starts
    differential : (n,) which components have derivatives
    """

    description = "engine, index 1"
    algebraic_size = 1.0

    def __init__(self, plan: Plan) -> None:
        self.closed = EngineSystem(plan)
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
