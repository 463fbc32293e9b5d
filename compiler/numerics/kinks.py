"""Times at which formulas of time alone jump or have a kink: the integrators stop and start again there.

A step input, a pulse, a ramp with a corner: a method of high order loses its accuracy over them, and a short pulse
may fall between two steps unseen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import TIME, Expr, depends_on_time, function, postorder, slots
from lmoc.expression.evaluate import evaluate
from lmoc.numerics.plan import Plan, walk
from lmoc.structure.program import Apply

_DIFFERENCE = frozenset("lt le gt ge min max".split())  # something happens where the arguments are equal
_ZERO = frozenset("abs sign".split())  # … where the argument is zero
_STAIRS = frozenset("floor ceil integer mod rem div_integer".split())  # … where it, or the quotient, is a whole number
_SAMPLES = 4001  # points at which a switch that is not linear in time is looked at
_MOST = 10_000


def switches(plan: Plan) -> list[tuple[Expr, np.ndarray]]:
    """Expressions of time and parameters whose zeros are kinks, with the registers of their columns, one row each."""
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
            quotient = node.args[0] / node.args[1] if len(node.args) == 2 else node.args[0]
            expression = function("sin", quotient * math.pi)
        else:
            continue
        if depends_on_time(expression):
            yield expression


def break_times(plan: Plan, base: np.ndarray, start: float, stop: float) -> np.ndarray:
    """The kinks strictly between two times, in order.

    Parameters
    ----------
    base : registers that do not change during the run (`Plan.base`)
    """
    times = [np.zeros(0)]
    for expression, registers in plan.switches:
        linear = linear_parts(expression, [TIME])
        if linear is None:
            times += [_sampled(expression, base[row], start, stop) for row in np.unique(registers, axis=0)]
        else:
            parts, rest = linear
            columns = base[registers].T
            slope, offset = (evaluate(e, lambda k, _: columns[k]) for e in (parts[TIME], rest))  # noqa: B023
            with np.errstate(all="ignore"):
                times.append(np.ravel(-np.asarray(offset) / np.asarray(slope)))
    every = np.unique(np.concatenate(times))
    margin = 1e-12 * max(abs(start), abs(stop))
    every = every[(every > start + margin) & (every < stop - margin)][:_MOST]
    return every[np.diff(every, prepend=-np.inf) > margin]


def _sampled(expression: Expr, parameters: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Changes of sign of an expression of time, located by bisection."""

    def positive(t: np.ndarray) -> np.ndarray:
        return np.broadcast_to(evaluate(expression, lambda k, _: parameters[k], t), t.shape) > 0

    grid = np.linspace(start, stop, _SAMPLES)
    sign = positive(grid)
    change = np.flatnonzero(sign[1:] != sign[:-1])
    low, high, left = grid[change], grid[change + 1], sign[change]
    for _ in range(60):
        middle = (low + high) / 2
        same = positive(middle) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return high
