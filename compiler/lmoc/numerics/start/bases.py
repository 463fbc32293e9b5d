"""What does not change during a run, for many parameter sets at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.numerics.observe.slices import runs_alike
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Constant, Signal
from lmoc.numerics.solve.interpreter import Interpreter


def bases(
    plan: Plan, values: np.ndarray, signals: Mapping[int, Signal], numbers: Mapping[int, np.ndarray]
) -> np.ndarray:
    """Return the registers (runs, registers) that do not change during a run, as `Plan.base` of each.

    Parameters
    ----------
    values : (variables, runs) parameters
    numbers : {input: (runs,)} inputs that are numbers, of their own in each run
    """
    runs = values.shape[1]
    if not runs_alike(plan.reduced.parameter_program):
        return np.stack([plan.base(values[:, k].copy(), signals_of(signals, numbers, k)) for k in range(runs)])
    w = np.full((plan.count, runs), np.nan)
    w[plan.known[0]] = values[plan.known[1]]
    for register, variable in plan.constants:
        w[register] = 0.0 if variable < 0 else numbers.get(variable, getattr(signals[variable], "value", np.nan))
    Interpreter(plan.reduced.parameter_program, plan.count).run(w, np.nan)
    return np.ascontiguousarray(w.T)


def signals_of(signals: Mapping[int, Signal], numbers: Mapping[int, np.ndarray], run: int) -> dict[int, Signal]:
    """Return the signals of one run."""
    return {**signals, **{variable: Constant(float(own[run])) for variable, own in numbers.items()}}
