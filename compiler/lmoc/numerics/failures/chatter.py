"""The jump of a formula, outside of events, that a motion crosses from both sides without getting on.

Where the rates on both sides of a jump lead back to it, there is no solution but to slide along it (A. F. Filippov,
Differential Equations with Discontinuous Righthand Sides, 1988), and steps that look for one become ever shorter.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.expression.dag import Expr, nodes_outside_events, slots, sub
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Group, Kind
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.support.distinct import distinct

FRICTION_HINT = "for dry friction or stops use the library's DryFriction, Clutch, Stop; else a switch with hysteresis"
_RELATIONS = ("lt", "le", "gt", "ge")
_AROUND = 1e-7  # of the run: how far to both sides of a place a jump is looked for
_ASIDE = 1e-3  # of that: how far the rates are followed there

TimeAndState = tuple[float, np.ndarray]
Jump = tuple[Group, Expr]


def jumps(plan: Plan) -> tuple[Jump, ...]:
    """Return the equations with jumps that are no events, each with what changes its sign there."""
    flat = plan.reduced.flat
    found = ((g, zero) for g in flat.groups for side in (g.left, g.right) for zero in _zeros(side))
    return tuple((g, zero) for g, zero in found if (flat.kind[g.slots[:, _columns(zero)]] == Kind.UNKNOWN).any())


def _columns(expression: Expr) -> list[int]:
    return sorted({leaf.value[0] for leaf in slots(expression)})


def _zeros(root: Expr) -> Iterator[Expr]:
    """Yield what changes its sign where an expression jumps outside of events, where it is one of variables."""
    for node in nodes_outside_events(root):
        zero = node.args[0] if node.op == "sign" else sub(*node.args) if node.op in _RELATIONS else None
        leaves = () if zero is None else slots(zero)
        if leaves and all(leaf.value[1] == 0 for leaf in leaves):
            yield zero


@np.errstate(all="ignore")
def chatters(found: tuple[Jump, ...], observer: Observer, system: System, place: TimeAndState, span: float) -> str:
    """Describe the formula whose jump holds a motion at a place; empty where none does.

    Parameters
    ----------
    found : as from `jumps`
    span : s, of the whole run
    """
    t, x = place
    rate, distance = _rate(system, t, x), _AROUND * span
    if not np.isfinite(rate).all():
        return ""
    sides = [(t, x - distance * rate), (t, x + distance * rate)]
    followed = [(t, y + _ASIDE * distance * _rate(system, t, y)) for _, y in sides]
    for group, zero in found:
        before, behind, before_on, behind_on = (_values(observer, group, zero, p) for p in (*sides, *followed))
        held = (before * behind < 0) & (before * (before_on - before) < 0) & (behind * (behind_on - behind) < 0)
        if held.any():
            name = observer.flat.parts[group.part].pattern or observer.flat.name
            written = group.span or observer.flat.parts[group.part].span
            text = "" if written is None else f", '{written.text}' ({written.source.name}, line {written.line}),"
            return f"an equation of {name}{text} jumps back and forth: motion on both sides leads back to the jump"
    return ""


def _rate(system: System, t: float, x: np.ndarray) -> np.ndarray:
    out = np.empty(len(x))
    system.rhs(t, x, out)
    return out


def _values(observer: Observer, group: Group, zero: Expr, place: TimeAndState) -> np.ndarray:
    """Yield what changes its sign at a jump, one value a row of the group."""
    variables = distinct(group.slots[:, _columns(zero)].ravel())
    values = observer(variables, np.array([place[0]]), place[1][None])[0]
    result = evaluate(zero, lambda k, _: values[np.searchsorted(variables, group.slots[:, k])], place[0])
    return np.broadcast_to(np.asarray(result, float), len(group.slots))
