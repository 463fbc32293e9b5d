"""Diagnosis of a system that has no unique solution, in the user's terms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import Diagnostic, Label, Report, Subject
from lmoc.messages.ranges import LOOKED_AT, report_alike
from lmoc.messages.source import Span
from lmoc.structure.blocks.block_equations import SquareSystem
from lmoc.structure.coordinates.coordinates import Choice
from lmoc.structure.coordinates.jumps import bends, deciding
from lmoc.structure.coordinates.tied import Tied
from lmoc.structure.index.dulmage_mendelsohn import components, decompose
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.messages.equations import HELD, SHOWN, Equations, listed
from lmoc.structure.registers.layout import RegisterLayout
from lmoc.support.distinct import distinct
from lmoc.support.quoted import split
from lmoc.support.sizes import RANK


def structurally_singular(system: EquationSystem, report: Report) -> None:
    """Say which equations are too many (E0401) and which unknowns nothing determines (E0402, E0403)."""
    incidence = system.incidence
    parts = decompose(incidence, maximum_matching(incidence))
    equations, ports = Equations(system.flat), _Ports(system)
    pieces, found = components(incidence, parts.over_rows, parts.over_columns), Report()
    for rows, columns in pieces[:LOOKED_AT]:
        _too_many(system, equations, rows, columns, found)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(pieces) - LOOKED_AT))
    pieces, found = components(incidence, parts.under_rows, parts.under_columns), Report()
    for rows, columns in pieces[:LOOKED_AT]:
        _too_few(system, equations, ports, rows, columns, len(parts.over_rows) > 0, found)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(pieces) - LOOKED_AT))


def _too_many(
    system: EquationSystem, equations: Equations, rows: np.ndarray, columns: np.ndarray, report: Report
) -> None:
    sources = system.source[rows].tolist()
    names = [system.name(c) for c in columns.tolist()]
    excess = len(rows) - len(columns)
    what = (
        f"{_count(len(rows), 'equation')} for {_count(len(columns), 'unknown')} ({listed(names)})"
        if names
        else (f"{_count(len(rows), 'equation')} without any unknown")
    )
    parts = equations.parts(sources)
    message = f"too many equations: {what}"
    found = "; ".join(equations.text(s) for s in sources[:SHOWN]) + (" …" if len(sources) > SHOWN else "")
    who = f" of {listed(parts)}" if parts else ""
    hint = f"{_count(excess, 'equation')} too many: remove one{who}, or leave open a value that is prescribed"
    _at(equations, sources, report, "E0401", message, found=found, hint=hint)


def _too_few(
    system: EquationSystem,
    equations: Equations,
    ports: _Ports,
    rows: np.ndarray,
    columns: np.ndarray,
    also_too_many: bool,
    report: Report,
) -> None:
    flat = system.flat
    # the ledger follows from the rest, and is nothing that the user wrote
    roots = [v for v in system.variable[columns].tolist() if flat.block_at(v).path[0][0] != "ledger"]
    if not roots:
        return
    sources = system.source[rows].tolist()
    positions = ports.on(roots)
    if len(positions):
        names = _carriers(flat, positions)
        message = f"nothing fixes the absolute position of {listed(names)}"
        hint = "only differences of positions occur in their equations: fix one of them, or give one a mass or inertia"
        if also_too_many:
            hint = "too much is prescribed where nothing is elastic: leave one force open, or add a mass or inertia"
        _at(equations, sources, report, "E0402", message, hint=hint, fallback=_span(flat, int(positions[0])))
        return
    if also_too_many and any(flat.block_at(v).flow for v in roots):
        return  # reactions of what is prescribed too often: one mistake, one message
    names = [flat.variable_name(v) for v in roots]
    own = len(rows) - (len(columns) - len(roots))
    if own:
        counts = f"{_count(own, 'equation')} for {_count(len(roots), 'unknown')}"
        message = f"too few equations: {counts} ({listed(names)})"
    else:
        message = f"no equation determines {listed(names)}"
    hint = f"{_count(len(roots) - own, 'equation')} missing"
    # what was dropped as a repetition may be what the user counts on
    found = "; ".join(note.message for note in system.normalized.notes[:SHOWN])
    _at(equations, sources, report, "E0403", message, found=found, hint=hint, fallback=_span(flat, roots[0]))


class _Ports:
    """The positions of connectors, by the roots that they hang on."""

    def __init__(self, system: EquationSystem) -> None:
        positions = np.flatnonzero(system.flat.per_variable(lambda b: b.connector and not b.flow, bool))
        root = system.normalized.root[positions]
        order = np.argsort(root, kind="stable")
        self._positions, self._root = positions[order], root[order]

    def on(self, roots: Sequence[int] | np.ndarray) -> np.ndarray:
        """Those that hang on these roots, ascending."""
        wanted = np.asarray(roots, int)
        first, end = (np.searchsorted(self._root, wanted, side) for side in ("left", "right"))
        own = [self._positions[a:b] for a, b in zip(first, end, strict=True)]
        return distinct(np.concatenate([self._positions[:0], *own]))


def _carriers(flat: FlatDAE, positions: np.ndarray) -> list[str]:
    """The parts that these variables of connectors belong to."""
    names: dict[str, None] = {}
    for v in positions.tolist():
        path = split(flat.variable_name(v))
        depth = len(flat.parts[flat.block_at(v).part].path) or max(1, len(path) - 2)
        names[".".join(path[:depth])] = None
    return list(names)


def dependent_constraints(system: EquationSystem, jacobian: Tied, rows: np.ndarray, report: Report) -> None:
    """E0404: constraints that depend on each other at the start (or E0402).

    Parameters
    ----------
    jacobian : of all equations by their highest derivatives
    rows : those in which elimination has found nothing left
    """
    equations = Equations(system.flat)
    floating = _Floating(system, jacobian).around(int(rows[0]))
    if len(floating):
        _floats(system, equations, floating, rows, report)
        return
    sources = system.source[rows].tolist()
    columns = distinct(system.incidence.column[system.incidence.of_rows(rows)])
    names = [system.name(c) for c in columns.tolist()]
    parts = equations.parts(sources)
    noun = "constraint" if len(sources) == 1 else "constraints"
    message = f"the {noun} of {listed(parts or names)} cannot be solved near the start"
    found = "; ".join(equations.text(s) for s in sources[:SHOWN])
    hint = f"give {listed(names[:3])} start values away from a dead centre, or remove a redundant constraint"
    _at(equations, sources, report, "E0404", message, found=found, hint=hint)


def singular_blocks(
    system: EquationSystem,
    square: SquareSystem,
    layout: RegisterLayout,
    jacobian: Tied,
    blocks: Sequence[np.ndarray],
    report: Report,
) -> None:
    """E0405: linear equations whose matrix is singular for the present parameter values (or E0402)."""
    equations, found = Equations(system.flat), Report()
    floating = _Floating(system, jacobian)
    variable, order = layout.jets
    for members in blocks[:LOOKED_AT]:
        rows = distinct(np.array([row_of(square, int(e)) for e in members]))
        positions = floating.around(int(rows[0]))
        if len(positions):
            _floats(system, equations, positions, rows, found)
            continue
        sources = system.source[rows].tolist()
        registers = square.match[members]
        jets = [system.flat.jet_name(int(variable[r]), int(order[r])) for r in registers.tolist()]
        message = f"{listed(jets)} cannot be determined: with these parameters their equations depend on each other"
        hint = "a parameter that is zero, or two that cancel; or nothing fixes the position of a massless part"
        texts = "; ".join(equations.text(s) for s in sources[:SHOWN])
        _at(equations, sources, found, "E0405", message, found=texts, hint=hint)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(blocks) - LOOKED_AT))


class _Floating:
    """Positions that can move together, where a matrix is singular: looked for in connected pieces of it."""

    def __init__(self, system: EquationSystem, jacobian: Tied) -> None:
        self._system, self._ports = system, _Ports(system)
        row, column = jacobian.row, jacobian.column
        tight = Incidence.of(len(system.source), len(system.variable), row, column, np.zeros(len(row), np.int64))
        self._pieces = components(tight, np.arange(tight.rows), np.arange(tight.columns))
        self._piece = np.empty(tight.rows, np.int64)  # of each row
        for k, (rows, _) in enumerate(self._pieces):
            self._piece[rows] = k
        order = np.argsort(self._piece[row], kind="stable")
        self._row, self._column, self._value = row[order], column[order], jacobian.value[order]
        self._start = np.searchsorted(self._piece[self._row], np.arange(len(self._pieces) + 1))

    def around(self, row: int) -> np.ndarray:
        """Return what the piece with this row leaves undetermined."""
        piece = int(self._piece[row])
        members, columns = self._pieces[piece]
        if not 0 < len(columns) <= RANK:
            return columns[:0]
        own = slice(*self._start[piece : piece + 2])
        matrix = np.zeros((len(members), len(columns)))
        at = np.searchsorted(members, self._row[own]), np.searchsorted(columns, self._column[own])
        matrix[at] = self._value[own]
        if not np.isfinite(matrix).all():
            return columns[:0]
        matrix /= np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
        _, size, right = np.linalg.svd(matrix)
        free = np.abs(right[size <= 1e-9 * size[0]]).max(axis=0, initial=0) > 1e-6
        return self._ports.on(self._system.variable[columns[free]])


def _floats(
    system: EquationSystem, equations: Equations, positions: np.ndarray, rows: np.ndarray, report: Report
) -> None:
    message = f"nothing fixes the absolute position of {listed(_carriers(system.flat, positions))}"
    hint = "only differences of positions occur in their equations: fix one of them, or give one a mass or inertia"
    _at(equations, system.source[rows].tolist(), report, "E0402", message, hint=hint)


def row_of(square: SquareSystem, equation: int) -> int:
    """The undifferentiated equation behind one of the square system."""
    for r in square.rows:
        if r.first <= equation < r.first + r.count:
            return int(r.batch.row[equation - r.first])
    s = next(s for s in square.sums if s.first <= equation < s.first + len(s.sums.row))
    return int(s.sums.row[equation - s.first])


def refused_states(
    system: EquationSystem,
    states: Sequence[str],
    layout: RegisterLayout,
    is_state: np.ndarray,
    c: np.ndarray,
    report: Report,
) -> None:
    """E0406: requested variables that cannot be states, with the reason."""
    flat, n = system.flat, system.normalized
    equations = Equations(flat)
    for name in states:
        found = flat.find(name)
        for v in () if found is None else found:
            root, order = int(n.root[v]), int(n.order[v])
            column = int(system.column[root])
            if column >= 0 and is_state[layout.base[root] + order]:
                continue
            message = f"'{flat.variable_name(int(v))}' cannot be a state"
            if column < 0:
                _refuse(report, message, "its value is prescribed", _span(flat, int(v)))
                continue
            i = system.incidence
            rows = i.row[i.of_columns(np.array([column]))]
            tied = [int(system.source[r]) for r in rows.tolist() if c[r] > 0]
            reason = "its derivative is needed nowhere: it follows from the other variables at every instant"
            if tied:
                reason = f"it follows from the others through '{equations.text(tied[0])}'"
            _refuse(report, message, reason, _span(flat, int(v)))


def given_rates(
    system: EquationSystem, layout: RegisterLayout, is_state: np.ndarray, c: np.ndarray, report: Report
) -> None:
    """E0230: motions with a rate of their own (`given`) whose positions are states, which nothing would hold."""
    endless = (layout.width[system.variable] <= system.rate_orders(c)).any()
    for b, columns in system.given_motions():
        free = is_state[layout.base[system.variable[columns]]].all(axis=1) & (c[b.row] > 0) | endless
        if free.any():
            equations, source = Equations(system.flat), int(system.source[b.row[np.flatnonzero(free)[0]]])
            message = f"the rate that a function gives itself in '{equations.text(source)}' moves what is a state"
            report.error("E0230", message, next(iter(equations.spans([source])), None),
                         hint="states=[…], --states or stateSelect chooses others")  # fmt: skip


def _refuse(report: Report, message: str, reason: str, span: Span | None) -> None:
    hint = "leave it out of states=[…] (--states), or name fewer states"
    report.error("E0406", f"{message}: {reason}", span, hint=hint, subject=Subject.STATE_REFUSED)


def notes(system: EquationSystem, choice: Choice, tied: Tied) -> tuple[Diagnostic, ...]:
    """N0407: for constraints that stay in the system, which coordinates were chosen and what follows from them."""
    if not choice.dependent or tied.constant.all():
        return ()
    curved = np.isin(tied.row, tied.row[~tied.constant])
    columns = distinct(tied.column[curved])
    dependent = np.isin(columns, choice.dependent[0])
    chosen = [system.name(c) for c in columns[~dependent].tolist()]
    following = [system.name(c) for c in columns[dependent].tolist()]
    if not chosen:
        return ()
    verb = "is the coordinate" if len(chosen) == 1 else "are the coordinates"
    follow = "follows" if len(following) == 1 else "follow"
    message = f"{listed(chosen)} {verb}; {listed(following)} {follow} through constraints"
    return (Diagnostic("N0407", message, hint="states=[…], --states or stateSelect chooses others"),)


def immobile(system: EquationSystem, columns: np.ndarray, rows: np.ndarray) -> tuple[Diagnostic, ...]:
    """W0417: inertias that constraints hold in one place.

    Parameters
    ----------
    columns, rows : from `mobility.immobile`
    """
    if not len(columns):
        return ()
    equations = Equations(system.flat)
    sources = system.source[rows].tolist()
    who = listed(equations.parts(sources)) or "the constraints"
    names = [system.name(c) for c in columns.tolist()]
    spans = equations.spans(sources)
    message = f"{who} leave {listed(names)} no freedom: only rest is possible"
    labels = tuple(Label(s, "also here") for s in spans[1:SHOWN])
    return (Diagnostic("W0417", message, spans[0] if spans else None, hint=HELD, labels=labels),)


def differentiated_jumps(system: EquationSystem, c: np.ndarray) -> tuple[Diagnostic, ...]:
    """Return notes on expressions that are differentiated although they may jump, or bend, without an event (N0418).

    Parameters
    ----------
    c : (rows,) how often each equation is differentiated
    """
    jumps = [b for b in system.batches if next(deciding(b.shape, b.kinds), None) is not None]
    kinks = [b for b in system.batches if bends(b.shape, b.kinds)]
    if not jumps and not kinks:
        return ()
    groups, sums = system.flat.groups, system.flat.sums
    smooth = np.repeat([g.smooth for g in groups] + [0], [g.rows for g in groups] + [sums.rows])[system.source]
    c = np.where((smooth > 0) & (c <= smooth + 1), 0, c)  # what is continuous up to there has no impulse
    return (
        *_not_derived(system, jumps, c > 0, "the derivative", "what jumps inside noEvent or smooth",
                      "where the value jumps, leave them out: the jump is an event then, and its impulse is computed"),
        *_not_derived(system, kinks, c > 1, "the second derivative", "the impulse of a kink",
                      "where the slope jumps, write an if-expression: the impulse is computed then"),
    )  # fmt: skip


def _not_derived(
    system: EquationSystem, batches: list[EquationBatch], derived: np.ndarray, what: str, lacks: str, hint: str
) -> tuple[Diagnostic, ...]:
    rows = [int(b.row[k]) for b in batches for k in np.flatnonzero(derived[b.row])[:1]]  # one of many alike
    if not rows:
        return ()
    equations = Equations(system.flat)
    sources = system.source[rows].tolist()
    spans = [span for span in equations.spans(sources) if span is not None]
    message = f"{what} of {equations.begun(sources[0])} does not contain {lacks}"
    labels = tuple(Label(span, "also here") for span in spans[1:SHOWN])
    return (Diagnostic("N0418", message, spans[0] if spans else None, hint=hint, labels=labels),)


# ---------------------------------------------------------------------------- wording


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _span(flat: FlatDAE, variable: int) -> Span | None:
    return flat.declared_at(variable)


def _at(
    equations: Equations,
    sources: Sequence[int],
    report: Report,
    code: str,
    message: str,
    fallback: Span | None = None,
    **more: str,
) -> None:
    spans = equations.spans(sources)
    labels = tuple(Label(s, "also here") for s in spans[1:SHOWN])
    report.error(code, message, spans[0] if spans else fallback, labels=labels, **more)
