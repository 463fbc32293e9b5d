"""Values that step at an instant while the equations hold derivatives of them, such as a prescribed position.

Inputs may step, and what discrete values decide about. Where only the work of the source needs the derivative, that is
what the scene stores more after the step; where the motion needs it, velocities jump (`impulse`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.jump import ENDLESS, JUMPED, JumpOfStates, reason, steps_between
from lmoc.ir.flat import FlatDAE
from lmoc.ir.law import NONE
from lmoc.ir.program import needed_steps, read, walk, written
from lmoc.numerics.events.impulse import GivenProgram, NoImpulse, given_program, law_registers
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.observe.readout import Readout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.structure.laws.degree import dependent
from lmoc.support.records import dataclass

Array = NDArray[np.float64]

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
        self._moved: dict[bytes, bool] = {}  # by the variables asked for
        pairs = sorted(_own_jets(plan) | _input_jets(plan))
        firsts = {a: b for a, b, order in pairs if order == 1}
        rows = [(a if order == 1 else firsts.get(a, NONE), b, a, order == 2) for a, b, order in pairs]
        table = np.array(rows, int).reshape(-1, 4)
        self.lower, self.upper, self.origin, self.second = *table[:, :3].T, table[:, 3] > 0
        self.registers = np.unique(np.concatenate([self.lower[self.lower != NONE], self.origin]))
        self.stored = plan.stored >= 0 and len(self.registers) > 0
        wanted = np.append(self.registers, plan.stored) if self.stored else self.registers
        self.readout = Readout(plan, plan.full_program, plan.count, wanted)

    @cached_property
    def tables(self) -> tuple[Array, ...]:
        """The tables of `engine/c/jump.h`, but for the ledger."""
        place = np.full(self.plan.count + 1, NONE)  # the last one: there is none
        place[self.given] = np.arange(len(self.given))
        return place[self.lower], place[self.upper], place[self.origin], self.second

    @cached_property
    def given(self) -> NDArray[np.int64]:
        """Registers that can be given: `registers`, then the derivatives that are not among them."""
        return np.concatenate([self.registers, np.setdiff1d(self.upper, self.registers)])

    @cached_property
    def program(self) -> GivenProgram:
        """The rates where some of `given` are given."""
        return given_program(self.plan, self.given, self.upper)

    @cached_property
    def _rates(self) -> Readout:
        return Readout(self.plan, self.program.steps, self.program.count, self.program.results)

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
        key = variables.tobytes()  # asked again with every value of an input of a scene that is stepped
        if key not in self._moved:
            reduced = self.plan.reduced
            register, variable, _ = reduced.inputs
            own = np.concatenate([reduced.register_of[variables], register[np.isin(variable, variables)]])
            self._moved[key] = bool(np.isin(self.registers[self.moving], own).any())
        return self._moved[key]

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
        old, change = self._change(t, x, before, after, signals)
        stored_before, count = old[-1], len(self.registers)
        old, change = (np.concatenate([v[:count], np.zeros(len(self.given) - count)]) for v in (old, change))
        if not change.any():
            return None
        jump = self._of_states(t, after, signals)
        status, moved = jump.states(old, change, x)
        first = int(np.flatnonzero(change)[0])
        name, value = self.plan.reduced.register_name(int(self.given[first])), old[first]
        behind = value + change[first]
        if status != JUMPED:
            what = f"'{name}' jumps from {value:.6g} to {behind:.6g} at t = {t:.6g} s"
            raise NoImpulse(f"{what}, and {reason(status)}")
        work = np.nan
        if jump.work(old, change, x) != ENDLESS:
            work = float(self.values(t, x + moved, after, signals)[-1] - stored_before) if self.stored else 0.0
        return Jump(name, value, behind, x + moved, bool(moved.any()), work)

    def _of_states(self, t: float, after: Array, signals: Mapping[int, Signal]) -> JumpOfStates:
        own = self.program
        base = np.concatenate([after, np.zeros(own.count - len(after))])
        base[law_registers(self.plan)] = 0.0

        def values(x: Array, which: Array, given: Array) -> Array:
            base[own.which], base[own.given] = which, given
            self._rates.prepare(base, signals)
            return self._rates(t, x)

        judged = len(own.results) - len(self.plan.derivatives)
        return JumpOfStates((*self.tables, self.plan.ledger), len(self.given), judged, values)

    def _change(
        self, t: float, x: Array, before: Array, after: Array, signals: Mapping[int, Signal]
    ) -> tuple[Array, Array]:
        """Return the values before an instant, and what they step by; otherwise as `jump`.

        Inputs are functions of time: what they are at the instant itself follows from two values on each side.
        """
        if before is after:
            aside = _BESIDE * max(1.0, abs(t))
            every = [self.values(t + k * aside, x, after, signals) for k in (-1, -2, 1, 2)]
        else:
            every = [self.values(t, x, b, signals) for b in (before, before, after, after)]
        (old, _), change = steps_between(np.stack(every))
        return old, change


def moving_relations(plan: Plan) -> NDArray[np.int64]:
    """Return the rows of the relations of time of a scene that decide about what has derivatives: a jump of it at the
    start is one."""
    layout, jets = plan.once(EventLayout), plan.once(Steps).registers
    found = [np.zeros(0, int)]
    for timed in layout.timed if len(jets) else ():
        relations = layout.events.relations[timed.relation]
        own = plan.reduced.register_of[relations.target]
        if not relations.of_package and dependent(plan.full_program, own, plan.count)[jets].any():
            found.append(np.arange(layout.first[timed.relation], layout.first[timed.relation + 1]))
    return np.unique(np.concatenate(found))


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
