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
from lmoc.support.records import dataclass

FRICTION_HINT = "for dry friction or stops use the library's DryFriction, Clutch, Stop; else a switch with hysteresis"
_RELATIONS = ("lt", "le", "gt", "ge")
_AROUND, _STEPS = 1e-7, 10  # of the run, and steps: how far to both sides of a place a jump is looked for at the most
_ASIDE = 1e-3  # of that: how far the rates are followed there
_HALVINGS = 10  # until a jump is known to the thousandth part of that
_ROWS = 8  # of a group are looked at so closely

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
def chatters(
    found: tuple[Jump, ...], observer: Observer, system: System, place: TimeAndState, span: float, step: float
) -> str:
    """Describe the formula whose jump holds a motion at a place; empty where none does.

    Parameters
    ----------
    found : as from `jumps`
    span : s, of the whole run
    step : s, length of the latest steps: the jump that holds a motion is within a few of them. Farther away are others,
        which an oscillation of nanoseconds in a run of one second meets on its way, too
    """
    t, x = place
    rate, distance = _rate(system, t, x), min(_AROUND * span, _STEPS * step)
    if not np.isfinite(rate).all():
        return ""
    for jump in found:
        along = _Along(jump, observer, system, t, x, rate)
        if any(along.held_at(int(row), distance) for row in np.flatnonzero(along.held(-distance, distance))[:_ROWS]):
            group = jump[0]
            name = observer.flat.parts[group.part].pattern or observer.flat.name
            written = group.span or observer.flat.parts[group.part].span
            text = "" if written is None else f", '{written.text}' ({written.source.name}, line {written.line}),"
            return f"an equation of {name}{text} jumps back and forth: motion on both sides leads back to the jump"
    return ""


@dataclass(frozen=True, eq=False)
class _Along:
    """What changes its sign at a jump, along the line x + s·rate through a place: one value a row of the group."""

    jump: Jump
    observer: Observer
    system: System
    t: float
    x: np.ndarray
    rate: np.ndarray

    def value(self, s: float) -> np.ndarray:
        return _values(self.observer, *self.jump, (self.t, self.x + s * self.rate))

    def held(self, low: float, high: float) -> np.ndarray:
        """Return the rows that change their sign between two places, and whose motion leads back from both."""
        return (self.value(low) * self.value(high) < 0) & self._leads_back(low, high) & self._leads_back(high, low)

    def _leads_back(self, s: float, other: float) -> np.ndarray:
        y, now = self.x + s * self.rate, self.value(s)
        ahead = y + _ASIDE * abs(other - s) * _rate(self.system, self.t, y)
        return now * (_values(self.observer, *self.jump, (self.t, ahead)) - now) < 0

    def held_at(self, row: int, distance: float) -> bool:
        """Return whether a row is held just beside its jump, too: a fast oscillation turns back farther away."""
        low, high = -distance, distance
        below = self.value(low)[row] < 0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if (self.value(middle)[row] < 0) == below else (low, middle)
        return bool(self.held(low, high)[row])


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
