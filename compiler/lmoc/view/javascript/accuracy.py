"""The data with which a page integrates as accurately as the compiler: tolerances, refinement, start of Newton."""

from __future__ import annotations

import sys

import numpy as np

from lmoc.numerics.observe.observer import Observer, find
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.steps.added_errors import (
    FORGOTTEN,
    LEAST_FACTOR,
    LEAST_UNKNOWN,
    NO_FINER,
    WORTHWHILE,
    calibrated,
    growth,
)
from lmoc.numerics.steps.automatic import TRIAL
from lmoc.numerics.steps.modes import EIGENVALUES
from lmoc.numerics.task.tolerances import absolute_tolerances as of_components
from lmoc.view.javascript.programs import unknowns_of


def absolute_tolerances(observer: Observer, time: float, x: np.ndarray, rtol: float) -> np.ndarray:
    """Return the absolute tolerance of each state, (n,), for a relative one.

    Parameters
    ----------
    time, x : s, and the states there: the start
    """
    plan = observer.plan

    def stored() -> np.ndarray:
        return observer(find(observer.flat, "ledger.stored"), np.array([time]), x[None])[0, 0]

    return of_components(plan, observer.values, x, rtol, None, stored, {})


def refinement(observer: Observer, time: float, x: np.ndarray) -> dict[str, float | None]:
    """Return how `auto` refines a long run (`steps/automatic.py`), with the slowest rate at the start, 1/s."""
    plan = observer.plan
    added, power = growth(plan)
    constants = {"trial": TRIAL, "added": added, "power": power, "worthwhile": WORTHWHILE, "forgotten": FORGOTTEN}
    constants |= {"least": LEAST_FACTOR, "slowest": None, "calibrated": calibrated(plan), "noFiner": NO_FINER}
    jacobian = Jacobian(plan.program, plan.states, plan.derivatives, plan.count)
    n = plan.state_count
    matrix = np.zeros((len(plan.states), len(plan.states)))
    matrix[jacobian.rows, jacobian.columns] = jacobian.values(_at_start(observer, time, x), time)
    if len(plan.states) > EIGENVALUES or not np.isfinite(matrix).all():
        return constants | {"least": LEAST_UNKNOWN}
    slowest = -float(np.linalg.eigvals(matrix[:n, :n]).real.max(initial=-np.inf))
    return constants | {"slowest": min(slowest, sys.float_info.max)}  # nothing remembers anything


def seeds(observer: Observer, time: float, x: np.ndarray) -> list[list[float]]:
    """Return [register, value] of the unknowns of nonlinear blocks at the start: the branch of the run."""
    registers = unknowns_of(observer.plan)
    values = [float(observer.register(r, np.array([time]), x[None])[0]) for r in registers.tolist()]
    return [[r, v] for r, v in zip(registers.tolist(), values, strict=True) if np.isfinite(v)]


def _at_start(observer: Observer, time: float, x: np.ndarray) -> np.ndarray:
    """Return the registers at the start, where the right-hand side has filled its own."""
    plan, w = observer.plan, observer.base.copy()
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = observer.signals[variable].value(time, order)
    for register, value in seeds(observer, time, x):
        w[int(register)] = value
    Interpreter(plan.program, plan.count).run(w, time)
    return w
