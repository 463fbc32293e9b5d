"""The entries of the constraint matrix where a system stands, and with few rows its tableau."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.program import Program, needed_steps, read, written
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.unrolled_tableau import MOST_ROWS, unrolled
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan

if TYPE_CHECKING:
    import casadi

Unscaled = tuple[np.ndarray, float]  # T in the rows of the tableau, and the sign of the determinant of A
NONE = np.zeros(0, int)
Entries = Callable[[float, np.ndarray], tuple[np.ndarray, Unscaled | None]]


def entries_of(system: System, base: np.ndarray, own: Constraints) -> Entries:
    """Return ``(t, x) -> entries, tableau``, the latter None where it is left to numpy.

    From the registers of a system that keeps them, else by a function of its own.
    """
    plan, kept = system.plan, system.registers is not None
    program, used, function = plan.once(_from_registers if kept else _from_states)
    out, sampled = np.empty(system.n), np.zeros(len(plan.sampled))
    if not plan.once(_stand_kept if kept else _stand):
        return _by_all_equations(system, base, own)
    if function is None:
        w, interpreter = np.zeros(own.count), Interpreter(program, own.count)

        def by_numpy(t: float, x: np.ndarray) -> tuple[np.ndarray, None]:
            evaluate(system, t, x, out)
            w[: plan.count] = system.registers[: plan.count]
            interpreter.run(w, t)
            return w[own.register], None

        return by_numpy
    time, at, known = np.zeros(1), np.zeros(0 if kept else len(plan.states)), base[used].copy()
    call = Buffered(function, (time, at, known, np.zeros(0) if kept else sampled))

    shape = len(own.watched), len(own.variable) - own.rows

    def entries(t: float, x: np.ndarray) -> tuple[np.ndarray, Unscaled | None]:
        time[0] = t
        if kept:
            evaluate(system, t, x, out)
            np.take(system.registers, used, out=known)
        else:
            at[:] = x
            system.sample(t, sampled)
        call()
        if len(call.results) == 1:
            return call.results[0], None
        values, table, sign = call.results
        return values, (table.reshape(shape, order="F"), float(sign[0]))

    return entries


def _by_all_equations(system: System, base: np.ndarray, own: Constraints) -> Entries:
    """Return the same where coordinates that the motion does not need are watched as well."""
    plan, out, sampled = system.plan, np.empty(system.n), np.zeros(len(system.plan.sampled))
    w = np.concatenate([base, np.full(own.count - plan.count, np.nan)])
    interpreter = Interpreter(needed_steps((*plan.full_program, *own.program), own.register, own.count), own.count)

    def entries(t: float, x: np.ndarray) -> tuple[np.ndarray, None]:
        if system.registers is not None:
            evaluate(system, t, x, out)
            found = system.registers[: plan.count]
            w[: plan.count] = np.where(np.isfinite(found), found, w[: plan.count])
        system.sample(t, sampled)
        w[plan.states], w[plan.sampled] = x, sampled
        interpreter.reset()  # blocks begin at the solutions that stand there
        interpreter.run(w, t)
        return w[own.register], None

    return entries


def at_hand(plan: Plan) -> np.ndarray:
    """Return the registers that stand where the system has been evaluated."""
    filled = np.zeros(plan.count, bool)
    steps = (*plan.program, *plan.reduced.parameter_program)
    for registers in (plan.states, plan.sampled, plan.parameters, plan.known[0], *map(written, steps)):
        filled[registers] = True
    return np.flatnonzero(filled)


def _stand_kept(plan: Plan) -> bool:
    return bool(np.isin(plan.once(_from_registers)[1], plan.once(at_hand)).all())


def _stand(plan: Plan) -> bool:
    return bool(np.isin(plan.once(_from_states)[1], plan.once(at_hand)).all())


Made = tuple[Program, np.ndarray, "casadi.Function | None"]


def _from_registers(plan: Plan) -> Made:
    """The entries from the registers of the system: a program, the registers it reads, and the compiled function."""
    program, reads, lowered = lowered_entries(plan, kept=True)
    return program, reads, _function(plan, lowered)


def _from_states(plan: Plan) -> Made:
    """Return the same from the states and sampled inputs."""
    program, reads, lowered = lowered_entries(plan, kept=False)
    return program, reads, _function(plan, lowered)


def _function(plan: Plan, lowered: Lowered | None) -> casadi.Function | None:
    own = plan.reduced.constraints
    if lowered is None:
        return None
    return lowered.function("constraints", unrolled(lowered.out, own) if own.rows <= MOST_ROWS else ())


def lowered_entries(plan: Plan, kept: bool) -> tuple[Program, np.ndarray, Lowered | None]:
    """Return the program of the entries, the registers it reads, and its expressions where casadi takes it.

    Parameters
    ----------
    kept : whether everything that the system computes stands in registers; else all is computed from the states
    """
    own = plan.reduced.constraints
    program = own.program if kept else needed_steps((*plan.program, *own.program), own.register, own.count)
    states, signals = (NONE, NONE) if kept else (plan.states, plan.sampled)
    reads = _reads(program, own.count, states, signals)
    if not _is_lowered(program):
        return program, reads, None
    return program, reads, Lowered(program, own.count, states, reads, signals, own.register)


def reads_of_entries(plan: Plan) -> np.ndarray | None:
    """Return the registers that the program of the entries reads; None where casadi does not take it."""
    own = plan.reduced.constraints
    return _reads(own.program, own.count) if _is_lowered(own.program) else None


def _reads(program: Program, count: int, *given: np.ndarray) -> np.ndarray:
    inside, used = np.zeros(count, bool), np.zeros(count, bool)
    for registers in (*map(written, program), *given):
        inside[registers] = True
    for step in program:
        used[read(step)] = True
    return np.flatnonzero(used & ~inside)


def _is_lowered(program: Program) -> bool:
    return can_lower(program) and sum(len(written(s)) for s in program) <= CASADI_ROWS


def evaluate(system: System, t: float, x: np.ndarray, out: np.ndarray) -> None:
    """Fill the system's registers; the look does not count as one of the method's evaluations."""
    count = system.evaluations
    system.rhs(t, x, out)
    system.evaluations = count
