"""What an FMU needs to know of events: tapes and tables of relations, discrete equations, samples, assertions.

Registers of these tapes are those of the plan, then the variables of the flat model (parameters stand there), then what
is computed at instants only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from lmoc.engine.instant import TABLES
from lmoc.expression.dag import ONE, Expr, slot
from lmoc.ir.events import Events
from lmoc.ir.flat import Check, FlatDAE, Kind
from lmoc.ir.program import Apply, Program, needed_steps, unfilled
from lmoc.lower.blocks import values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.events.layout import EventLayout, initial_values
from lmoc.numerics.events.tables import NONE, OPS, Condition, Memory, Tables, event_tables
from lmoc.numerics.failures.assertions import relations_of
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Told:
    """Conditions with what is said about them.

    Attributes
    ----------
    places : (n,) registers
    errors : (n,) whether it is an error where the condition does not hold
    texts : (n,)
    """

    places: np.ndarray
    errors: np.ndarray
    texts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Instants:
    """The events of a scene as an FMU holds them. "Discrete" are positions among the discrete variables.

    Attributes
    ----------
    look : Tape
        Zero functions and what the discrete equations read, from `kept`, the registers that derivatives leave.
    assign, lines, begin : Tape
        The discrete equations once; slopes and offsets of relations of time; the equations of the start.
    parameters : registers that parameters have on these tapes
    absent : register without a value
    seen : registers that `look` fills and `assign` reads
    registers, start : (discrete,) registers of `look` and first values
    begun : registers that `begin` fills
    zeros : (zeros,) registers of `look`
    columns : the tables of the engine, as of `events.tables`
    texts : (relations,) what they are in the model's text
    reinits : registers of `look` that `reinit` sets
    checks : how many of the conditions at events, the first ones, are assertions
    errors, told_texts : of these assertions, whether they are errors; of all conditions
    watched : assertions about the motion; registers of `look`
    first_known, known : registers of `look` with which each of these can be judged, if they are finite
    branches : registers of `look` that are zero where one of these may change
    initial, terminal : registers, or -1
    longest : s, of a step
    """

    look: Tape
    assign: Tape
    lines: Tape
    begin: Tape
    kept: np.ndarray
    parameters: np.ndarray
    absent: int
    seen: np.ndarray
    registers: np.ndarray
    start: np.ndarray
    begun: np.ndarray
    zeros: np.ndarray
    columns: dict[str, np.ndarray]
    texts: tuple[str, ...]
    reinits: np.ndarray
    checks: int
    errors: np.ndarray
    told_texts: tuple[str, ...]
    watched: Told
    first_known: np.ndarray
    known: np.ndarray
    branches: np.ndarray
    initial: int
    terminal: int
    longest: float

    @property
    def indicator_texts(self) -> tuple[str, ...]:
        """What each event indicator tells of: zero functions, the upper edges of those that are rounded, assertions."""
        rows, ops = self.columns["row"], self.columns["op"]
        zeros = [text for text, row in zip(self.texts, rows.tolist(), strict=True) if row >= 0]
        rounded = [t for t, row, op in zip(self.texts, rows, ops, strict=True) if row >= 0 and OPS[op] == "floor"]
        return (*zeros, *rounded, *["an assertion"] * len(self.branches))


class _Layout(Memory):
    """The memory of an FMU's tapes: the registers of the plan come first, and values of parameters behind them."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.flat = plan, plan.reduced.flat
        self.absent = plan.count + self.flat.count
        super().__init__(self.absent + 1)
        self.parameters: set[int] = set()

    def places(self, variables: np.ndarray) -> np.ndarray:
        """Return where variables of the flat model have their values."""
        variables = np.asarray(variables, int)
        given = self.flat.kind[variables] <= Kind.PARAMETER
        register = self.plan.reduced.register_of[variables]
        found = np.where(given, self.plan.count + variables, np.where(register >= 0, register, self.absent))
        self.parameters.update(found[given].tolist())
        return found

    def flag(self, variable: int) -> int:
        """Return the register of a discrete variable; -1 where there is none."""
        return int(self.plan.reduced.register_of[variable]) if variable >= 0 else -1



def instants(plan: Plan, values: np.ndarray, longest: Callable[[], float], read: np.ndarray = NONE) -> Instants:
    """Return the events of a plan; without any there are empty tables.

    Parameters
    ----------
    values : (flat.count,) of parameters
    longest : s, the longest step with which relations of time that are not linear in it are looked at often enough
    read : registers that laws read
    """
    flat, own = plan.reduced.flat, _Layout(plan)
    events = flat.events or Events(NONE, np.zeros((2, 0), int), (), (), (), (), (), (), ())
    layout = None if flat.events is None else plan.once(EventLayout)
    zeros, looked = _zeros(own, layout)
    watched, judged, branches, steps = _watched(own, flat)
    checks = [c for c in flat.checks if c.at_events]
    told = [Condition(c.condition, c.slots, 0) for c in checks]
    told += [Condition(e.guard, e.slots, 1) for e in events.terminations]
    tables = Tables({}, (), (), NONE) if layout is None else event_tables(layout, own, told)
    texts = [message_of(flat, c)(row) for c in checks for row in range(len(c.slots))]
    begin, begun = ((), NONE) if layout is None else _begin(own, layout)
    seen = NONE if layout is None else plan.reduced.register_of[layout.seen]
    known = np.concatenate([NONE, *judged])
    wanted = np.concatenate([zeros, seen, branches, watched.places, known, read]).astype(int)
    look = needed_steps((*plan.reduced.observe, *looked, *steps), wanted, own.size)
    return Instants(
        values_tape(look, own.size), values_tape(tables.assign, own.size), values_tape(tables.lines, own.size),
        values_tape(begin, own.size), unfilled(look, wanted, plan.count),
        np.array(sorted(own.parameters), int), own.absent, seen,
        NONE if layout is None else layout.registers,
        np.zeros(0) if layout is None else initial_values(flat, values)[events.discrete],
        begun, zeros,
        {name: tables.columns.get(name, NONE) for name in TABLES},
        tuple(r.text for r in events.relations for _ in range(r.rows)),
        np.concatenate([NONE, *(own.places(r.target) for r in events.reinits)]), len(texts),
        np.concatenate([NONE, *(np.full(len(c.slots), c.error) for c in checks)]),
        (*texts, *(e.message for e in events.terminations for _ in e.slots)), watched,
        np.cumsum([0, *map(len, judged)]), known, branches,
        own.flag(events.initial), own.flag(events.terminal), longest(),
    )  # fmt: skip


def _zeros(own: _Layout, layout: EventLayout | None) -> tuple[np.ndarray, Program]:
    """Return the registers of the zero functions, in their order, and what fills them."""
    if layout is None:
        return NONE, ()
    steps, found = [], [NONE]
    for k, r in enumerate(layout.events.relations):
        if r.rows and layout.zero_row[layout.first[k]] >= 0:
            step, out = own.values(r.zero, r.slots)
            steps.append(step)
            found.append(out)
    return np.concatenate(found), tuple(steps)


def _told(
    own: _Layout, rows: Iterable[tuple[Expr, np.ndarray, bool, Callable[[int], str]]]
) -> tuple[Told, Program]:
    """Return conditions with their texts, and the steps that compute them."""
    steps, places, errors, texts = [], [NONE], [], []
    for condition, table, error, message in rows:
        step, out = own.values(condition, table)
        steps.append(step)
        places.append(out)
        errors += [error] * len(table)
        texts += [message(row) for row in range(len(table))]
    return Told(np.concatenate(places), np.array(errors, int), tuple(texts)), tuple(steps)


def message_of(flat: FlatDAE, check: Check) -> Callable[[int], str]:
    """Return what is said of each row of an assertion that does not hold."""
    place = f" ({check.span})" if check.span is not None else ""
    return lambda row: f"an assertion does not hold: {flat.message_of(check, row)}{place}"


def _watched(own: _Layout, flat: FlatDAE) -> tuple[Told, list[np.ndarray], np.ndarray, Program]:
    """Return the assertions about the motion, what each reads, and the functions whose zeros may change them."""
    checks = [c for c in flat.checks if not c.at_events and c not in flat.constant_checks and len(c.slots)]
    told, steps = _told(own, [(c.condition, c.slots, c.error, message_of(flat, c)) for c in checks])
    found, more = [NONE], []
    for c in checks:
        for relation in relations_of(c):
            step, out = own.values(relation, c.slots)
            more.append(step)
            found.append(out)
    reads = [own.places(row) for c in checks for row in c.slots]
    return told, reads, np.concatenate(found), (*steps, *more)


def _begin(own: _Layout, layout: EventLayout) -> tuple[Program, np.ndarray]:
    """Return what gives discrete variables with an equation at the start its value: now, and before."""
    steps: list[Apply] = []
    filled = [NONE]
    for one in layout.started:
        steps.append(Apply(one.step.value, own.places(one.step.slots), own.places(one.step.target)))
        steps.append(Apply(slot(0) * ONE, own.places(one.past)[:, None], own.places(one.same)))
        filled += [one.step.target, one.same]
    return tuple(steps), own.places(np.concatenate(filled))
