"""The entries of the constraint matrix where a system stands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.ir.program import Program, Solve, needed_steps, read, walk, written
from lmoc.ir.reduced import Constraints
from lmoc.lower.blocks import values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.solve.interpreter import Interpreter

Entries = Callable[[float, np.ndarray], np.ndarray]


def entries_of(system: System, base: np.ndarray, own: Constraints) -> Entries:
    """Return ``(t, x) -> entries``, from the registers of a system that keeps all that they follow from."""
    plan, out = system.plan, np.empty(system.n)
    if system.registers is None or not plan.once(_stand):
        return _by_all_equations(system, base, own)
    kernel = Kernel(plan.once(constraints_tape))

    def entries(t: float, x: np.ndarray) -> np.ndarray:
        evaluate(system, t, x, out)
        kernel.w[: plan.count] = system.registers[: plan.count]
        kernel(t)
        return kernel.w[own.register]

    return entries


def constraints_tape(plan: Plan) -> Tape:
    """Return the tape of a plan's constraints; to be asked for by `Plan.once`."""
    own = plan.reduced.constraints
    return values_tape(own.program, own.count)


def _by_all_equations(system: System, base: np.ndarray, own: Constraints) -> Entries:
    """Return the same where coordinates that the motion does not need are watched as well."""
    plan, out, sampled = system.plan, np.empty(system.n), np.zeros(len(system.plan.sampled))
    w = np.concatenate([base, np.full(own.count - plan.count, np.nan)])
    interpreter = Interpreter(plan.once(_all_equations), own.count)

    def entries(t: float, x: np.ndarray) -> np.ndarray:
        if system.registers is not None:
            evaluate(system, t, x, out)
            found = system.registers[: plan.count]
            w[: plan.count] = np.where(np.isfinite(found), found, w[: plan.count])
        system.sample(t, sampled)
        w[plan.states], w[plan.sampled] = x, sampled
        interpreter.reset()  # blocks begin at the solutions that stand there
        interpreter.run(w, t)
        return w[own.register]

    return entries


def entries_program(plan: Plan) -> Program:
    """Return what fills the entries from the registers of a system that has been evaluated."""
    return plan.reduced.constraints.program if plan.once(_stand) else plan.once(_all_equations)


def _all_equations(plan: Plan) -> Program:
    own = plan.reduced.constraints
    return needed_steps((*plan.full_program, *own.program), own.register, own.count)


def at_hand(plan: Plan) -> np.ndarray:
    """Return the registers that stand where the system has been evaluated."""
    filled = np.zeros(plan.count, bool)
    steps = (*plan.program, *plan.reduced.parameter_program)
    for registers in (plan.states, plan.sampled, plan.parameters, plan.known[0], *map(written, steps)):
        filled[registers] = True
    return np.flatnonzero(filled)


def _stand(plan: Plan) -> bool:
    own = plan.reduced.constraints
    return bool(np.isin(_reads(own.program, own.count), plan.once(at_hand)).all())


def reads_of_entries(plan: Plan) -> np.ndarray | None:
    """Return the registers that the program of the entries reads; None where it has implicit blocks."""
    own = plan.reduced.constraints
    if any(isinstance(step, Solve) for step in walk(own.program)):
        return None
    return _reads(own.program, own.count)


def _reads(program: Program, count: int) -> np.ndarray:
    inside, used = np.zeros(count, bool), np.zeros(count, bool)
    for registers in map(written, program):
        inside[registers] = True
    for step in program:
        used[read(step)] = True
    return np.flatnonzero(used & ~inside)


def evaluate(system: System, t: float, x: np.ndarray, out: np.ndarray) -> None:
    """Fill the system's registers; the look does not count as one of the method's evaluations."""
    count = system.evaluations
    system.rhs(t, x, out)
    system.evaluations = count
