"""The discrete equations of a scene as tables and programs over one memory (``engine/c/instant.h``)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lmoc.expression.dag import Expr, slot
from lmoc.ir.flat import Kind
from lmoc.ir.program import Apply, Program
from lmoc.lower.blocks import values_tape
from lmoc.numerics.events.happened import Happened
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass

OPS = ("gt", "ge", "floor")  # in the order of the constants in C
NONE = np.zeros(0, int)


class Memory:
    """Gives out places: those of the variables of the flat model come first.

    Attributes
    ----------
    size : places so far
    """

    def __init__(self, size: int) -> None:
        self.size = size

    def new(self, count: int) -> np.ndarray:
        """Return places of their own."""
        self.size += count
        return np.arange(self.size - count, self.size)

    def places(self, variables: np.ndarray) -> np.ndarray:
        """Return where variables of the flat model have their values."""
        return np.asarray(variables, int)

    def values(self, shape: Expr, variables: np.ndarray) -> tuple[Apply, np.ndarray]:
        """Return the step that computes an expression for all rows of a table, and its places."""
        out = self.new(len(variables))
        return Apply(shape, self.places(variables), out), out


@dataclass(frozen=True, eq=False)
class Condition:
    """Something that is told of an event: where expressions are zero, or where they are not.

    Attributes
    ----------
    shape, slots : the expressions
    sought : 1 where they are not zero
    """

    shape: Expr
    slots: np.ndarray
    sought: int


@dataclass(frozen=True, eq=False)
class Tables:
    """What ``lmoc_instant`` reads.

    Attributes
    ----------
    columns : by their names there
    assign, lines : programs: the discrete equations with what follows from them, and the relations of time
    first_told : (conditions + 1,) where the rows of each condition begin
    """

    columns: dict[str, np.ndarray]
    assign: Program
    lines: Program
    first_told: np.ndarray


def event_tables(layout: EventLayout, memory: Memory, told: Sequence[Condition]) -> Tables:
    """Return the tables of a plan, whose variables have their places in a memory."""
    events, plan = layout.events, layout.plan
    relations = events.relations
    row = layout.zero_row.copy()
    row[row < 0] = -1 - np.arange((row < 0).sum())
    lines: list[Apply] = []
    lined: list[list[np.ndarray]] = [[], [], []]
    for timed in layout.timed:
        r = relations[timed.relation]
        for shape, found in zip((timed.slope, timed.offset, r.zero), lined, strict=True):
            step, out = memory.values(shape, r.slots)
            lines.append(step)
            found.append(out)
    assign = [
        Apply(s.value, memory.places(s.slots), memory.places(s.target))
        for s in plan.reduced.discrete
        if s.relation < 0
    ]
    states = {int(register): k for k, register in enumerate(plan.states)}
    reinits: list[list[np.ndarray]] = [[], [], []]
    for one in events.reinits:
        step, out = memory.values(one.value, one.slots)
        assign.append(step)
        own = np.array([states.get(int(k), -1) for k in plan.reduced.register_of[one.target]], int)
        for column, found in zip((memory.places(one.guard), own, out), reinits, strict=True):
            found.append(column)
    tell, sought = [NONE], [NONE]
    for condition in told:
        step, out = memory.values(condition.shape, condition.slots)
        assign.append(step)
        tell.append(out)
        sought.append(np.full(len(out), condition.sought))
    samples = [[memory.places(getattr(s, n)) for s in events.samples] for n in ("target", "start", "interval")]
    joined = {
        "op": [np.full(r.rows, OPS.index(r.op)) for r in relations],
        "target": [memory.places(r.target) for r in relations],
        **dict(zip(("slope", "offset", "written"), lined, strict=True)),
        **dict(zip(("guard", "state", "value"), reinits, strict=True)),
        **dict(zip(("sample", "start", "interval"), samples, strict=True)),
        "tell": tell,
        "sought": sought,
    }
    now, past = events.before
    columns = {name: np.concatenate([NONE, *parts]) for name, parts in joined.items()}
    columns |= {
        "own": memory.places(events.discrete), "row": row, "of_zero": layout.relation_of_zero,
        "now": memory.places(now), "past": memory.places(past), "held": np.isin(now, events.discrete),
        "read": memory.places(layout.rounded_by),
    }  # fmt: skip
    columns |= _reads(plan, memory)
    return Tables(columns, tuple(assign), tuple(lines), np.cumsum([0, *map(len, tell[1:])]))


def _reads(plan: Plan, memory: Memory) -> dict[str, np.ndarray]:
    """Return which places discrete equations fill, and which of discrete variables each of them reads."""
    kind = plan.reduced.flat.kind
    filled, first, used = [NONE], [0], [NONE]
    for s in plan.reduced.discrete:
        if s.relation < 0:
            filled.append(memory.places(s.target))
            for row in s.slots:
                used.append(memory.places(row[kind[row] == Kind.DISCRETE]))
                first.append(first[-1] + len(used[-1]))
    return {"filled": np.concatenate(filled), "first_used": np.array(first), "used": np.concatenate(used)}


class PlanTables:
    """The tables of a plan, over the variables of the flat model, and the tapes."""

    def __init__(self, plan: Plan) -> None:
        layout = plan.once(EventLayout)
        events, checks = layout.events, layout.flat.checks
        memory = Memory(layout.flat.count)
        told = [(0, k, Condition(slot(0), w.active[:, None], 1)) for k, w in enumerate(events.whens)]
        told += [(1, k, Condition(e.guard, e.slots, 1)) for k, e in enumerate(events.terminations)]
        told += [(2, k, Condition(c.condition, c.slots, 0)) for k, c in enumerate(checks) if c.at_events]
        self._checks = checks
        self._kinds = [(kind, number) for kind, number, _ in told]
        self.tables = event_tables(layout, memory, [condition for _, _, condition in told])
        self.assign, self.lines = (values_tape(p, memory.size) for p in (self.tables.assign, self.tables.lines))
        self.reinit_targets = np.concatenate([np.zeros(0, int), *(r.target for r in events.reinits)])

    @cached_property
    def stops(self) -> np.ndarray:
        """(conditions,) whether a run does not go on where one is met."""
        ends = [kind == 1 or (kind == 2 and self._checks[number].error) for kind, number in self._kinds]
        return np.repeat(np.array(ends, bool), np.diff(self.tables.first_told))

    def happened(self, conditions: Sequence[int]) -> Happened:
        """Return what is to be told of an event where some conditions have been met, in that order."""
        first, whens, ended, broken = self.tables.first_told, [], [], dict[int, int]()
        for k in conditions:
            own = int(np.searchsorted(first, k, "right")) - 1
            (kind, number), row = self._kinds[own], k - int(first[own])
            if kind == 0:
                whens.append((number, row))
            elif kind == 1:
                ended.append(number)
            else:
                broken.setdefault(number, row)
        return Happened(tuple(whens), tuple(ended), tuple(broken.items()))
