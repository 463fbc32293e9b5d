"""From one choice of coordinates to another at the same place: states pass by the variables they stand for."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import sample


def registers_at(observer: Observer, system: System, t: float, x: np.ndarray) -> np.ndarray:
    """Return all registers (plan.count,) at a place that the system has come to, on the branch on which it is."""
    plan = observer.plan
    system.rhs(t, x, np.empty(len(x)))
    near, w = system.registers, observer.base.copy()
    if near is not None:
        for unknowns in _unknowns(plan):
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
        base[unknowns] = _values(observer, w, table.variable[unknowns], table.order[unknowns])
    return _values(observer, w, table.variable[other.states], table.order[other.states])


def _values(observer: Observer, w: np.ndarray, variables: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Values of jets; NaN where they are not among the registers."""
    reduced = observer.plan.reduced
    result = np.full(variables.shape, np.nan)
    for k, (variable, order) in enumerate(zip(variables.ravel().tolist(), orders.ravel().tolist(), strict=True)):
        if variable >= 0:
            register = int(reduced.register_of[variable]) if order == 0 else observer.derivative(variable, order)
            result.flat[k] = w[register] if register >= 0 else np.nan
    return result


def _interpreter(plan: Plan) -> Interpreter:
    return Interpreter(plan.full_program, plan.count)


def _unknowns(plan: Plan) -> list[np.ndarray]:
    """Registers of the unknowns of all nonlinear blocks."""
    return [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
