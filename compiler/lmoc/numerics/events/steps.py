"""Values that step at an instant while the equations hold derivatives of them, such as a prescribed position.

Inputs may step, and what discrete values decide about. Where only the work of the source needs the derivative, that is
what the scene stores more after the step; where the motion needs it, velocities jump (`impulse`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.flat import FlatDAE
from lmoc.ir.law import NONE
from lmoc.ir.program import needed_steps, read, walk, written
from lmoc.numerics.events.impulse import Array, JumpInstant, NoImpulse, PlanValues, Push, way
from lmoc.numerics.observe.readout import Readout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

_CONTINUOUS = 1e-9  # share of a value by which it may change at an event and still be continuous
_BENT = 1e-2  # share of what a variable changes from one place nearby to the next
_BESIDE = 1e-13  # s, or this share of the time: what lies just before an instant, and just after it


@dataclass(frozen=True, eq=False)
class Jump:
    """The effect of a step.

    Attributes
    ----------
    name, before, after : of the variable that steps, and its values
    x : states after it
    moved : velocities have jumped
    work : J, of the source; NaN where it is infinite
    """

    name: str
    before: float
    after: float
    x: Array
    moved: bool
    work: float


class Steps:
    """The variables that inputs and discrete values decide about and that have derivatives in a plan.

    Attributes
    ----------
    lower, upper : (k,) registers: a variable or its derivative, and the derivative of that
    origin : (k,) registers of the variables
    second : (k,) whether `upper` is a second derivative
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        pairs = sorted(_own_jets(plan) | _input_jets(plan))
        firsts = {a: b for a, b, order in pairs if order == 1}
        rows = [(a if order == 1 else firsts.get(a, NONE), b, a, order == 2) for a, b, order in pairs]
        table = np.array(rows, int).reshape(-1, 4)
        self.lower, self.upper, self.origin, self.second = *table[:, :3].T, table[:, 3] > 0
        self.registers = np.unique(np.concatenate([self.lower[self.lower != NONE], self.origin]))
        stored = plan.reduced.flat.find("ledger.stored")
        register = -1 if stored is None else int(plan.reduced.register_of[stored[0]])
        self.stored = register >= 0 and len(self.registers) > 0
        wanted = np.append(self.registers, register) if self.stored else self.registers
        self.readout = Readout(plan, plan.full_program, plan.count, wanted)
        self._rates: PlanValues | None = None

    def __bool__(self) -> bool:
        return len(self.registers) > 0

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """(k,) whether the motion reads a derivative of a register, for those who do not go through impulses."""
        plan, read_by = self.plan, np.zeros(self.plan.count, bool)
        for step in walk(needed_steps(plan.program, plan.derivatives, plan.count)):
            read_by[read(step)] = True
        needed = self.origin[read_by[self.upper]]
        return np.isin(self.registers, needed)

    def is_moved_by(self, variables: NDArray[np.int64]) -> bool:
        """Return whether the motion depends on a derivative of any of these inputs: their steps are impulses."""
        reduced = self.plan.reduced
        register, variable, _ = reduced.inputs
        own = np.concatenate([reduced.register_of[variables], register[np.isin(variable, variables)]])
        return bool(np.isin(self.registers[self.moving], own).any())

    def values(self, t: float, x: Array, base: Array, signals: Mapping[int, Signal]) -> Array:
        """Return the values of `registers`, and the stored energy after them."""
        self.readout.prepare(base, signals)
        return self.readout(t, x).copy()

    def jump(self, t: float, x: Array, before: Array, after: Array, signals: Mapping[int, Signal]) -> Jump | None:
        """Return what steps at an instant, and what it does; None where nothing steps.

        Parameters
        ----------
        before, after : registers that do not change between events, as they are on both sides

        Raises
        ------
        NoImpulse
        """
        if not self:
            return None
        old, new, change = self._change(t, x, before, after, signals)
        if not change.any():
            return None
        steps = dict(zip(self.registers.tolist(), change.tolist(), strict=True))
        old_of = dict(zip(self.registers.tolist(), old.tolist(), strict=False))
        jumping = {r: d for r, d in steps.items() if d}
        rows = list(zip(self.lower.tolist(), self.upper.tolist(), self.origin.tolist(), self.second, strict=True))
        impulse = {upper: jumping[lower] for lower, upper, _, _ in rows if lower in jumping}
        double = {upper: jumping[origin] for _, upper, origin, second in rows if second and origin in jumping}
        if self._rates is None:
            self._rates = PlanValues(self.plan)
        instant, left = JumpInstant(t, after, signals), {r: old_of[r] for r in jumping}
        push = Push(self._rates, instant, left, jumping, impulse, double)
        register = next(iter(jumping))
        name, value = self.plan.reduced.register_name(register), old_of[register]
        try:
            if double and push.needs_second(x):
                raise NoImpulse(
                    "the motion needs its second derivative, which is more than an impulse there "
                    "(give a ramp of finite length instead of a step)"
                )
            moved = way(push, x)
        except NoImpulse as none:
            what = f"'{name}' jumps from {value:.6g} to {value + jumping[register]:.6g} at t = {t:.6g} s"
            raise NoImpulse(f"{what}, and {none}") from None
        work = np.nan
        if not push.is_endless(x):
            work = float(self.values(t, x + moved, after, signals)[-1] - old[-1]) if self.stored else 0.0
        return Jump(name, value, value + jumping[register], x + moved, bool(moved.any()), work)

    def _change(
        self, t: float, x: Array, before: Array, after: Array, signals: Mapping[int, Signal]
    ) -> tuple[Array, Array, Array]:
        """Return the values on both sides of an instant, and what the variables jump by; otherwise as `jump`.

        Inputs are functions of time: what they are at the instant itself follows from two values on each side.
        """
        if before is after:
            aside = _BESIDE * max(1.0, abs(t))
            near, far = ([self.values(t + k * s * aside, x, after, signals) for s in (-1, 1)] for k in (1, 2))
            (old, new), bends = (2 * n - f for n, f in zip(near, far, strict=True)), sum(map(_bend, near, far))
        else:
            old, new, bends = *(self.values(t, x, b, signals) for b in (before, after)), 0.0
        count = len(self.registers)
        change = (new - old)[:count]
        small = _CONTINUOUS * np.maximum(np.abs(old), np.abs(new)) + bends
        return old, new, np.where(np.abs(change) <= small[:count], 0.0, change)


def _bend(near: Array, far: Array) -> Array:
    return _BENT * np.abs(near - far)


def _input_jets(plan: Plan) -> set[tuple[int, int, int]]:
    """Return the derivatives of inputs that a plan has: (register of the input, of the derivative, order)."""
    form, events = plan.reduced.switched, plan.reduced.flat.events
    held = set() if form is None else {*form.closed.tolist(), *form.push.tolist(), *form.direction.tolist()}
    held |= set() if events is None else set(events.discrete.tolist())
    own = [(v, order, r) for r, v, order in plan.reduced.inputs.T.tolist() if v not in held]
    place = {v: r for v, order, r in own if order == 0} | {
        v: int(plan.reduced.register_of[v]) for v, _, _ in own if plan.reduced.register_of[v] >= 0
    }
    return {(place[v], r, order) for v, order, r in own if 1 <= order <= 2 and v in place}


def _own_jets(plan: Plan) -> set[tuple[int, int, int]]:
    """Return the same of variables that depend on discrete ones."""
    reduced = plan.reduced
    table, flat = reduced.registers, reduced.flat
    if flat.events is None:
        return set()
    changing = np.zeros(plan.count, bool)
    changing[reduced.register_of[flat.events.discrete]] = True
    changing[plan.states] = False
    for step in plan.full_program:
        if any(changing[read(s)].any() for s in walk((step,))):
            changing[written(step)] = True
    above = np.flatnonzero((table.order >= 1) & (table.variable >= 0))
    pairs = {(int(reduced.register_of[table.variable[k]]), int(k), int(table.order[k])) for k in above.tolist()}
    jets = {(a, b, 1) for a, b in _declared_jets(flat, reduced.register_of)}
    pairs |= jets | {(a, c, 2) for a, b, _ in jets for other, c, _ in jets if other == b}
    return {p for p in pairs if p[0] >= 0 and p[1] >= 0 and p[2] <= 2 and changing[p[0]]}


def _declared_jets(flat: FlatDAE, register_of: NDArray[np.int64]) -> set[tuple[int, int]]:
    """Return the registers of variables and of those that are declared as their derivatives, ``der(q) = v``."""
    found = set()
    for group in flat.groups:
        for side, other in ((group.left, group.right), (group.right, group.left)):
            if side.op == other.op == "slot" and side.value[1] == 1 and other.value[1] == 0:
                columns = [side.value[0], other.value[0]]
                found |= {(a, b) for a, b in register_of[group.slots[:, columns]].tolist()}
    return found
