"""Normalize: eliminate what is linear with parameter coefficients, at position level, and judge the loops.

The first half of reduction: a `FlatDAE` comes in, a `Normalized` in root jets goes out, square as before: as many
equations left as unknown roots.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.expression.dag import ZERO, slot, sub
from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import JetGroup, LongSums, Normalized
from lmoc.messages.diagnostics import Report, nearest
from lmoc.structure.linear.affine import Affine
from lmoc.structure.linear.coefficients import KNOWN, UNKNOWN
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.structure.linear.elimination import Elimination
from lmoc.structure.linear.substitution import Rows, jet, merged
from lmoc.structure.linear.sum_rows import LONGEST_SHAPE, SumRows, as_groups, view
from lmoc.structure.loops import judgement
from lmoc.structure.loops.redundancy import constraints, free_reactions
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX


def normalize(flat: FlatDAE, values: np.ndarray, states: Sequence[str] | None, report: Report) -> Normalized:
    """Eliminate aliases, ratios, offsets and derivative aliases; recognize redundant and contradictory constraints.

    Parameters
    ----------
    flat : FlatDAE
    values : (flat.count,) from `FlatDAE.parameter_values`
    states : names of variables that the user wants as coordinates, best first
    report : collects E0411 (contradictory), E0412 (only rest is possible), E0413 (prescribed twice),
        E0414 (unknown state), E0416 (a force that nothing takes)

    Raises
    ------
    ModelError
        At the end, when there was an error.
    """
    work = Elimination(flat, values, _asked(flat, states, report))
    work.run()
    repeated: dict[int, list[int]] = {number: [] for number in (*work.empty_sums, *judgement.closed(work, report))}
    judged = Report()
    judgement.overdetermined(work, judged)
    report.diagnostics += judged.errors
    held = [d for d in judged.diagnostics if d.severity == "warning"]
    sums = _finish_sums(work)
    guards = list(work.splitter.guards)
    flow = work.marked(lambda b: b.flow and b.connector)
    doubtful = constraints(work.groups, flow & ~work.coordinates)
    all_groups = work.groups
    dropped = {} if doubtful is None else judgement.dependent(work, doubtful, guards, report)
    report.check()
    reactions = _free_reactions(work, sums) if repeated or dropped else ([], np.zeros(0, np.int64))
    if dropped and flow.any() and len(reactions[0]) < len(repeated) + len(dropped):
        # leverages are tied to each other by the constraints: `loops.manifold` looks at places that satisfy these
        work.groups, dropped = all_groups, {}
        reactions = _free_reactions(work, sums) if repeated else reactions
    repeated |= dropped
    undetermined = _fix_reactions(work, reactions, list(repeated)) if repeated else np.zeros(0, np.int64)
    root, order, factor, offset = _way_back(work.table, work.zero, work.derived)
    derived_values = work.derived.known[flat.count :].copy()
    work.derived.finish()
    groups = tuple(JetGroup(g.shape, g.slots, g.source) for g in merged(work.groups))
    return Normalized(
        flat=flat,
        values=values,
        derived=tuple(work.derived.assignments),
        derived_values=derived_values,
        root=root,
        order=order,
        factor=factor,
        offset=offset,
        groups=groups,
        sums=sums,
        guards=tuple(guards),
        notes=(*judgement.redundancy_notes(work.loops, repeated), *held),
        counts={"equations": flat.equation_count, "after elimination": sum(g.rows for g in groups) + sums.rows},
        undetermined=undetermined,
    )


def _asked(flat: FlatDAE, states: Sequence[str] | None, report: Report) -> np.ndarray:
    """Indices of the variables requested as states."""
    found = []
    for name in states or ():
        variables = flat.find(name)
        if variables is None:
            hint = nearest(name, (b.name(0) for b in flat.blocks if b.size))
            report.error("E0414", f"there is no variable '{name}' to be a state", hint=hint)
        else:
            found.append(variables)
    return np.concatenate(found) if found else np.zeros(0, np.int64)


# --------------------------------------------------------------------- reactions


def _free_reactions(work: Elimination, sums: LongSums) -> tuple[list[int], np.ndarray]:
    """The reactions of which only combinations are determined, as `free_reactions` returns them."""
    port = work.marked(lambda b: b.connector) & (work.kind == UNKNOWN)
    long = SumRows(np.repeat(np.arange(sums.rows), np.diff(sums.start)), sums.index, sums.coefficient, sums.source)
    return free_reactions(work.groups, long, work.coordinates, port, work.derived.known)


def _fix_reactions(work: Elimination, reactions: tuple[list[int], np.ndarray], repeated: list[int]) -> np.ndarray:
    """For every repeated constraint set one reaction of its loop to zero; returns the variables left undetermined."""
    chosen, free = np.array(reactions[0][: len(repeated)], np.int64), reactions[1]
    if not len(chosen):
        return np.zeros(0, np.int64)
    work.groups.append(Rows(slot(0), (UNKNOWN,), chosen[:, None], np.array(repeated[: len(chosen)])))
    lost = np.zeros(work.flat.count + 1, bool)
    lost[free] = True
    return np.flatnonzero(lost[work.table.root[:-1]])


# -------------------------------------------------------------------------- ending


def _finish_sums(work: Elimination) -> LongSums:
    """Short balances become equations; in long ones a term that is not ± a root keeps its own variable."""
    seen = view(work.sums, work.table, work.kind, work.zero)
    odd_rows = np.ones(len(work.sums.source), bool)
    odd_rows[seen.plain_rest] = False
    odd = work.sums.take(odd_rows)
    _revive(work, distinct(odd.index))
    plain = view(work.sums, work.table, work.kind, work.zero).plain
    short = plain.lengths <= LONGEST_SHAPE
    work.groups += as_groups(plain.take(short))
    long = plain.take(~short)
    start = np.concatenate([[0], np.cumsum(long.lengths)])
    return LongSums(start, long.index, np.zeros(len(long.index), INDEX), long.sign, long.source)


def _revive(work: Elimination, variables: np.ndarray) -> None:
    """Give variables that are a factor times a root, or known, back their own place, with an equation."""
    table, rows = work.table, work.table.take(variables)
    plain = (rows.factor < 0) & (rows.offset < 0) & (rows.order == 0) & (work.kind[rows.root] == UNKNOWN)
    gone = (rows.root == work.zero) & (rows.offset < 0)
    variables = variables[~(plain | gone)]
    rows = table.take(variables)
    for code in distinct(rows.code).tolist():
        mine = np.flatnonzero(rows.code == code)
        v = variables[mine]
        shape = sub(slot(0), jet(code, 0, (1, 2, 3)))
        slots_ = np.stack([v, rows.root[mine], rows.factor[mine], rows.offset[mine]], axis=1)
        for kind in distinct(work.kind[rows.root[mine]]).tolist():
            part = np.flatnonzero(work.kind[rows.root[mine]] == kind)
            source = work.loops.source[v[part]]
            new = Rows(shape, (UNKNOWN, kind, KNOWN, KNOWN), slots_[part], source).with_shape(shape)
            work.groups.append(new)
    table.put(variables, Affine(variables, *Affine.identity(0).columns()[1:]))


def _way_back(
    table: Affine, zero: int, derived: DerivedParameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The table as `Normalized` wants it: signs inside factors and offsets, known values as roots."""
    root, order = table.root[:-1].copy(), table.order[:-1].astype(INDEX)
    factor = np.where((table.factor[:-1] < 0) & (table.sign[:-1] < 0), -2, table.factor[:-1])
    offset = table.offset[:-1].copy()
    negative = np.flatnonzero((table.sign[:-1] < 0) & (factor >= 0))
    if len(negative):
        factor[negative] = derived.negative(factor[negative])
    negative = np.flatnonzero((table.offset_sign[:-1] < 0) & (offset >= 0))
    if len(negative):
        offset[negative] = derived.negative(offset[negative])
    known = np.flatnonzero(root == zero)
    if len(known):
        nothing = offset[known] < 0
        if nothing.any():
            offset[known[nothing]] = derived.define(ZERO, np.zeros((1, 0), np.int64))[0]
        root[known], factor[known], offset[known] = offset[known], -1, -1
    return root, order, factor, offset
