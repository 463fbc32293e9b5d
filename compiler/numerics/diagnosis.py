"""Which variable lost its value first."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate import Interpreter
from lmoc.numerics.observe import Observer
from lmoc.numerics.slices import sample
from lmoc.structure.program import Solve, written


def first_not_finite(observer: Observer, time: float, x: np.ndarray) -> str:
    """A sentence about the first variable that has no finite value at (time, x); empty where all have one."""
    plan, reduced = observer.plan, observer.plan.reduced
    w = observer.base.copy()
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = sample(observer.signals[variable], order, np.array([time]))[0]
    groups = [plan.states, plan.sampled]
    interpreter = Interpreter(plan.program, plan.count)
    with np.errstate(all="ignore"):
        for step in (None, *plan.program):
            if step is not None:
                interpreter.steps((step,), w, time)
                groups = [step.unknowns.ravel() if isinstance(step, Solve) else written(step)]
            for registers in groups:
                bad = registers[~np.isfinite(w[registers])]
                if len(bad):
                    return _sentence(reduced, bad, w, isinstance(step, Solve) and not step.linear)
    return ""


def _sentence(reduced, bad: np.ndarray, w: np.ndarray, nonlinear: bool) -> str:
    named = [r for r in bad.tolist() if r < reduced.registers.count and reduced.registers.variable[r] >= 0]
    if not named:
        return "an intermediate result has no finite value"
    name = reduced.register_name(named[0])
    if nonlinear:
        return f"the nonlinear equations for {name} have no solution near the last one"
    return f"{name} has no finite value ({w[named[0]]})"
