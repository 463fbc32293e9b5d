"""The discrete equations as a sequence of assignments (Modelica specification 3.6, appendix B).

Each discrete variable is determined by a relation or by one equation in which it appears alone on a side. Equations are
matched with variables, and sorted so that each uses only what precedes it; ``pre(v)`` and the continuous variables
are given. A cycle among them is an error: with the continuous part fixed, nothing would say which values hold.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

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
    wanted, itself = unknowns(events), np.arange(flat.count)
    rules += _assignments(flat, events.equations, wanted, itself, report)
    report.check()
    _report_undetermined(flat, np.setdiff1d(wanted, np.concatenate([wanted[:0], *(r.target for r in rules)])), report)
    report.check()
    steps = _sorted(flat, rules, itself, report)
    report.check()
    return steps


def start_steps(flat: FlatDAE, report: Report) -> tuple[DiscreteStep, ...]:
    """The initial equations of discrete variables in their order, each for what its variable has been before.

    Raises
    ------
    ModelError
        As of `discrete_steps`.
    """
    events = flat.events
    if events is None or not events.start:
        return ()
    remembered = _remembered(flat, events)
    wanted = np.intersect1d(events.discrete, remembered[events.before[1]])
    rules = _assignments(flat, events.start, wanted, remembered, report)
    report.check()
    _report_fixed(flat, rules, report)
    report.check()
    steps = _sorted(flat, rules, remembered, report)
    report.check()
    past = dict(events.before.T.tolist())
    return tuple(replace(s, target=np.array([past[v] for v in s.target.tolist()])) for s in steps)


def _report_fixed(flat: FlatDAE, rules: Sequence[_Rule], report: Report) -> None:
    fixed, where = flat.is_fixed, {int(v): a.span for a in flat.fixed for v in a.target}
    for r in rules:
        for variable in r.target[fixed[r.target]].tolist():
            name = flat.variable_name(variable)
            message = f"the start value of '{name}' is fixed, and an initial equation gives another"
            report.error("E0254", message, where[variable], hint="leave one of them out")


def _remembered(flat: FlatDAE, events: Events) -> np.ndarray:
    """(flat.count,) the variable whose value each ``pre(v)`` holds; any other itself."""
    found = np.arange(flat.count)
    for now, before in reversed(events.before.T.tolist()):  # pre(pre(v)) comes ahead of pre(v)
        found[before] = found[now]
    return found


def unknowns(events: Events) -> np.ndarray:
    """Discrete variables that equations must determine."""
    given = [events.before[1], np.array([events.initial, events.terminal])]
    given += [r.target for r in events.relations] + [s.target for s in events.samples]
    return np.setdiff1d(events.discrete, np.concatenate(given))


# ------------------------------------------------------------------------- matching


def _assignments(
    flat: FlatDAE, equations: Sequence[Assigned], wanted: np.ndarray, of: np.ndarray, report: Report
) -> list[_Rule]:
    """Each equation solved for the variable that it determines.

    Parameters
    ----------
    wanted : variables that may be determined
    of : (flat.count,) the variable that a variable stands for
    """
    column = np.full(flat.count, -1)
    column[wanted] = np.arange(len(wanted))
    column = column[of]
    row, col, first = [], [], 0
    for e in equations:
        found = [column[e.slots[:, k]] for k in _sides(e)]
        if not any((f >= 0).any() for f in found):
            _report_unsolved(flat, e, column, of, report)
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
    _report_unmatched(flat, equations, match, of, report)
    return [] if report.errors else _oriented(equations, wanted, match, of)


def _report_unsolved(flat: FlatDAE, e: Assigned, column: np.ndarray, of: np.ndarray, report: Report) -> None:
    name = next((flat.variable_name(int(of[v])) for v in e.slots[0] if column[v] >= 0), "")
    if not name and (sides := _sides(e)):
        name = flat.variable_name(int(of[e.slots[0, sides[0]]]))
        report.error("E0254", f"'{name}' is determined twice", e.span, hint="an equation that always holds gives it")
        return
    what = f"'{name}'" if name else "a variable"
    report.error("E0423", f"an equation for {what} must be solved for it", e.span, expected="variable = expression")


def _sides(e: Assigned) -> list[int]:
    """Columns of the variables that stand alone on a side."""
    sides = (e.left,) if e.fixed else (e.left, e.right)
    return [s.value[0] for s in sides if s.op == "slot" and s.value[1] == 0]


def _report_undetermined(flat: FlatDAE, lost: np.ndarray, report: Report) -> None:
    for variable in lost[:5].tolist():
        report.error("E0420", f"nothing determines '{flat.variable_name(variable)}'", flat.block_at(variable).span,
                     hint="assign it in a 'when', or give it an equation")  # fmt: skip


def _report_unmatched(
    flat: FlatDAE, equations: Sequence[Assigned], match: np.ndarray, of: np.ndarray, report: Report
) -> None:
    first = 0
    for e in equations:
        for k in np.flatnonzero(match[first : first + e.rows] < 0)[:1].tolist():
            variable = int(of[e.slots[k, _sides(e)[0]]])
            others = [o for o in equations if o is not e and _gives(o, variable, of)]
            labels = tuple(Label(o.span, "here as well") for o in others[:2] if o.span is not None)
            report.error("E0254", f"'{flat.variable_name(variable)}' is determined twice", e.span, labels=labels)
        first += e.rows


def _gives(e: Assigned, variable: int, of: np.ndarray) -> bool:
    return any((of[e.slots[:, k]] == variable).any() for k in _sides(e))


def _oriented(equations: Sequence[Assigned], wanted: np.ndarray, match: np.ndarray, of: np.ndarray) -> list[_Rule]:
    rules, first = [], 0
    for e in equations:
        target = wanted[match[first : first + e.rows]]
        first += e.rows
        left = e.left.op == "slot" and e.left.value[1] == 0
        forward = (of[e.slots[:, e.left.value[0]]] == target) if left else np.zeros(e.rows, bool)
        for rows, value in ((np.flatnonzero(forward), e.right), (np.flatnonzero(~forward), e.left)):
            if len(rows):
                rules.append(_Rule("", value, e.slots[rows], target[rows], -1))
    return rules


# -------------------------------------------------------------------------- sorting


def _sorted(flat: FlatDAE, rules: Sequence[_Rule], of: np.ndarray, report: Report) -> tuple[DiscreteStep, ...]:
    """The rows by levels: those of one level do not read each other; `of` as of `_assignments`."""
    producer = np.full(flat.count, -1)
    first = np.cumsum([0, *(len(r.target) for r in rules)])
    for r, at in zip(rules, first.tolist(), strict=False):
        producer[r.target] = at + np.arange(len(r.target))
    users: list[list[int]] = [[] for _ in range(int(first[-1]))]
    waiting = np.zeros(int(first[-1]), int)
    for r, at in zip(rules, first.tolist(), strict=False):
        columns = sorted({leaf.value[0] for leaf in slots(r.value)})
        needs = producer[of[r.slots[:, columns]]] if columns else np.zeros((len(r.target), 0), int)
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
        _report_cycle(flat, rules, first, np.flatnonzero(waiting > 0), users, report)
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
    found = next((v for r in rules for v in r.target.tolist() if flat.variable_name(v) in names[:1]), None)
    span = None if found is None else flat.block_at(found).span
    report.error(
        "E0422",
        f"the value of '{names[0]}' depends on itself at the same instant",
        span,
        found=" → ".join([*names, names[0]]),
        hint="pre(…) gives the value before the event",
    )
