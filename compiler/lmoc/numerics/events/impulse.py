"""Impulses from derivatives of steps, and what they do to the states.

The derivative of a step Δ is an impulse, Δ·δ(t), and so is that of a kink, of one order more. Equations that are linear
in it make the states jump: of x' = f(x, u, u') those of

    dx/ds = lim f(x, u + s·Δ, Δ/ε)·ε,    0 ≤ s ≤ 1,    ε → 0,

which is what ever steeper ramps tend to (J. J. Moreau, Bounded variation in time, in Topics in Nonsmooth Mechanics,
1988). A step of a prescribed position passes through a damper as the velocity c·Δ/m; the heat in the damper, and the
work of the source, grow beyond all bounds with the steepness. A kink passes through what is rigid, and costs finite
work. What needs two derivatives of a step has no such limit, and what grows with a power of it neither.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.expression.dag import ZERO, function, if_, slot
from lmoc.ir.law import NONE, LawKind
from lmoc.ir.program import Apply, Program, Step, Total, needed_steps, written
from lmoc.ir.reduced import Reduced
from lmoc.numerics.observe.slices import renumber
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass


class NoImpulse(Exception):
    """A step has no finite effect; the text says why."""


@dataclass(frozen=True, eq=False)
class GivenProgram:
    """The program of a plan with some registers that can be given from outside, whatever it says about them.

    Attributes
    ----------
    steps : Program
    count : how many registers it has: those of the plan come first
    which, given : (k,) registers that say of which they are given, and what they are then
    own : (k,) registers of their values where they are not
    results : (states + judged,) registers of the rates, and of what shows whether anything but derivatives is moved
    """

    steps: Program
    count: int
    which: np.ndarray
    given: np.ndarray
    own: np.ndarray
    results: np.ndarray


def given_program(plan: Plan, registers: np.ndarray, rates: np.ndarray) -> GivenProgram:
    """Return the program of a plan with registers that can be given; `rates`: those that are derivatives."""
    which, given, own = plan.count + np.arange(3 * len(registers)).reshape(3, -1)
    filled = np.zeros(plan.count, bool)
    for step in plan.full_program:
        filled[written(step)] = True
    inside = filled[registers]
    reading, writing = (np.arange(plan.count + 3 * len(registers)) for _ in range(2))
    writing[registers[inside]] = own[inside]
    reading[registers[~inside]] = own[~inside]
    choice = if_(function("gt", slot(0), ZERO), slot(1), slot(2))
    first = np.stack([which, given, registers], axis=1)[~inside]
    steps: list[Step] = [Apply(choice, first, own[~inside])]
    for step in plan.full_program:
        steps.append(_mapped(step, reading, writing))
        now = np.isin(registers, written(step))
        if now.any():
            steps.append(Apply(choice, np.stack([which, given, own], axis=1)[now], registers[now]))
    results = reading[np.concatenate([plan.derivatives, _judged(plan.reduced, plan.count, rates)])]
    return GivenProgram(needed_steps(tuple(steps), results, len(reading)), len(reading), which, given, own, results)


def _mapped(step: Step, reading: np.ndarray, writing: np.ndarray) -> Step:
    """Return a step with other registers; a block reads what it fills itself where it writes it."""
    if isinstance(step, Apply):
        return Apply(step.shape, reading[step.slots], writing[step.out])
    if isinstance(step, Total):
        return Total(step.start, reading[step.index], step.coefficient, writing[step.out])
    inside, own = reading.copy(), written(step)
    inside[own] = writing[own]
    return renumber(step, inside)


def _judged(reduced: Reduced, count: int, rates: np.ndarray) -> NDArray[np.int64]:
    """Return the registers of variables but these; how fast a gap opens is no motion: what is closed is looked at
    afterwards."""
    judged = np.zeros(count, bool)
    judged[reduced.register_of[reduced.register_of >= 0]] = True
    judged[rates] = False
    form = reduced.switched
    if form is not None:
        unilateral = np.concatenate([np.full(laws.rows, laws.kind is LawKind.UNILATERAL) for laws in form.laws])
        found = reduced.register_of[form.level[unilateral]]
        judged[found[found >= 0]] = False
    return np.flatnonzero(judged)


def law_registers(plan: Plan) -> NDArray[np.int64]:
    """Return the registers by which laws are closed, and hold components: all are open where these are zero."""
    form = plan.reduced.switched
    laws = [] if form is None else [form.closed, form.push, form.direction[form.direction != NONE]]
    closing = plan.reduced.register_of[np.concatenate([*laws, np.zeros(0, int)]).astype(int)]
    return np.concatenate([closing, plan.held[plan.held >= 0]])
