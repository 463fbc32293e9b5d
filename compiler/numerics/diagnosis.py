"""Which variable lost its value first."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate import Interpreter
from lmoc.numerics.observe import Observer
from lmoc.numerics.signals import sample
from lmoc.numerics.system import System
from lmoc.semantics.flat import FlatDAE
from lmoc.source import Span
from lmoc.structure.program import Program, Solve, written
from lmoc.structure.reduced import Reduced

_AHEAD = 40  # halvings of the distance at which a lost value is looked for


def lost_ahead(observer: Observer, system: System, time: float, x: np.ndarray, stop: float) -> str:
    """What has no finite value at (time, x), or else a little further on along the motion; empty where nothing."""
    found = first_not_finite(observer, time, x)[0]
    rate = np.empty(len(x))
    system.rhs(time, x, rate)
    if found or not np.isfinite(rate).all():
        return found
    for k in range(_AHEAD, 6, -1):
        distance = (stop - time) * 0.5**k
        found = first_not_finite(observer, time + distance, x + distance * rate)[0]
        if found:
            return f"beyond this point {found}"
    return ""


def first_not_finite(
    observer: Observer, time: float, x: np.ndarray, program: Program | None = None
) -> tuple[str, Span | None, bool]:
    """A sentence about the first variable that has no finite value at (time, x), where it is declared, and whether it
    is an unknown of nonlinear equations without a solution.

    Empty where all have one. `program` is what is looked at, without it what the derivatives need.
    """
    plan, reduced = observer.plan, observer.plan.reduced
    w = observer.base.copy()
    if program is None:
        program = plan.program
    else:
        w[plan.absent] = 0.0  # what depends on them has been said to be unknown
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = sample(observer.signals[variable], order, np.array([time]))[0]
    groups = [plan.states, plan.sampled]
    if program is plan.full_program:  # most often all is well, which a look at what may be lost tells
        steps, watched, count = plan.losable
        longer = np.concatenate([w, np.zeros(count - len(w))])
        Interpreter(steps, count).run(longer, time)
        if all(np.isfinite(longer[registers]).all() for registers in (*groups, watched)):
            return "", None, False
    interpreter = Interpreter(program, plan.count)
    with np.errstate(all="ignore"):
        for step in (None, *program):
            if step is not None:
                interpreter.steps((step,), w, time)
                groups = [step.unknowns.ravel() if isinstance(step, Solve) else written(step)]
            for registers in groups:
                bad = registers[~np.isfinite(w[registers])]
                if len(bad):
                    nonlinear = isinstance(step, Solve) and not step.linear
                    return *sentence(reduced, bad, w, nonlinear), nonlinear
    return "", None, False


def sentence(reduced: Reduced, bad: np.ndarray, w: np.ndarray, nonlinear: bool) -> tuple[str, Span | None]:
    """What is said of registers without a finite value, all filled by the same step, and the place of the first.

    Parameters
    ----------
    nonlinear : they are unknowns of nonlinear equations
    """
    named = [r for r in bad.tolist() if r < reduced.registers.count and reduced.registers.variable[r] >= 0]
    if not named:
        return "an intermediate result has no finite value", None
    name = reduced.register_name(named[0])
    span = _place(reduced.flat, int(reduced.registers.variable[named[0]]))
    if nonlinear:
        return f"the nonlinear equations for {name} have no solution that Newton's method finds", span
    return f"{name} has no finite value ({w[named[0]]})", span


def _place(flat: FlatDAE, variable: int) -> Span | None:
    """Where the user declared the part with this variable, else the variable's own declaration."""
    block = flat.block_at(variable)
    part = flat.parts[block.part].span if block.part < len(flat.parts) else None
    return part or block.span
