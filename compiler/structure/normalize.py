"""Normalize: eliminate what is linear with parameter coefficients, at position level, and judge the loops.

The first half of reduction: a `FlatDAE` comes in, a `Normalized` in root jets goes out, square as before: as many
equations left as unknown roots.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lmoc.diagnostics import Diagnostic, Label, Report, nearest
from lmoc.distinct import distinct
from lmoc.expression.dag import ZERO, slot, sub
from lmoc.semantics.flat import FlatDAE
from lmoc.structure.affine import Affine
from lmoc.structure.coefficients import KNOWN, UNKNOWN, is_constant
from lmoc.structure.derived import DerivedParameters
from lmoc.structure.elimination import Elimination
from lmoc.structure.equations import Loops
from lmoc.structure.normalized import JetGroup, LongSums, Normalized
from lmoc.structure.reduced import Guard
from lmoc.structure.redundancy import Constraints, constraints, free_reactions
from lmoc.structure.substitution import Rows, jet, merged
from lmoc.structure.sum_rows import LONGEST_SHAPE, SumRows, as_groups, view
from lmoc.structure.vanishing import Missing

# of a mistake made in every row of an array, this many are shown
SHOWN = 3


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
    repeated = [*work.empty_sums, *_closed(work, report)]
    _overdetermined(work, report)
    sums = _finish_sums(work)
    flow_like = _marked(work, lambda b: b.flow and b.connector) & ~_coordinates(work)
    core = constraints(work.groups, flow_like, work.derived.known)
    guards = list(work.splitter.guards)
    if core is not None:
        repeated += _core(work, core, guards, report)
    report.check()
    undetermined = np.zeros(0, np.int64)
    notes: tuple[Diagnostic, ...] = ()
    if repeated:
        undetermined = _fix_reactions(work, sums, repeated)
        notes = tuple(_redundancy_notes(work.loops, repeated))
    root, order, factor, offset = _way_back(work.table, work.zero, work.derived)
    groups = tuple(JetGroup(g.shape, g.slots, g.source) for g in merged(work.groups))
    left = sum(g.rows for g in groups) + sums.rows
    return Normalized(
        flat,
        values,
        tuple(work.derived.assignments),
        work.derived.known[flat.count :].copy(),
        root,
        order,
        factor,
        offset,
        groups,
        sums,
        tuple(guards),
        notes,
        {"equations": flat.equation_count, "after elimination": left},
        undetermined,
    )


def _asked(flat: FlatDAE, states: Sequence[str] | None, report: Report) -> np.ndarray:
    """Indices of the variables asked for as states."""
    found = []
    for name in states or ():
        variables = flat.find(name)
        if variables is None:
            hint = nearest(name, (b.name(0) for b in flat.blocks if b.size))
            report.error("E0414", f"there is no variable '{name}' to be a state", hint=hint)
        else:
            found.append(variables)
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def _marked(work: Elimination, mark) -> np.ndarray:
    """The roots that stand for variables of marked blocks; a mask over flat variables and the constant 0."""
    mask = np.zeros(work.flat.count + 1, bool)
    blocks = work.flat.per_variable(mark, bool)
    mask[work.table.root[:-1][blocks & (work.table.order[:-1] == 0)]] = True
    mask[work.zero] = False
    return mask


def _coordinates(work: Elimination) -> np.ndarray:
    """The roots that stand for positions of connectors or are differentiated."""
    return _marked(work, lambda b: b.connector and not b.flow) | work.differentiated


# ----------------------------------------------------------------------- judging


def _closed(work: Elimination, report: Report) -> list[int]:
    """Judge the equations in which no unknown is left; returns those that repeat others."""
    repeated: list[int] = []
    for g in work.closed:
        if g.shape is ZERO:
            repeated += g.source.tolist()
        elif is_constant(g.shape, g.kinds):
            zero = work.splitter.vanishing(g, g.shape, Missing.FITTING)
            repeated += g.source[zero].tolist()
            for row in np.flatnonzero(~zero)[:SHOWN].tolist():
                _contradiction(work, g, row, report)
        else:
            for number in g.source[:SHOWN].tolist():
                _prescribed_twice(work.loops, number, report)
    return repeated


def _contradiction(work: Elimination, g: Rows, row: int, report: Report) -> None:
    loops, number = work.loops, int(g.source[row])
    around = loops.around(number)
    if any(map(loops.equations.is_balance, around)):
        _unresisted(loops, around, report)
        return
    parts = loops.equations.parts(around)
    who = f"{_listed(parts)} contradict each other" if len(parts) > 1 else "this equation contradicts others"
    if len(around) == 1:
        who = "this equation cannot hold"
    found = f"{work.splitter.text(g, g.shape, row)} = 0 would have to hold"
    _at_loop(loops, around, report, "E0411", f"{who}: no position satisfies all of them", found=found)


def _unresisted(loops: Loops, around: list[int], report: Report) -> None:
    who = _listed(loops.equations.parts(around)) or f"'{loops.equations.text(around[0])}'"
    message = f"nothing takes the force of {who}: no mass, spring or support is there to resist it"
    hint = "connect it to a part with mass, or to one that holds it"
    _at_loop(loops, around, report, "E0416", message, hint=hint)


def _prescribed_twice(loops: Loops, number: int, report: Report) -> None:
    around = loops.around(number)
    if any(map(loops.equations.is_balance, around)):
        _unresisted(loops, around, report)
        return
    who = _listed(loops.equations.parts(around)) or f"'{loops.equations.text(number)}'"
    message = f"a motion is prescribed twice, through {who}"
    _at_loop(loops, around, report, "E0413", message, hint="prescribe one of them, or put a spring between")


def _overdetermined(work: Elimination, report: Report) -> None:
    """Loops whose ratios do not agree: an error among coordinates of a mechanism, an equation elsewhere."""
    if not work.overdetermined:
        return
    potential = _marked(work, lambda b: b.connector and not b.flow)
    loops = work.loops
    for g in work.overdetermined:
        variable = g.slots[:, [k for k, kind in enumerate(g.kinds) if kind == UNKNOWN]][:, 0]
        for row, v in enumerate(variable[:SHOWN].tolist()):
            # by now it hangs on the constant that the loop has given it: look at its class as it was
            if not (work.differentiated[v] or potential[v] or _ports(work, v)):
                continue
            around = loops.around(int(g.source[row]))
            if _balances_forces(work.flat, loops, around):
                continue  # the position of a massless point between springs to the ground
            parts = _listed(loops.equations.parts(around)) or f"'{loops.equations.text(int(g.source[row]))}'"
            message = f"{parts} form a loop whose ratios do not agree: only rest is possible"
            _at_loop(loops, around, report, "E0412", message, found=work.splitter.text(g, g.shape, row) + " = 0")


def _balances_forces(flat: FlatDAE, loops: Loops, around: list[int]) -> bool:
    """Whether flows of connectors take part: then the loop is one of forces, not of transmissions."""
    blocks = (flat.block_at(v) for number in around for v in loops.equations.unknowns(number))
    return any(block.flow and block.connector for block in blocks)


def _ports(work: Elimination, variable: int) -> bool:
    """Whether a position of a connector hangs on this variable."""
    flat, node = work.flat, variable
    children = np.flatnonzero(work.loops.parent[:-1] == node).tolist()
    seen = {node, *children}
    while children:
        node = children.pop()
        block = flat.block_at(node)
        if block.connector and not block.flow:
            return True
        new = set(np.flatnonzero(work.loops.parent[:-1] == node).tolist()) - seen
        seen |= new
        children += new
    return False


def _core(work: Elimination, core: Constraints, guards: list[Guard], report: Report) -> list[int]:
    """Judge the constraints between three and more coordinates; drops those that repeat others and returns them."""
    judged = core.judged(work.derived.known, work.derived)
    if core.depends_on_parameters:
        derived = work.derived

        def holds(values: np.ndarray) -> bool:
            return core.judged(derived.extended(values), derived) == judged

        parts = work.loops.equations.parts(core.source[core.kept].tolist())
        guards.append(Guard(holds, f"which constraints of {_listed(parts) or 'the model'} repeat others"))
    dropped = []
    for number, others, consistent in judged:
        if consistent:
            dropped.append(number)
            continue
        around = [number, *others]
        parts = _listed(work.loops.equations.parts(around)) or f"'{work.loops.equations.text(number)}'"
        message = f"{parts} contradict each other: no position satisfies all of them"
        _at_loop(work.loops, around, report, "E0411", message)
    if dropped:
        gone = np.zeros(work.flat.equation_count, bool)
        gone[dropped] = True
        work.groups = [g.take(np.flatnonzero(~gone[g.source])) for g in work.groups]
    return dropped


def _at_loop(loops: Loops, around: list[int], report: Report, code: str, message: str, **more) -> None:
    spans = loops.equations.spans(around)
    labels = tuple(Label(s, "also here") for s in spans[1:])
    report.error(code, message, spans[0] if spans else None, labels=labels, **more)


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1] if names else ""


# --------------------------------------------------------------------- reactions


def _fix_reactions(work: Elimination, sums: LongSums, repeated: list[int]) -> np.ndarray:
    """For every repeated constraint set one reaction of its loop to zero; returns the variables left undetermined."""
    flat = work.flat
    coordinate = _coordinates(work)
    port = _marked(work, lambda b: b.connector) & (work.kind == UNKNOWN)
    long = SumRows(np.repeat(np.arange(sums.rows), np.diff(sums.start)), sums.index, sums.coefficient, sums.source)
    chosen, free = free_reactions(work.groups, long, coordinate, port, work.derived.known)
    chosen = np.array(chosen[: len(repeated)], np.int64)
    if not len(chosen):
        return np.zeros(0, np.int64)
    work.groups.append(Rows(slot(0), (UNKNOWN,), chosen[:, None], np.array(repeated[: len(chosen)])))
    lost = np.zeros(flat.count + 1, bool)
    lost[free] = True
    return np.flatnonzero(lost[work.table.root[:-1]])


def _redundancy_notes(loops: Loops, repeated: list[int]) -> Iterable[Diagnostic]:
    more = len(repeated) - SHOWN
    for i, number in enumerate(repeated[:SHOWN]):
        around = loops.around(number)
        parts = _listed(loops.equations.parts(around))
        where = f"; the forces in the loop {parts} are not unique" if parts else ""
        text = loops.equations.text(number)
        message = f"the constraint '{text}' repeats others{where}"
        hint = f"{more} more constraints repeat others" if i == SHOWN - 1 and more > 0 else ""
        yield Diagnostic("N0415", message, loops.equations.span(number), hint=hint)


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
    return LongSums(start, long.index, np.zeros(len(long.index), np.int64), long.sign, long.source)


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
    root, order = table.root[:-1].copy(), table.order[:-1].astype(np.int64)
    factor = np.where((table.factor < 0) & (table.sign < 0), -2, table.factor)[:-1]
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
