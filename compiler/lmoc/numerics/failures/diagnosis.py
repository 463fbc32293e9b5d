"""Diagnosis of the variable that became NaN or infinite first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.program import Program, Solve, walk, written
from lmoc.ir.reduced import Reduced
from lmoc.messages.ranges import over_range
from lmoc.messages.source import Span
from lmoc.numerics.coordinates.change import block_unknowns
from lmoc.numerics.failures.nan_sources import MovingRisks, moving, nan_sources
from lmoc.numerics.limits import NUMBERS
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import Slice, slice_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal, is_own, sample
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.support.distinct import distinct
from lmoc.support.sizes import DENSE

_AHEAD = 40  # halvings of the distance at which a lost value is looked for
_FOLLOWED = 25  # times at which nonlinear equations are solved, to see whether they can be
_WITHOUT_BOUND = 1e6  # times its size during the run: a state that changes as fast has no bound
_SUSPECTS = 10  # of the times at which something seems to be lost, so many are looked at closely


@np.errstate(all="ignore")
def lost_ahead(observer: Observer, system: System, time: float, x: np.ndarray, stop: float) -> str:
    """Describe what has no finite value at (time, x), or else a little further along the motion; empty if nothing."""
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


@np.errstate(all="ignore")
def fastest(observer: Observer, system: System, time: float, x: np.ndarray, sizes: np.ndarray, span: float) -> str:
    """Describe the state that changes without bound where the step size has collapsed; empty where none does.

    Parameters
    ----------
    sizes : (n,) of the states along the way
    span : s, of the whole run
    """
    rate = np.empty(len(x))
    system.rhs(time, x, rate)
    reduced = observer.plan.reduced
    changes = np.abs(rate) * span / np.maximum(np.abs(x), sizes)  # in sizes, if it went on like this
    names = [reduced.register_name(int(register)) for register in observer.plan.states]
    changes[[name.startswith("ledger.") for name in names]] = 0.0  # work follows from the motion
    if not len(changes) or not np.isfinite(changes).all() or changes.max() < _WITHOUT_BOUND:
        return ""
    k = int(changes.argmax())
    place = _place(reduced.flat, int(reduced.registers.variable[observer.plan.states[k]]))
    where = "" if place is None or place.source is None else f" ({place.source.name}, line {place.line})"
    return f"{names[k]}{where} changes without bound; it is {x[k]:.3g} there, and its rate {rate[k]:.3g}"


def suspects(observer: Observer, times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Numbers of those times at which a value may have been lost, a few of them if there are many; in order.

    What is seen is what can be computed for many times at once; and a quotient that has no value need not be missed
    (``if x > 0 then 1/x else 0``).
    """
    plan = observer.plan
    own = plan.once(moving_risks)
    if not len(own.registers):
        return np.zeros(0, int)
    part = plan.once(_moving_slice)
    base = np.concatenate([observer.base, np.zeros(own.count - plan.count)])
    base[plan.absent] = 0.0  # what depends on them has been said to be unknown
    rows = np.arange(0, len(times), -(-len(times) * len(part.registers) // NUMBERS))
    values = part.bind(base, observer.signals)(times[rows], states[rows])
    lost = rows[~np.isfinite(values).all(axis=1)]
    return lost[np.unique(np.linspace(0, len(lost) - 1, _SUSPECTS).astype(int))] if len(lost) else lost


def first_not_finite(
    observer: Observer,
    time: float,
    x: np.ndarray,
    program: Program | None = None,
    near: np.ndarray | None = None,
    solved: bool = False,
) -> tuple[str, Span | None, bool]:
    """A sentence about the first variable that has no finite value at (time, x), where it is declared, and whether it
    is an unknown of nonlinear equations without a solution.

    Empty where all have one.

    Parameters
    ----------
    program : what is looked at, without it what the derivatives need
    near : (plan.count,) registers at about this time: where to look for the solutions of nonlinear equations
    solved : they are the registers at just this place, with finite derivatives
    """
    plan, reduced = observer.plan, observer.plan.reduced
    w = observer.base.copy()
    if program is None:
        program = plan.program
    else:
        w[plan.absent] = 0.0  # what depends on them has been said to be unknown
    if near is not None:
        unknowns = plan.once(block_unknowns)
        w[unknowns] = near[unknowns]
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = sample(observer.signals[variable], order, np.array([time]))[0]
    groups = [plan.states, plan.sampled]
    if program is plan.full_program:  # most often all is well, which a look at what may be lost tells
        _, watched, count = plan.once(_losable)
        interpreter = plan.once(_rest_interpreter if solved else _losable_interpreter)
        longer = np.concatenate([near if solved else w, np.zeros(count - len(w))])
        longer[plan.absent] = 0.0
        interpreter.reset()
        interpreter.run(longer, time)
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
                    return *sentence(reduced, bad, w, nonlinear, observer.signals), nonlinear
    return "", None, False


def unsolved(observer: Observer, times: np.ndarray, states: np.ndarray) -> tuple[str, Span | None, float] | None:
    """Describe nonlinear equations for which no solution is found, its place, and the time.

    None where all have one. They are followed over some of the times, as when somebody asks for their unknowns; where
    that loses one, over all of these times.
    """
    plan = observer.plan
    registers = plan.once(_followed)
    if not len(registers):
        return None
    values = observer.followed(slice_of(plan, registers))
    for which in (np.unique(np.linspace(0, len(times) - 1, _FOLLOWED).astype(int)), np.arange(len(times))):
        lost = np.argwhere(~np.isfinite(values(times[which], states[which])))
        if not len(lost):
            return None
    row, column = lost[0].tolist()
    first, nothing = registers[column : column + 1], np.full(plan.count, np.nan)
    return *sentence(plan.reduced, first, nothing, True, observer.signals), float(times[row])


def _followed(plan: Plan) -> np.ndarray:
    """Return the unknowns of nonlinear blocks."""
    blocks = [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
    found = distinct(np.concatenate([np.zeros(0, int), *blocks]))
    return found[found < plan.reduced.registers.count]


def _losable(plan: Plan) -> tuple[Program, np.ndarray, int]:
    """Return what tells whether `full_program` loses a value (`nan_sources.nan_sources`)."""
    return nan_sources(plan.full_program, plan.count)


def _losable_interpreter(plan: Plan) -> Interpreter:
    steps, _, count = plan.once(_losable)
    return Interpreter(steps, count)


def _rest_interpreter(plan: Plan) -> Interpreter:
    """Of these steps the ones that the derivatives do not need."""
    steps, _, count = plan.once(_losable)
    done = np.zeros(count, bool)
    for step in plan.program:
        done[written(step)] = True
    return Interpreter(tuple(s for s in steps if not done[written(s)].all()), count)


def moving_risks(plan: Plan) -> MovingRisks:
    """Return the part of `nan_sources` that has to be looked at along a run (`nan_sources.moving`)."""
    sources = np.concatenate([plan.states, plan.sampled, _switching(plan)])
    return moving(plan.once(_losable), sources, DENSE, plan.program)


def _switching(plan: Plan) -> np.ndarray:
    """The registers of discrete variables, which change from segment to segment."""
    flat = plan.reduced.flat
    registers = plan.reduced.register_of[np.flatnonzero(flat.kind == Kind.DISCRETE)]
    return registers[registers >= 0]


def _moving_slice(plan: Plan) -> Slice:
    found = plan.once(moving_risks)
    return Slice(plan, found.registers, found.program, found.count)


def sentence(
    reduced: Reduced, bad: np.ndarray, w: np.ndarray, nonlinear: bool, signals: Mapping[int, Signal]
) -> tuple[str, Span | None]:
    """Describe registers without a finite value, all filled by the same step, and the place of the first in the
    model, where it is not a signal that the caller has given.

    Parameters
    ----------
    nonlinear : they are unknowns of nonlinear equations
    """
    named = [r for r in bad.tolist() if r < reduced.registers.count and reduced.registers.variable[r] >= 0]
    if not named:
        return "an intermediate result has no finite value", None
    variable = int(reduced.registers.variable[named[0]])
    name = _names(reduced, named)
    if variable in signals and not is_own(signals[variable], reduced.flat, variable):
        return f"the signal given for the input {name} has no finite value ({w[named[0]]})", None
    span = _place(reduced.flat, variable)
    if nonlinear:
        return f"the nonlinear equations for {name} have no solution that Newton's method finds", span
    return f"{name} has no finite value ({w[named[0]]})", span


def _names(reduced: Reduced, registers: list[int]) -> str:
    """The first of some registers, with those of the same array: as a range if they fill one, else their number."""
    flat, first = reduced.flat, registers[0]
    block, order = flat.block_at(int(reduced.registers.variable[first])), reduced.registers.order[first]
    variables, orders = reduced.registers.variable[registers], reduced.registers.order[registers]
    inside = (variables >= block.offset) & (variables < block.offset + block.size) & (orders == order)
    names = [flat.jet_name(v, int(order)) for v in distinct(variables[inside]).tolist()]
    return over_range(names) or f"{reduced.register_name(first)} (and {len(names) - 1} more of its array)"


def _place(flat: FlatDAE, variable: int) -> Span | None:
    """Return where the user declared the part with this variable, else the variable's own declaration."""
    block = flat.block_at(variable)
    part = flat.parts[block.part].span if 0 < block.part < len(flat.parts) else None
    return part or block.span
