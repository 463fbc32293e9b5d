"""From one choice of coordinates to another at the same place: states pass by the variables they stand for."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import sample
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class RunState:
    """Where a run in one choice of coordinates stands: where one in others may begin.

    Attributes
    ----------
    w : (plan.count,) registers of the observer's plan
    """

    observer: Observer
    w: np.ndarray

    def states(self, other: Plan, base: np.ndarray) -> np.ndarray:
        """Return the states of another plan here; parameters as of `carried_over`."""
        return carried_over(self.observer, self.w, other, base)


def registers_at(observer: Observer, system: System, t: float, x: np.ndarray) -> np.ndarray:
    """Return all registers (plan.count,) at a place that the system has come to, on the branch on which it is."""
    plan = observer.plan
    system.rhs(t, x, np.empty(len(x)))
    near, w = system.registers, observer.base.copy()
    if near is not None:
        unknowns = plan.once(block_unknowns)
        w[unknowns] = near[unknowns]
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = sample(observer.signals[variable], order, np.array([t]))[0]
    interpreter = plan.once(_interpreter)
    interpreter.reset()
    interpreter.run(w, t)
    return w


def carried_over(observer: Observer, w: np.ndarray, other: Plan, base: np.ndarray) -> np.ndarray:
    """Return the states of another plan of the same model at a place, and let its nonlinear blocks begin there.

    Parameters
    ----------
    observer, w : of the plan that has been integrated, and its registers (`registers_at`)
    base : registers of the other plan that do not change during a run; the blocks' unknowns are written into it
    """
    table = other.reduced.registers
    for unknowns in _unknowns(other):
        base[unknowns] = values_at(observer, w, table.variable[unknowns], table.order[unknowns])
    return values_at(observer, w, table.variable[other.states], table.order[other.states])


def continued(plan: Plan, end: End, base: np.ndarray) -> np.ndarray:
    """Return the states and quadratures with which a plan goes on from the end of a run, its ledger from zero.

    Nonlinear blocks begin where they were solved there.

    Parameters
    ----------
    base : registers that do not change during a run; the blocks' unknowns are written into it
    """
    reduced, table = plan.reduced, plan.reduced.registers
    for unknowns in _unknowns(plan):
        own = unknowns[(table.variable[unknowns] >= 0) & (table.order[unknowns] == 0)]
        known = end.values[table.variable[own]]
        base[own[np.isfinite(known)]] = known[np.isfinite(known)]
    x = np.zeros(len(plan.states))
    own = plan.states[plan.state_count :]
    known = (table.variable[own] >= 0) & (table.order[own] == 0) & ~plan.ledger[plan.state_count :]
    x[plan.state_count :][known] = end.values[table.variable[own[known]]]
    for k, name in enumerate(reduced.state_names):
        x[k] = end[name] if name in end else end.values[table.variable[plan.states[k]]]
    return x


def values_at(observer: Observer, w: np.ndarray, variables: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Values of jets; NaN where they are not among the registers."""
    reduced = observer.plan.reduced
    result = np.full(variables.shape, np.nan)
    for k, (variable, order) in enumerate(zip(variables.ravel().tolist(), orders.ravel().tolist(), strict=True)):
        if variable >= 0:
            register = int(reduced.register_of[variable]) if order == 0 else observer.derivative(variable, order)
            result.flat[k] = w[register] if register >= 0 else np.nan
    return result


def block_unknowns(plan: Plan) -> np.ndarray:
    """Return the registers of the unknowns of the nonlinear blocks that the motion depends on."""
    own = [s.unknowns.ravel() for s in walk(plan.program) if isinstance(s, Solve) and not s.linear]
    return np.concatenate([np.zeros(0, int), *own])


def all_unknowns(plan: Plan) -> np.ndarray:
    """Return the registers of the unknowns of all nonlinear blocks."""
    return np.concatenate([np.zeros(0, int), *(u.ravel() for u in _unknowns(plan))])


def with_solutions(base: np.ndarray, unknowns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return registers that do not change during a run, with places at which the nonlinear blocks begin."""
    base = base.copy()
    base[unknowns] = values
    return base


def _interpreter(plan: Plan) -> Interpreter:
    return Interpreter(plan.full_program, plan.count)


def _unknowns(plan: Plan) -> list[np.ndarray]:
    """Registers of the unknowns of all nonlinear blocks."""
    return [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
