"""The hybrid part of a flat model from its drafts, and its continuous equations without jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.events import Assigned, Events, Reinits, Samples, Terminations, Whens
from lmoc.ir.flat import FlatDAE, Group, Kind
from lmoc.messages.diagnostics import Report
from lmoc.semantics.assembly.assemble import Assembler
from lmoc.semantics.drafts.draft import ActionDraft, Drafts
from lmoc.semantics.events.relations import Extraction
from lmoc.semantics.events.whens import ASSIGNED


def with_events(flat: FlatDAE, drafts: Drafts, assembler: Assembler, report: Report) -> FlatDAE:
    """The flat model with what happens at instants in `FlatDAE.events`; itself where nothing does.

    Parameters
    ----------
    flat : with all equations among its groups, and relations as they are written
    report : collects E0251 (a discrete variable that would change between events), E0254 (determined twice)
    """
    if not _has_events(flat):
        return flat
    work = Extraction(flat.count, flat.variable_name)
    continuous, equations = _separated(flat, work, report)
    start, initial_groups = _start(flat, drafts, work)
    reinits = _reinits(drafts.reinits, assembler, work)
    changed = replace(
        flat,
        blocks=(*flat.blocks, *work.blocks),
        groups=(*continuous, *work.groups),
        initial_groups=initial_groups,
    )
    single = drafts.helpers.single
    events = Events(
        discrete=np.setdiff1d(np.flatnonzero(changed.kind == Kind.DISCRETE), _of_laws(flat)),
        before=_before(drafts),
        relations=tuple(replace(r, of_package=assembler.is_of_package(r.span)) for r in work.relations),
        equations=equations,
        start=start,
        samples=tuple(_samples(d, assembler) for d in drafts.samples),
        reinits=reinits,
        whens=tuple(
            Whens(assembler.slots((d.columns["active"],), d.rows)[:, 0], d.text, d.node.part, d.span)
            for d in drafts.whens
        ),
        terminations=tuple(
            Terminations(d.shape, assembler.slots(d.slots, d.rows), d.text, d.span) for d in drafts.terminations
        ),
        written=tuple(g for g in flat.groups if not _is_discrete(flat, g)) + tuple(work.groups),
        initial=single["initial()"].offset if "initial()" in single else -1,
        terminal=single["terminal()"].offset if "terminal()" in single else -1,
    )
    return replace(changed, events=events)


def _separated(flat: FlatDAE, work: Extraction, report: Report) -> tuple[list[Group], tuple[Assigned, ...]]:
    """Return the equations that hold between events, without relations, and those that are solved at them."""
    continuous: list[Group] = []
    equations: list[Assigned] = []
    for group in flat.groups:
        fixed = group.origin == ASSIGNED
        shapes, slots = work.without((group.left, group.right), group.slots, group.span, group.part, not fixed)
        (left, right), slots = _used(shapes, slots)
        kinds = _kinds(flat, work, slots)
        if fixed or (Kind.DISCRETE in kinds and Kind.UNKNOWN not in kinds):
            if not fixed and (Kind.INPUT in kinds or _timed(left, right)):
                _report_continuous(flat, group, report)
            equations.append(Assigned(left, right, slots, group.span, group.part, fixed))
        else:
            if left.op == "slot" and kinds and kinds[left.value[0]] == Kind.DISCRETE:
                _report_continuous(flat, group, report)
            continuous.append(replace(group, left=left, right=right, slots=slots))
    return continuous, tuple(equations)


def _before(drafts: Drafts) -> np.ndarray:
    """Return (2, k) what holds which value before an event; that of ``pre(pre(v))`` is taken first."""
    pairs = reversed(drafts.helpers.before.items())
    found = [np.stack([v.offset + np.arange(v.size) for v in pair]) for pair in pairs]
    return np.concatenate(found, axis=1) if found else np.zeros((2, 0), np.int64)


def _has_events(flat: FlatDAE) -> bool:
    if not np.isin(np.flatnonzero(flat.kind == Kind.DISCRETE), _of_laws(flat)).all():  # setdiff1d imports numpy.ma
        return True
    return any(n.op == "event" for g in flat.groups for e in (g.left, g.right) for n in dag.postorder(e))


def _of_laws(flat: FlatDAE) -> np.ndarray:
    """The discrete variables that the laws determine."""
    directions = [laws.direction for laws in flat.laws if laws.direction is not None]
    return np.concatenate(directions) if directions else np.zeros(0, np.int64)


def _is_discrete(flat: FlatDAE, group: Group) -> bool:
    """Return whether a group as it is written is an equation between discrete variables."""
    if group.origin == ASSIGNED:
        return True
    leaves = [leaf for side in (group.left, group.right) for leaf in dag.outside_events(side) if leaf.op == "slot"]
    kinds = {int(flat.kind[group.slots[0, leaf.value[0]]]) for leaf in leaves if group.rows}
    return Kind.DISCRETE in kinds and Kind.UNKNOWN not in kinds


def _used(shapes: list[Expr], slots: np.ndarray) -> tuple[list[Expr], np.ndarray]:
    """Only the columns that the shapes use."""
    columns = sorted({leaf.value[0] for shape in shapes for leaf in dag.slots(shape)})
    if columns == list(range(slots.shape[1])):
        return shapes, slots
    new = {leaf: dag.slot(columns.index(leaf.value[0]), leaf.value[1]) for shape in shapes for leaf in dag.slots(shape)}
    return [dag.substitute(shape, new) for shape in shapes], slots[:, columns]


def _kinds(flat: FlatDAE, work: Extraction, slots: np.ndarray) -> list[int]:
    added = {b.offset + k: b.kind for b in work.blocks for k in range(b.size)} if work.blocks else {}
    if not len(slots):
        return []
    return [int(flat.kind[v] if v < flat.count else added[v]) for v in slots[0].tolist()]


def _timed(*shapes: Expr) -> bool:
    return any(dag.depends_on_time(shape) for shape in shapes)


def _report_continuous(flat: FlatDAE, group: Group, report: Report) -> None:
    names = (flat.variable_name(int(v)) for v in group.slots[0] if flat.kind[v] == Kind.DISCRETE)
    report.error(
        "E0251",
        f"'{next(names, '')}' changes at events only, but this would change it between them",
        group.span,
        hint="assign it in a 'when', or leave out noEvent(…)",
    )


def _start(flat: FlatDAE, drafts: Drafts, work: Extraction) -> tuple[tuple[Assigned, ...], tuple[Group, ...]]:
    """The initial equations that determine discrete variables, and the others.

    One with continuous variables determines a discrete one that stands alone on a side, and that nothing else says
    anything of: no start value, for ``pre(v)`` no fixed one, and no equation between discrete variables. Rates get
    variables of their own, which discrete equations can read.
    """
    kinds = [{int(k) for k in flat.kind[g.slots[0]]} if g.rows else set() for g in flat.initial_groups]
    rates = [any(s.value[1] > 0 for side in (g.left, g.right) for s in dag.slots(side)) for g in flat.initial_groups]
    mixed = [Kind.DISCRETE in k and (Kind.UNKNOWN in k or r) for k, r in zip(kinds, rates, strict=True)]
    start = [Kind.DISCRETE in k and not m for k, m in zip(kinds, mixed, strict=True)]
    if any(mixed):
        own = [g for g, is_own in zip(flat.initial_groups, start, strict=True) if is_own]
        open_ = _undetermined(flat, drafts, own)
        for k, g in enumerate(flat.initial_groups):
            start[k] |= mixed[k] and any(open_[column].all() for column in _alone(g))
    assigned = (g for g, is_own in zip(flat.initial_groups, start, strict=True) if is_own)
    others = (g for g, is_own in zip(flat.initial_groups, start, strict=True) if not is_own)
    return tuple(_without_rates(g, work) for g in assigned), tuple(others)


def _without_rates(g: Group, work: Extraction) -> Assigned:
    """An initial equation of a discrete variable as one that is carried out."""
    (left, right), slots = work.without((g.left, g.right), g.slots, g.span, g.part, jets=False)
    return Assigned(left, right, slots, g.span, g.part, False)


def _undetermined(flat: FlatDAE, drafts: Drafts, own: list[Group]) -> np.ndarray:
    """(flat.count,) mask of discrete variables that have a value before, of whose start nothing is said otherwise."""
    pairs = [np.stack([v.offset + np.arange(v.size) for v in pair]) for pair in drafts.helpers.before.items()]
    now, before = np.concatenate([np.zeros((2, 0), np.int64), *pairs], axis=1)
    started, determined, open_ = np.zeros((3, flat.count), bool)
    for a in flat.starts:
        started[a.target] = True
    for column in (column for g in own for column in _alone(g)):
        determined[column] = True
    said = determined[now] | determined[before] | flat.is_fixed[now]
    open_[before], open_[now] = ~said, ~(said | started[now])
    return open_ & (flat.kind == Kind.DISCRETE)


def _alone(g: Group) -> list[np.ndarray]:
    """The variables that stand alone on a side."""
    return [g.slots[:, side.value[0]] for side in (g.left, g.right) if side.op == "slot" and side.value[1] == 0]


def _samples(draft: ActionDraft, assembler: Assembler) -> Samples:
    columns = [assembler.slots((draft.columns[name],), draft.rows)[:, 0] for name in ("target", "start", "interval")]
    return Samples(*columns, draft.span)  # type: ignore[call-arg]


def _reinits(drafts: list[ActionDraft], assembler: Assembler, work: Extraction) -> tuple[Reinits, ...]:
    result = []
    for d in drafts:
        guard, target = (assembler.slots((d.columns[name],), d.rows)[:, 0] for name in ("guard", "target"))
        slots = assembler.slots(d.slots, d.rows)
        (value,), slots = work.without((d.shape,), slots, d.span, d.node.part, jets=False)
        result.append(Reinits(guard, target, value, slots, d.span))
    return tuple(result)
