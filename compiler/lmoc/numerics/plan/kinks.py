"""Times at which formulas of time alone jump or have a kink: the integrators stop and start again there.

A step input, a pulse, a ramp with a corner: a method of high order loses its accuracy over them, and a short pulse
may fall between two steps unseen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import TIME, Expr, depends_on_time, function, postorder, slots
from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply, walk
from lmoc.numerics.plan.plan import Plan

_DIFFERENCE = frozenset("lt le gt ge min max".split())  # something happens where the arguments are equal
_ZERO = frozenset("abs sign".split())  # … where the argument is zero
_STAIRS = frozenset("floor ceil integer mod rem div_integer".split())  # … where it, or the quotient, is a whole number
_PART = dict.fromkeys(_STAIRS, 1.0) | dict.fromkeys(("sin", "cos", "tan"), math.pi / 2)
_SAMPLES = 4001  # even points at which a switch that is not linear in time is looked at
_ASIDE = 1e-6  # of the distance between two places, to either side of which is looked
NEAR = 1e-12  # of the times of a run: what is as near to its start or its stop is there
MOST = 100_000  # kinks at which a run stops


def switches(plan: Plan) -> list[tuple[Expr, np.ndarray]]:
    """Expressions of time and parameters whose zeros or jumps are kinks, and the registers of their columns by rows."""
    fixed = np.zeros(plan.count, bool)
    fixed[plan.parameters] = True
    found: dict[tuple[Expr, bytes], np.ndarray] = {}
    for step in walk(plan.program):
        if isinstance(step, Apply) and depends_on_time(step.shape):
            for expression in _candidates(step.shape):
                columns = sorted({leaf.value[0] for leaf in slots(expression)})
                rows = fixed[step.slots[:, columns]].all(axis=1)
                if rows.any():
                    found[expression, step.slots[rows].tobytes()] = step.slots[rows]
    return [(expression, registers) for (expression, _), registers in found.items()]


def _candidates(shape: Expr) -> Iterator[Expr]:
    for node in postorder(shape):
        if node.op in _DIFFERENCE:
            expression = node.args[0] - node.args[1]
        elif node.op in _ZERO:
            expression = node.args[0]
        elif node.op in _STAIRS:
            expression = function("ceil" if node.op == "ceil" else "floor", _quotient(node))
        else:
            continue
        if depends_on_time(expression):
            yield expression


def _quotient(node: Expr) -> Expr:
    """Return the expression that is an integer where a function of `_STAIRS` jumps."""
    return node.args[0] / node.args[1] if len(node.args) == 2 else node.args[0]


def break_times(plan: Plan, base: np.ndarray, start: float, stop: float) -> np.ndarray:
    """The kinks from one time to another, in order; at most `MOST`.

    Those at the ends count, also where rounding puts them beside: the first and the last stage of the run would see the
    other side of the jump.

    Parameters
    ----------
    base : registers that do not change during the run (`Plan.base`)
    """
    if not plan.once(switches):
        return np.zeros(0)
    times, margin = [np.zeros(0)], NEAR * max(abs(start), abs(stop))
    for expression, registers in plan.once(switches):
        linear = linear_parts(expression, [TIME])
        if linear is None:
            times += [_sampled(expression, base[row], start, stop + margin) for row in np.unique(registers, axis=0)]
        else:
            parts, rest = linear
            columns = base[registers].T
            slope, offset = (evaluate(e, lambda k, _: columns[k]) for e in (parts[TIME], rest))  # noqa: B023
            with np.errstate(all="ignore"):
                times.append(np.ravel(-np.asarray(offset) / np.asarray(slope)))
    every = np.unique(np.concatenate(times))
    every = every[(every >= start - margin) & (every <= stop + margin)] + 0.0  # no -0
    every[every < start + margin], every[every > stop - margin] = start, stop
    return every[np.diff(every, prepend=-np.inf) > margin][:MOST]


def _sampled(expression: Expr, parameters: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Changes of sign of an expression of time, or jumps of one rounded to whole numbers, located by bisection."""

    def values(of: Expr, t: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.broadcast_to(evaluate(of, lambda k, _: parameters[k], t), t.shape)

    def level(t: np.ndarray) -> np.ndarray:
        return values(expression, t) if expression.op in _STAIRS else values(expression, t) > 0

    grid = _grid(expression, values, np.linspace(start, stop, _SAMPLES))
    before = level(grid)
    change = np.flatnonzero(before[1:] != before[:-1])
    low, high, left = grid[change], grid[change + 1], before[change]
    for _ in range(60):
        middle = (low + high) / 2
        same = level(middle) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return high


def _grid(expression: Expr, values: Callable[[Expr, np.ndarray], np.ndarray], even: np.ndarray) -> np.ndarray:
    """Return points at which to sample the sign of an expression: evenly, without a turn or jump between two points.

    A function that repeats itself turns or jumps where its argument, divided by `_PART`, is a whole number. Points on
    both sides of these places see every change of a sign that depends on one such function alone, however short.
    """
    points = [even]
    for node in postorder(expression):
        if node.op in _PART and depends_on_time(node):
            argument = _quotient(node) if node.op in _STAIRS else node.args[0]
            count = values(argument, even) / _PART[node.op]
            rise = np.diff(count)
            if not np.isfinite(rise).all():
                continue
            if (rise > 0).all() or (rise < 0).all():
                whole = np.arange(math.ceil(count.min()), math.ceil(min(count.max(), count.min() + MOST)))
                at = np.interp(whole, *((count, even) if rise[0] > 0 else (count[::-1], even[::-1])))
                aside = _ASIDE * (even[-1] - even[0]) / max(1, len(whole))
                points += [at - aside, at + aside]
            else:
                points.append(np.linspace(even[0], even[-1], min(4 * MOST, int(4 * np.abs(rise).sum()))))
    return np.clip(np.unique(np.concatenate(points)), even[0], even[-1])
