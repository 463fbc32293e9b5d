"""What an FMU needs to know of events: tapes and tables of relations, discrete equations, samples, assertions.

Registers of these tapes are those of the plan, then the variables of the flat model (parameters stand there), then what
is computed at instants only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from lmoc.expression.dag import ONE, Expr, slot
from lmoc.ir.events import Events
from lmoc.ir.flat import Check, FlatDAE, Kind
from lmoc.ir.program import Apply, Program, needed_steps, unfilled
from lmoc.lower.blocks import values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.events.discrete_state import initial_values
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.failures.assertions import relations_of
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass

OPS = ("gt", "ge", "floor")
NONE = np.zeros(0, int)
Positions = Callable[[np.ndarray], np.ndarray]  # of variables, among the discrete ones; -1 of others


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
    size : registers of these tapes
    parameters : registers of `size` that parameters have on them
    absent : register without a value
    seen : registers that `look` fills and `assign` reads
    registers, start : (discrete,) registers and first values
    assigned, begun : discrete variables that `assign` and `begin` fill
    zeros : (zeros,) registers of `look`
    op, target, row : (relations,) `OPS`, the discrete variable, the zero function; of a relation of time -1 - its line
    texts : (relations,) what they are in the model's text
    slope, offset : (lines,)
    now, source, past : (before,) a discrete variable, else -1 and a register; the discrete one that keeps its value
    samples : (3, samples) discrete variable, registers of start and interval
    reinits : (4, reinits) discrete guard, state or -1, register of the variable, register of its new value
    ends, checks : conditions at events; registers of `assign`
    watched : assertions about the motion; registers of `look`
    first_known, known : registers of `look` with which each of these can be judged, if they are finite
    branches : registers of `look` that are zero where one of these may change
    first_read, read : which discrete variables the equation of each of `assigned` reads
    initial, terminal : discrete variables, or -1
    longest : s, of a step
    """

    look: Tape
    assign: Tape
    lines: Tape
    begin: Tape
    kept: np.ndarray
    size: int
    parameters: np.ndarray
    absent: int
    seen: np.ndarray
    registers: np.ndarray
    start: np.ndarray
    assigned: np.ndarray
    begun: np.ndarray
    zeros: np.ndarray
    op: np.ndarray
    target: np.ndarray
    row: np.ndarray
    texts: tuple[str, ...]
    slope: np.ndarray
    offset: np.ndarray
    now: np.ndarray
    source: np.ndarray
    past: np.ndarray
    samples: np.ndarray
    reinits: np.ndarray
    ends: Told
    checks: Told
    watched: Told
    first_known: np.ndarray
    known: np.ndarray
    branches: np.ndarray
    first_read: np.ndarray
    read: np.ndarray
    initial: int
    terminal: int
    longest: float


    @property
    def indicator_texts(self) -> tuple[str, ...]:
        """What each event indicator tells of: zero functions, the upper edges of those that are rounded, assertions."""
        zeros = [text for text, row in zip(self.texts, self.row.tolist(), strict=True) if row >= 0]
        rounded = [t for t, row, op in zip(self.texts, self.row, self.op, strict=True) if row >= 0 and op == 2]
        return (*zeros, *rounded, *["an assertion"] * len(self.branches))


class _Layout:
    """Gives out registers, and collects steps."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.flat = plan, plan.reduced.flat
        self.absent = plan.count + self.flat.count
        self.size = self.absent + 1
        self.parameters: set[int] = set()

    def new(self, count: int) -> np.ndarray:
        self.size += count
        return np.arange(self.size - count, self.size)

    def places(self, variables: np.ndarray) -> np.ndarray:
        """Return where variables of the flat model have their values."""
        variables = np.asarray(variables, int)
        given = self.flat.kind[variables] <= Kind.PARAMETER
        register = self.plan.reduced.register_of[variables]
        found = np.where(given, self.plan.count + variables, np.where(register >= 0, register, self.absent))
        self.parameters.update(found[given].tolist())
        return found

    def values(self, shape: Expr, variables: np.ndarray) -> tuple[Apply, np.ndarray]:
        """Return the step that computes an expression for all rows of a table, and its registers."""
        out = self.new(len(variables))
        return Apply(shape, self.places(variables), out), out


def instants(plan: Plan, values: np.ndarray, longest: Callable[[], float]) -> Instants:
    """Return the events of a plan; without any there are empty tables.

    Parameters
    ----------
    values : (flat.count,) of parameters
    longest : s, the longest step with which relations of time that are not linear in it are looked at often enough
    """
    flat, own = plan.reduced.flat, _Layout(plan)
    events = flat.events or Events(NONE, np.zeros((2, 0), int), (), (), (), (), (), (), ())
    layout = None if flat.events is None else plan.once(EventLayout)
    of = {v: k for k, v in enumerate(events.discrete.tolist())}

    def positions(variables: np.ndarray) -> np.ndarray:
        return np.array([of.get(int(v), -1) for v in np.ravel(variables)], int)

    zeros, looked = _zeros(own, layout)
    watched, judged, branches, steps = _watched(own, flat)
    assign = [
        Apply(s.value, own.places(s.slots), own.places(s.target)) for s in plan.reduced.discrete if s.relation < 0
    ]
    assigned = np.concatenate([NONE, *(positions(s.target) for s in plan.reduced.discrete if s.relation < 0)])
    first_read, reads = _reads(plan, positions)
    reinits, more = _reinits(own, events, positions)
    ends, endings = _told(own, [(e.guard, e.slots, False, _same(e.message)) for e in events.terminations])
    at_events = [c for c in flat.checks if c.at_events]
    checks, judging = _told(own, [(c.condition, c.slots, c.error, _message(flat, c)) for c in at_events])
    lines, slope, offset = _lines(own, events, layout)
    begin, begun = _begin(own, events, positions)
    seen = NONE if layout is None else plan.reduced.register_of[layout.seen]
    known = np.concatenate([NONE, *judged])
    wanted = np.concatenate([zeros, seen, branches, watched.places, known]).astype(int)
    look = needed_steps((*plan.reduced.observe, *looked, *steps), wanted, own.size)
    relations = events.relations
    rows = NONE if layout is None else _rows(layout)
    samples = [positions(s.target) for s in events.samples]
    clocks = [[own.places(getattr(s, n)) for s in events.samples] for n in ("start", "interval")]
    return Instants(
        values_tape(look, own.size), values_tape((*assign, *more, *endings, *judging), own.size),
        values_tape(lines, own.size), values_tape(begin, own.size), unfilled(look, wanted, plan.count), own.size,
        np.array(sorted(own.parameters), int), own.absent, seen,
        NONE if layout is None else layout.registers,
        np.zeros(0) if layout is None else initial_values(flat, values)[events.discrete],
        assigned, begun, zeros,
        np.concatenate([NONE, *(np.full(r.rows, OPS.index(r.op)) for r in relations)]),
        np.concatenate([NONE, *(positions(r.target) for r in relations)]), rows,
        tuple(r.text for r in relations for _ in range(r.rows)), slope, offset,
        positions(events.before[0]), own.places(events.before[0]), positions(events.before[1]),
        np.stack([np.concatenate([NONE, *part]) for part in (samples, *clocks)]), reinits, ends, checks, watched,
        np.cumsum([0, *map(len, judged)]), known, branches, first_read, reads,
        int(positions(np.array([events.initial]))[0]), int(positions(np.array([events.terminal]))[0]), longest(),
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


def _rows(layout: EventLayout) -> np.ndarray:
    """(relations,) the zero function of each, -1 - its line for one of time alone."""
    found = layout.zero_row.copy()
    of_time = np.flatnonzero(found < 0)
    found[of_time] = -1 - np.arange(len(of_time))
    return found


def _lines(own: _Layout, events: Events, layout: EventLayout | None) -> tuple[Program, np.ndarray, np.ndarray]:
    steps, slopes, offsets = [], [NONE], [NONE]
    for timed in () if layout is None else layout.timed:
        r = events.relations[timed.relation]
        for shape, found in ((timed.slope, slopes), (timed.offset, offsets)):
            step, out = own.values(shape, r.slots)
            steps.append(step)
            found.append(out)
    return tuple(steps), np.concatenate(slopes), np.concatenate(offsets)


def _reinits(own: _Layout, events: Events, positions: Positions) -> tuple[np.ndarray, Program]:
    states = {int(r): k for k, r in enumerate(own.plan.states)}
    rows, steps = [np.zeros((4, 0), int)], []
    for r in events.reinits:
        step, out = own.values(r.value, r.slots)
        steps.append(step)
        place = own.places(r.target)
        rows.append(np.stack([positions(r.guard), np.array([states.get(int(p), -1) for p in place]), place, out]))
    return np.concatenate(rows, axis=1), tuple(steps)


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


def _same(text: str) -> Callable[[int], str]:
    return lambda _: text


def _message(flat: FlatDAE, check: Check) -> Callable[[int], str]:
    place = f" ({check.span})" if check.span is not None else ""
    return lambda row: f"an assertion does not hold: {flat.message_of(check, row)}{place}"


def _watched(own: _Layout, flat: FlatDAE) -> tuple[Told, list[np.ndarray], np.ndarray, Program]:
    """Return the assertions about the motion, what each reads, and the functions whose zeros may change them."""
    checks = [c for c in flat.checks if not c.at_events and c not in flat.constant_checks and len(c.slots)]
    told, steps = _told(own, [(c.condition, c.slots, c.error, _message(flat, c)) for c in checks])
    found, more = [NONE], []
    for c in checks:
        for relation in relations_of(c):
            step, out = own.values(relation, c.slots)
            more.append(step)
            found.append(out)
    reads = [own.places(row) for c in checks for row in c.slots]
    return told, reads, np.concatenate(found), (*steps, *more)


def _reads(plan: Plan, positions: Positions) -> tuple[np.ndarray, np.ndarray]:
    """Return which discrete variables the equation of each assigned one reads, row after row."""
    first, found = [0], [NONE]
    for s in plan.reduced.discrete:
        if s.relation < 0:
            for table in s.slots:
                own = positions(table)
                found.append(own[own >= 0])
                first.append(first[-1] + len(found[-1]))
    return np.array(first, int), np.concatenate(found)


def _begin(own: _Layout, events: Events, positions: Positions) -> tuple[Program, np.ndarray]:
    """Return what gives discrete variables with an equation at the start its value: now, and before."""
    now = dict(zip(*events.before[::-1].tolist(), strict=True)) if events.before.size else {}
    before = {v: k for k, v in now.items()}
    steps: list[Apply] = []
    filled: list[int] = []
    for e in events.start:
        left = e.left.op == "slot" and own.flat.kind[e.slots[0, e.left.value[0]]] == Kind.DISCRETE
        side, value = (e.left, e.right) if left else (e.right, e.left)
        step, out = own.values(value, e.slots)
        steps.append(step)
        for row, variable in enumerate(e.slots[:, side.value[0]].tolist()):
            own_ones = {variable, now.get(variable, variable), before.get(variable, variable)}
            for one in sorted(own_ones - set(filled)):
                steps.append(Apply(slot(0) * ONE, out[row : row + 1, None], own.places(np.array([one]))))
                filled.append(one)
    return tuple(steps), positions(np.array(filled, int))
