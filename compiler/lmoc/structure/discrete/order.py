"""The discrete equations as a sequence of assignments (Modelica specification 3.6, appendix B).

Each discrete variable is determined by a relation or by one equation in which it appears alone on a side. Equations are
matched with variables, and sorted so that each uses only what precedes it; ``pre(v)`` and the continuous variables
are given. A cycle among them is an error: with the continuous part fixed, nothing would say which values hold.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from lmoc.expression.dag import Expr, slots
from lmoc.ir.events import Assigned, Events
from lmoc.ir.flat import FlatDAE
from lmoc.ir.reduced import DiscreteStep
from lmoc.messages.diagnostics import Label, Report
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class _Rule:
    """Rows that determine variables, all in one way: by a relation, or by one side of an equation."""

    op: str  # "gt", "ge", "floor", or "" for a value
    value: Expr
    slots: np.ndarray
    target: np.ndarray
    source: int  # of relations, their number; -1


def discrete_steps(flat: FlatDAE, report: Report) -> tuple[DiscreteStep, ...]:
    """The assignments in their order.

    Raises
    ------
    ModelError
        Through `report.check`: E0420 (nothing determines a variable), E0254 (two equations do), E0422 (a cycle), E0423
        (an equation that is not solved for a variable).
    """
    events = flat.events
    if events is None:
        return ()
    rules = [_Rule(r.op, r.zero, r.slots, r.target, k) for k, r in enumerate(events.relations)]
    rules += _assignments(flat, events, report)
    report.check()
    steps = _sorted(flat, events, rules, report)
    report.check()
    return steps


def unknowns(flat: FlatDAE, events: Events) -> np.ndarray:
    """Discrete variables that equations must determine."""
    given = [events.before[1], np.array([events.initial, events.terminal])]
    given += [r.target for r in events.relations] + [s.target for s in events.samples]
    return np.setdiff1d(events.discrete, np.concatenate(given))


# ------------------------------------------------------------------------- matching


def _assignments(flat: FlatDAE, events: Events, report: Report) -> list[_Rule]:
    """Each equation solved for the variable that it determines."""
    wanted = unknowns(flat, events)
    column = np.full(flat.count, -1)
    column[wanted] = np.arange(len(wanted))
    row, col, first = [], [], 0
    for e in events.equations:
        found = [column[e.slots[:, k]] for k in _sides(e)]
        if not any((f >= 0).any() for f in found):
            name = next((flat.variable_name(int(v)) for v in e.slots[0] if column[v] >= 0), "a variable")
            report.error("E0423", f"an equation for '{name}' must be solved for it", e.span,
                         expected="variable = expression")  # fmt: skip
        for f in found:
            own = np.flatnonzero(f >= 0)
            row.append(first + own)
            col.append(f[own])
        first += e.rows
    if report.errors:
        return []
    nothing = [np.zeros(0, np.int64)]
    incidence = Incidence.of(
        first, len(wanted), np.concatenate(row or nothing), np.concatenate(col or nothing),
        np.zeros(sum(map(len, row)), np.int64),
    )  # fmt: skip
    match = maximum_matching(incidence) if first else np.zeros(0, np.int64)
    _report_unmatched(flat, events, wanted, match, report)
    if report.errors:
        return []
    return _oriented(events, wanted, match)


def _sides(e: Assigned) -> list[int]:
    """Columns of the variables that stand alone on a side."""
    sides = (e.left,) if e.fixed else (e.left, e.right)
    return [s.value[0] for s in sides if s.op == "slot" and s.value[1] == 0]


def _report_unmatched(flat: FlatDAE, events: Events, wanted: np.ndarray, match: np.ndarray, report: Report) -> None:
    lost = np.setdiff1d(np.arange(len(wanted)), match[match >= 0])
    for k in lost[:5].tolist():
        name = flat.variable_name(int(wanted[k]))
        report.error("E0420", f"nothing determines '{name}'", flat.block_at(int(wanted[k])).span,
                     hint="assign it in a 'when', or give it an equation")  # fmt: skip
    first = 0
    for e in events.equations:
        for k in np.flatnonzero(match[first : first + e.rows] < 0)[:1].tolist():
            variable = int(e.slots[k, _sides(e)[0]])
            others = [o for o in events.equations if o is not e and _gives(o, variable)]
            labels = tuple(Label(o.span, "here as well") for o in others[:2] if o.span is not None)
            report.error("E0254", f"'{flat.variable_name(variable)}' is determined twice", e.span, labels=labels)
        first += e.rows


def _gives(e: Assigned, variable: int) -> bool:
    return any((e.slots[:, k] == variable).any() for k in _sides(e))


def _oriented(events: Events, wanted: np.ndarray, match: np.ndarray) -> list[_Rule]:
    rules, first = [], 0
    for e in events.equations:
        target = wanted[match[first : first + e.rows]]
        first += e.rows
        left = e.left.op == "slot" and e.left.value[1] == 0
        forward = (e.slots[:, e.left.value[0]] == target) if left else np.zeros(e.rows, bool)
        for rows, value in ((np.flatnonzero(forward), e.right), (np.flatnonzero(~forward), e.left)):
            if len(rows):
                rules.append(_Rule("", value, e.slots[rows], target[rows], -1))
    return rules


# -------------------------------------------------------------------------- sorting


def _sorted(flat: FlatDAE, events: Events, rules: Sequence[_Rule], report: Report) -> tuple[DiscreteStep, ...]:
    """The rows by levels: those of one level do not read each other."""
    producer = np.full(flat.count, -1)
    first = np.cumsum([0, *(len(r.target) for r in rules)])
    for r, at in zip(rules, first.tolist(), strict=False):
        producer[r.target] = at + np.arange(len(r.target))
    users: list[list[int]] = [[] for _ in range(int(first[-1]))]
    waiting = np.zeros(int(first[-1]), int)
    for r, at in zip(rules, first.tolist(), strict=False):
        columns = sorted({leaf.value[0] for leaf in slots(r.value)})
        needs = producer[r.slots[:, columns]] if columns else np.zeros((len(r.target), 0), int)
        for k, row in enumerate(needs.tolist()):
            for other in set(row) - {-1}:
                users[other].append(at + k)
                waiting[at + k] += 1
    level = np.zeros(len(users), int)
    queue = deque(np.flatnonzero(waiting == 0).tolist())
    done = 0
    while queue:
        k = queue.popleft()
        done += 1
        for user in users[k]:
            level[user] = max(level[user], level[k] + 1)
            waiting[user] -= 1
            if not waiting[user]:
                queue.append(user)
    if done < len(users):
        _report_cycle(flat, events, rules, first, np.flatnonzero(waiting > 0), users, report)
        return ()
    parts = []
    for r, at in zip(rules, first.tolist(), strict=False):
        own = level[at : at + len(r.target)]
        for n in np.unique(own).tolist():
            rows = np.flatnonzero(own == n)
            parts.append((n, DiscreteStep(r.op, r.value, r.slots[rows], r.target[rows], r.source, rows)))
    return tuple(step for _, step in sorted(parts, key=lambda part: part[0]))


def _report_cycle(
    flat: FlatDAE,
    events: Events,
    rules: Sequence[_Rule],
    first: np.ndarray,
    stuck: np.ndarray,
    users: list[list[int]],
    report: Report,
) -> None:
    """Name one cycle among the rows that wait for each other."""
    among = set(stuck.tolist())
    needs: dict[int, int] = {}
    for k in among:
        for user in users[k]:
            if user in among:
                needs[user] = k
    path, k = [], next(iter(needs))
    while k not in path:
        path.append(k)
        k = needs[k]
    cycle = path[path.index(k) :]
    names = []
    for row in cycle:
        n = int(np.searchsorted(first, row, "right")) - 1
        variable = int(rules[n].target[row - first[n]])
        if not flat.block_at(variable).protected or len(cycle) == 1:
            names.append(flat.variable_name(variable))
    found = next((v for v in events.discrete.tolist() if flat.variable_name(v) in names[:1]), None)
    span = None if found is None else flat.block_at(found).span
    report.error(
        "E0422",
        f"the value of '{names[0]}' depends on itself at the same instant",
        span,
        found=" → ".join([*names, names[0]]),
        hint="pre(…) gives the value before the event",
    )
