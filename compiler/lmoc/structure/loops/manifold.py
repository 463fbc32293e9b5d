"""Constraints that follow from others only where all of them hold: the third of three parallel cranks.

Whether a constraint is a combination of others at every place is decided from its terms (`redundancy`); here it is
decided at points that satisfy all constraints, near the start: a point beside the start is brought back to them by
Gauss–Newton steps, rows of the Jacobian that depend on earlier ones there are set aside, and each of them must vanish
wherever the others do, at further points as well. Where the Jacobian loses its rank at the start alone (a stretched
parallelogram), the points beside it say so, and no constraint is dropped. A constraint without rank of its own that
still says something, as (x - y)^2 = 0, does not vanish where the others do, and stays. Cf. Wojtyra and Frączek,
"Solvability of reactions in rigid multibody systems with redundant nonholonomic constraints", Multibody System
Dynamics 30 (2013) 153; Arabyan and Wu, "An improved formulation for constrained mechanical systems", ibid. 2 (1998) 49.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr, const, function, slot, sub
from lmoc.expression.evaluate import evaluate, evaluate_together
from lmoc.ir.flat import Block, Check, FlatDAE
from lmoc.ir.normalized import JetGroup, Normalized
from lmoc.ir.reduced import Guard
from lmoc.messages.diagnostics import Diagnostic, Label, Subject
from lmoc.structure.index.dulmage_mendelsohn import components
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import UNKNOWN, leaves_of
from lmoc.structure.linear.derived import derived_values
from lmoc.structure.linear.generic import spread
from lmoc.structure.linear.substitution import Rows, with_numbers
from lmoc.structure.linear.sum_rows import SumRows
from lmoc.structure.loops.nearest import closed, nearest
from lmoc.structure.loops.redundancy import constraints, free_reactions
from lmoc.structure.loops.sample import Sample, given
from lmoc.structure.loops.smallest import in_rows_of_length_one, projected, surely_independent
from lmoc.structure.messages.equations import SHOWN, Equations, listed
from lmoc.support.records import dataclass
from lmoc.support.sizes import RANK

# how far beside the start points lie
ASIDE = 2e-2
# a row depends on others when no more than this share of it is left: first beside a place at which the rows to be
# dropped spoil the accuracy, then without them
SUSPECT, DEPENDENT = 1e-4, 1e-7
_STEPS = 20  # of Newton's method for a value that follows from others
# of rows nearly as long as the longest one, the first is kept
NEARLY = 0.7
# what a row may be beside the size of its terms where it follows from others
FOLLOWS = 1e-10
# what it may be during a run
VIOLATED = 1e-5


def without_dependent(normalized: Normalized) -> Normalized:
    """Return the equations without constraints that follow from others wherever all hold; the same where none does.

    For each of them one reaction is set to zero, and all that could have been otherwise are undetermined.
    """
    system = EquationSystem(normalized)
    rows = _rows(system)
    masks = _Masks(system, rows)
    core = constraints(rows, masks.flow & ~masks.coordinate)
    if core is None:
        return normalized
    found = _Judged.of(system, core.groups)
    if not found.dropped:
        return normalized
    place, told = _completed(found.place, core.groups, rows)
    masks.coordinate[told] = True  # what only constraints know is a position, too: the offset of a point on a body
    gone = np.zeros(normalized.flat.equation_count, bool)
    gone[list(found.dropped)] = True
    kept = [g.take(np.flatnonzero(~gone[g.source])) for g in rows]
    s = normalized.sums
    sums = SumRows(np.repeat(np.arange(s.rows), np.diff(s.start)), s.index, s.coefficient, s.source)
    chosen, free = free_reactions(kept, sums, masks.coordinate, masks.port, normalized.all_values, place)
    if len(chosen) < len(found.dropped):
        return normalized  # the equations stay as they are, and are refused for their own reason
    zero = np.array(chosen[: len(found.dropped)])
    groups = [JetGroup(g.shape, g.slots, g.source) for g in kept if len(g.source)]
    groups.append(JetGroup(slot(0), zero[:, None], np.array(list(found.dropped))))
    lost = np.zeros(normalized.extended_count, bool)
    lost[free] = True
    undetermined = np.union1d(normalized.undetermined, np.flatnonzero(lost[normalized.root]))
    return replace(
        normalized,
        flat=replace(normalized.flat, checks=(*normalized.flat.checks, *_watched(normalized.flat, found))),
        groups=tuple(groups),
        guards=(*normalized.guards, _guard(system, core.groups, found)),
        notes=(*normalized.notes, *_notes(normalized, found.dropped)),
        undetermined=undetermined,
        near=found.start,
    )


def _rows(system: EquationSystem) -> list[Rows]:
    groups = [g for g in system.normalized.groups if g.rows]
    return [Rows(g.residual, b.kinds, g.slots, g.source) for g, b in zip(groups, system.batches, strict=True)]


class _Masks:
    """Marks of roots; each (flat.count+1,)."""

    def __init__(self, system: EquationSystem, rows: list[Rows]):
        self.system = system
        self.flow = self._marked(lambda b: b.flow and b.connector)
        self.port = self._marked(lambda b: b.connector)
        self.coordinate = self._marked(lambda b: b.connector and not b.flow)
        for g in rows:
            for leaf in leaves_of(g.shape, g.kinds, UNKNOWN):
                if leaf.value[1] > 0:
                    self.coordinate[g.column(leaf)] = True
        roots = system.normalized.root[system.normalized.order > 0]
        self.coordinate[roots[system.column[roots] >= 0]] = True

    def _marked(self, mark: Callable[[Block], bool]) -> np.ndarray:
        n = self.system.normalized
        blocks = n.flat.per_variable(mark, bool)
        roots = n.root[blocks & (n.order == 0)]
        mask = np.zeros(n.flat.count + 1, bool)
        mask[roots[self.system.column[roots] >= 0]] = True
        return mask


@dataclass(frozen=True, eq=False)
class _Judged:
    """The constraints that follow from others.

    Attributes
    ----------
    dropped : {equation: those that it follows from}
    place : a point that satisfies all constraints, no special one
    start : roots, orders and values of the jets in these constraints where the scene starts
    size : {equation: what its terms sum up to there}
    """

    dropped: dict[int, list[int]]
    place: Sample
    start: tuple[np.ndarray, np.ndarray, np.ndarray]
    size: dict[int, float]

    @staticmethod
    def of(system: EquationSystem, groups: tuple[Rows, ...]) -> _Judged:
        highest = max(leaf.value[1] for g in groups for leaf in leaves_of(g.shape, g.kinds, UNKNOWN))
        start, ease = given(system, highest)
        value = start.value.copy()
        dropped: dict[int, list[int]] = {}
        size: dict[int, float] = {}
        jets, at_start = [np.zeros(0, np.int64)], [np.zeros(0)]
        for part in _components(groups, start, ease):
            found, first, place = part.judged()
            dropped |= found
            value.flat[part.jets] = place
            if found:
                jets.append(part.jets)
                at_start.append(first)
                size |= dict(zip(part.source.tolist(), part.sizes(place).tolist(), strict=True))
        order, root = np.divmod(np.concatenate(jets), value.shape[1])
        return _Judged(dropped, replace(start, value=value), (root, order, np.concatenate(at_start)), size)


def _completed(place: Sample, core: tuple[Rows, ...], rows: list[Rows]) -> tuple[np.ndarray, np.ndarray]:
    """Add what follows from the constraints one by one, as the offset of a point on a body that is held elsewhere.

    Returns
    -------
    The values of the jets (orders, extended) at the place, and the roots of those that the constraints tell.
    """
    value, width = place.value.copy(), place.value.shape[1]
    known = np.zeros(value.size, bool)
    for g in core:
        for leaf in leaves_of(g.shape, g.kinds, UNKNOWN):
            known[g.column(leaf) + leaf.value[1] * width] = True
    more = True
    while more:
        more = False
        for g in rows:
            leaves = leaves_of(g.shape, g.kinds, UNKNOWN)
            if not leaves or max(leaf.value[1] for leaf in leaves) >= len(value):
                continue
            jets = np.stack([g.column(leaf) + leaf.value[1] * width for leaf in leaves])
            lacking = ~known[jets]
            for leaf, jet, own in zip(leaves, jets, lacking & (lacking.sum(axis=0) == 1), strict=True):
                part = g.take(np.flatnonzero(own))
                if own.any() and _solved(part, leaf, jet[own], value, place.time):
                    known[jet[own]] = more = True
    return value, np.unique(np.flatnonzero(known) % width)


@np.errstate(all="ignore")
def _solved(g: Rows, leaf: Expr, jets: np.ndarray, value: np.ndarray, time: float) -> bool:
    """Put the values of one jet of some rows into `value`, by Newton's method; whether that has succeeded."""
    before, slope = value.flat[jets], differentiate(g.shape, leaf)
    for _ in range(_STEPS):
        found = (evaluate(e, lambda k, n: value[n, g.slots[:, k]], time) for e in (g.shape, slope))
        residual, factor = (np.broadcast_to(x, len(jets)) for x in found)
        change = -residual / factor
        value.flat[jets] += change
        if (np.abs(change) <= FOLLOWS * (1.0 + np.abs(value.flat[jets]))).all():
            return True
    value.flat[jets] = before
    return False


def _watched(flat: FlatDAE, judged: _Judged) -> Iterator[Check]:
    """Assertions that the dropped constraints hold during the run: on another branch they may not follow."""
    equations = Equations(flat)
    for number in judged.dropped:
        group, row = equations.place(number)
        if group < 0:
            continue  # a balance of flows is no constraint
        g = flat.groups[group]
        bound = const(VIOLATED * judged.size[number])
        missed = function("abs", sub(g.left, g.right))
        message = f"'{equations.text(number)}' no longer follows from the other constraints (another branch)"
        yield Check(function("le", missed, bound), message, True, g.slots[row : row + 1], g.span)


def _guard(system: EquationSystem, groups: tuple[Rows, ...], judged: _Judged) -> Guard:
    """The assumption that the same constraints follow from others."""
    normalized = system.normalized
    holds = partial(_drops_the_same, normalized, groups, frozenset(judged.dropped))
    parts = Equations(normalized.flat).parts(judged.dropped)
    return Guard(holds, f"the constraints of {listed(parts) or 'the model'} follow from others")


def _drops_the_same(
    normalized: Normalized, groups: tuple[Rows, ...], dropped: frozenset[int], values: np.ndarray
) -> bool:
    derived = derived_values(normalized.derived, values)
    other = EquationSystem(replace(normalized, values=values, derived_values=derived))
    return _Judged.of(other, groups).dropped.keys() == dropped


# --------------------------------------------------------------------- points that satisfy the constraints


@dataclass(frozen=True, eq=False)
class _Component:
    """Constraints that share unknown jets.

    Attributes
    ----------
    parts : (rows of one shape, their numbers here, the columns of each unknown jet here, its partial derivatives)
    source : (rows,) flat equation of each
    jets : (columns,) positions in the flattened sample
    start : Sample
    ease : (columns,) how easily the start value of each jet gives way
    """

    parts: tuple[tuple[Rows, np.ndarray, tuple[np.ndarray, ...], tuple[Expr, ...]], ...]
    source: np.ndarray
    jets: np.ndarray
    start: Sample
    ease: np.ndarray

    def judged(self) -> tuple[dict[int, list[int]], np.ndarray, np.ndarray]:
        """Return {equation: those it follows from}, and the values of the jets at the start and beside it."""
        begin = self.start.value.flat[self.jets]
        every = np.arange(len(self.source))
        first = nearest(begin, self.ease, self._linearized)
        if first is None or not self._vanishing(first, every):
            return {}, begin, begin
        place = self._closed(self._aside(first, every, 1), every)
        if place is None:
            return {}, first, first
        kept, _ = _independent(self._linearized(place)[1], SUSPECT)
        if len(kept) == len(every):
            return {}, first, place
        rest = np.setdiff1d(every, kept)
        tried = [self._closed(p, kept) for p in (place, self._aside(place, kept, 2), self._aside(place, kept, 3))]
        points = [p for p in tried if p is not None and self._vanishing(p, rest)]
        if len(points) < len(tried):
            return {}, first, place
        again, weights = _independent(self._linearized(points[0])[1], DEPENDENT)
        if len(again) != len(kept):
            return {}, first, place
        rest = np.setdiff1d(every, again)
        order = self.source
        return {int(order[r]): [int(order[k]) for k in weights[r]] for r in rest.tolist()}, first, points[0]

    def _aside(self, values: np.ndarray, rows: np.ndarray, turns: int) -> np.ndarray:
        """A point beside another one, in a direction that some of the constraints allow but no special one."""
        scale = np.sqrt(np.mean(values**2)) or 1.0
        direction = spread(len(values), turns) - 0.5
        return values + ASIDE * scale * projected(self._linearized(values)[1][rows], direction, SUSPECT)

    def _closed(self, values: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
        """The point that satisfies some of the constraints, reached by the smallest steps; None where they diverge."""
        found = closed(values, 1.0, lambda at: tuple(part[rows] for part in self._linearized(at)))
        return found if found is not None and self._vanishing(found, rows) else None

    def sizes(self, values: np.ndarray) -> np.ndarray:
        """(rows,) what the terms of each constraint sum up to."""
        return self._sizes(self._linearized(values)[1], values)

    def _sizes(self, jacobian: np.ndarray, values: np.ndarray) -> np.ndarray:
        ordinary = max(float(np.mean(v**2)) for v in (values, self.start.value.flat[self.jets])) ** 0.5
        result: np.ndarray = np.abs(jacobian) @ np.maximum(np.abs(values), ordinary)
        return result

    def _vanishing(self, values: np.ndarray, rows: np.ndarray) -> bool:
        residual, jacobian = self._linearized(values)
        return bool((np.abs(residual)[rows] <= FOLLOWS * self._sizes(jacobian, values)[rows]).all())

    def _linearized(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals (rows,) and their Jacobian (rows, columns)."""
        value = self.start.value.copy()
        value.flat[self.jets] = values
        residual, (places, entries) = np.zeros(len(self.source)), self._entries
        entries = entries.copy()
        for (g, numbers, _, _), (slopes, own) in zip(self.parts, self._changing, strict=True):
            found = evaluate_together((g.shape, *slopes), partial(_jets, value, g), self.start.time)
            residual[numbers] = found[0]
            for where, slope in zip(own, found[1:], strict=True):
                entries[where] = slope
        jacobian = np.zeros(len(self.source) * len(self.jets))
        np.add.at(jacobian, places, entries)
        return residual, jacobian.reshape(len(self.source), -1)

    @cached_property
    def _entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Places in the flattened Jacobian, and the values of its entries where the scene starts."""
        places, entries = [np.zeros(0, np.int64)], [np.zeros(0)]
        for g, numbers, columns, partials in self.parts:
            slopes = evaluate_together(partials, partial(_jets, self.start.value, g), self.start.time)
            places += [numbers * len(self.jets) + column for column in columns]
            entries += [np.broadcast_to(slope, len(numbers)) for slope in slopes]
        return np.concatenate(places), np.concatenate(entries)

    @cached_property
    def _changing(self) -> list[tuple[list[Expr], list[slice]]]:
        """Of each part the partial derivatives that change with the jets, and where their entries stand."""
        result, first = [], 0
        for g, numbers, _, partials in self.parts:
            changing = [k for k, p in enumerate(partials) if leaves_of(p, g.kinds, UNKNOWN)]
            starts = [first + k * len(numbers) for k in changing]
            result.append(([partials[k] for k in changing], [slice(at, at + len(numbers)) for at in starts]))
            first += len(partials) * len(numbers)
        return result


def _jets(value: np.ndarray, g: Rows, column: int, order: int) -> np.ndarray:
    """The derivative of that order of the variable in a column, in each row, among the values of all jets."""
    found: np.ndarray = value[order, g.slots[:, column]]
    return found


def _components(groups: tuple[Rows, ...], start: Sample, ease: np.ndarray) -> Iterator[_Component]:
    """The constraints in connected components, in the order of their equations; linear ones and large ones left out."""
    width = start.value.shape[1]
    source = np.concatenate([g.source for g in groups])
    row, jet = [], []
    for g, numbers in with_numbers(groups):
        for leaf in leaves_of(g.shape, g.kinds, UNKNOWN):
            row.append(numbers)
            jet.append(g.column(leaf) + leaf.value[1] * width)
    jets, column = np.unique(np.concatenate(jet), return_inverse=True)
    rows = np.concatenate(row)
    incidence = Incidence.of(len(source), len(jets), rows, column, np.zeros(len(rows), np.int64))
    for own_rows, own_columns in components(incidence, np.arange(len(source)), np.arange(len(jets))):
        if not 1 < len(own_rows) <= RANK:
            continue
        own_rows = own_rows[np.argsort(source[own_rows], kind="stable")]
        place = np.full(len(source), -1)
        place[own_rows] = np.arange(len(own_rows))
        own_jets = jets[own_columns]
        parts, curved = [], False
        for g, numbers in with_numbers(groups):
            mine = np.flatnonzero(place[numbers] >= 0)
            if not len(mine):
                continue
            part, leaves = g.take(mine), leaves_of(g.shape, g.kinds, UNKNOWN)
            columns = tuple(np.searchsorted(own_jets, part.column(f) + f.value[1] * width) for f in leaves)
            partials = tuple(differentiate(g.shape, leaf) for leaf in leaves)
            curved |= any(leaves_of(p, g.kinds, UNKNOWN) for p in partials)
            parts.append((part, place[numbers[mine]], columns, partials))
        if curved:
            yield _Component(tuple(parts), source[own_rows], own_jets, start, ease.flat[own_jets])


def _independent(jacobian: np.ndarray, share: float) -> tuple[np.ndarray, dict[int, list[int]]]:
    """Return as many independent rows as there are, and {each other row: the rows it depends on}.

    Rows are orthogonalized, of those left nearly the longest first, so that what is kept is well conditioned here
    (Businger and Golub, Numer. Math. 7, 1965; twice each: Björck, Numerical Methods for Least Squares Problems, 2.4).
    """
    unit = in_rows_of_length_one(jacobian)
    if surely_independent(unit, share):
        return np.arange(len(unit)), {}
    left = unit.copy()
    open_: np.ndarray = np.asarray(unit.any(axis=1))
    kept: list[int] = []
    while open_.any():
        length = np.where(open_, np.linalg.norm(left, axis=1), 0.0)
        if length.max() <= share:
            break
        number = int(np.argmax(length >= NEARLY * length.max()))
        kept.append(number)
        open_[number] = False
        direction = left[number] / length[number]
        for _ in range(2):
            left -= np.outer(left @ direction, direction)
    kept.sort()
    dependent: dict[int, list[int]] = {}
    for number in np.setdiff1d(np.arange(len(unit)), kept).tolist():
        weight = np.linalg.lstsq(unit[kept].T, unit[number], rcond=None)[0] if kept else np.zeros(0)
        dependent[number] = [k for k, w in zip(kept, weight, strict=True) if abs(w) > 10 * share]
    return np.array(kept, np.int64), dependent


# ------------------------------------------------------------------------------------- messages


def _notes(normalized: Normalized, dropped: dict[int, list[int]]) -> Iterator[Diagnostic]:
    equations = Equations(normalized.flat)
    for i, (number, others) in enumerate(list(dropped.items())[:SHOWN]):
        around = [number, *others]
        parts = listed(equations.parts(around))
        where = f"; the forces in the loop {parts} are not unique" if parts else ""
        message = f"the constraint '{equations.text(number)}' follows from others{where}"
        more = len(dropped) - SHOWN
        hint = f"{more} more constraints follow from others" if i == SHOWN - 1 and more > 0 else ""
        spans = equations.spans(around)
        labels = tuple(Label(s, "also here") for s in spans[1:])
        span = spans[0] if spans else None
        yield Diagnostic("N0415", message, span, hint=hint, labels=labels, subject=Subject.LEFT_OUT)
