"""Piecewise linear equations that are solved together: which piece holds is decided at events.

An amplifier with limits that feeds its output back has up to three solutions, one on each piece. Which one holds is a
matter of where it came from, and ends where that piece does: there the output jumps. As the solution of an equation
without events, it would be what Newton's method comes to. So conditions that depend on what is solved together are
relations of their own (`ir.events.Relations`), also inside ``noEvent`` and ``smooth``.

Which equations are solved together, the block triangular form of the flat model says, at the orders of the Σ-method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.events import Events
from lmoc.ir.flat import FlatDAE, Group, Kind
from lmoc.semantics.events.relations import Extraction
from lmoc.structure.blocks.blocks import blocks_of
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.sigma import highest_value_transversal, offsets
from lmoc.structure.linear.explicit import jointly_linear
from lmoc.support.indices import INDEX, counted

_RELATIONS = ("gt", "ge", "lt", "le")
_EXTREMES = {"max": "gt", "min": "lt"}


def with_pieces(flat: FlatDAE) -> FlatDAE:
    """The flat model with relations for the pieces of its piecewise linear blocks; itself where it has none."""
    own = [k for k, g in enumerate(flat.groups) if g.rows and any(_conditions(flat, g))]
    if not own or flat.laws:
        return flat
    together = _Together.of(flat)
    found = [k for k in own if together is not None and together.decides_on(k)]
    if together is None or not found:
        return flat
    work = Extraction(flat.count, flat.variable_name)
    changed, count = _with_relations(flat, found, together, work), work.count
    if flat.simplified is not None:
        other = _with_relations(flat.simplified.flat, found, together, work)
        assert work.count == count, "the simplified model decides on other pieces"
        changed = replace(changed, simplified=replace(flat.simplified, flat=other))
    return changed


def _conditions(flat: FlatDAE, group: Group) -> Iterator[Expr]:
    """Yield the relations between unknowns that decide on a piece without an event."""
    for side in (group.left, group.right):
        for node in dag.nodes_outside_events(side):
            for relation in _relations(node):
                if any(flat.kind[group.slots[0, leaf.value[0]]] == Kind.UNKNOWN for leaf in dag.slots(relation)):
                    yield relation


def _relations(node: Expr) -> list[Expr]:
    """Return the relations that decide on the value of a node: the condition of an `if`, the larger of two."""
    if node.op == "if":
        return [n for n in dag.nodes_outside_events(node.args[0]) if n.op in _RELATIONS]
    if node.op in _EXTREMES:
        return [dag.function(_EXTREMES[node.op], *node.args)]
    return [dag.function("gt", node.args[0], dag.ZERO)] if node.op == "abs" else []


class _Together:
    """Which unknowns are solved together with which equations.

    Attributes
    ----------
    label : (equations,) the block of each
    solves : (variables,) the block that determines the highest derivative of each unknown, -1 where none does
    c, d : offsets of equations, and of variables
    """

    def __init__(self, flat: FlatDAE, label: np.ndarray, solves: np.ndarray, c: np.ndarray, d: np.ndarray) -> None:
        self.flat, self.label, self.solves, self.c, self.d = flat, label, solves, c, d
        self.first = np.cumsum([0, *(g.rows for g in flat.groups)])

    @staticmethod
    def of(flat: FlatDAE) -> _Together | None:
        """The blocks of a flat model; None where nobody knows yet what determines what."""
        unknown = np.flatnonzero(flat.kind == Kind.UNKNOWN)
        column = np.full(flat.count, -1, INDEX)
        column[unknown] = counted(0, len(unknown))
        incidence = _incidence(flat, column, len(unknown))
        match = highest_value_transversal(incidence)
        if match is None:
            return None
        c, d = offsets(incidence, match, np.zeros(len(unknown), INDEX))
        row_of = np.empty(len(unknown), np.int64)
        row_of[match] = np.arange(len(match))
        highest = d[incidence.column] - c[incidence.row] == incidence.order
        user, source = incidence.row[highest], row_of[incidence.column[highest]]
        label = blocks_of(user, source, incidence.rows).block
        solves, of_variable = np.full(flat.count, -1, np.int64), np.zeros(flat.count, np.int64)
        solves[unknown], of_variable[unknown] = label[row_of], d
        return _Together(flat, label, solves, c, of_variable)

    def decides_on(self, k: int) -> bool:
        """Return whether a group is linear but for pieces that are decided by what is solved with it.

        Equations that are differentiated have no jumps, and stay as they are.
        """
        group, rows = self.flat.groups[k], slice(self.first[k], self.first[k + 1])
        if self.c[rows].any() or not any(self.decides(k, group, r) for r in _conditions(self.flat, group)):
            return False
        left, right = self.marked(k, group)
        residual = _without_events(left - right)
        leaves = tuple(leaf for leaf in dag.slots(residual) if self._solves(k, group, leaf))
        return jointly_linear(residual, leaves) is not None

    def decides(self, k: int, group: Group, relation: Expr) -> bool:
        """Return whether a relation in the k-th group depends on what is solved together with it."""
        return any(self._solves(k, group, leaf) for leaf in dag.slots(relation))

    def _solves(self, k: int, group: Group, leaf: Expr) -> bool:
        column, order = leaf.value
        own = group.slots[:, column] if column < group.slots.shape[1] else np.zeros(0, np.int64)
        label = self.label[self.first[k] : self.first[k + 1]]
        return bool(len(own) and ((self.solves[own] == label) & (order == self.d[own])).any())

    def marked(self, k: int, group: Group) -> tuple[Expr, Expr]:
        """Return the sides of the k-th group with events where such relations decide."""
        left, right = (_marked(side, lambda r: self.decides(k, group, r)) for side in (group.left, group.right))
        return left, right


def _incidence(flat: FlatDAE, column: np.ndarray, columns: int) -> Incidence:
    """The highest derivatives of the unknowns in all equations: those of the groups in order, then the sums."""
    first = 0
    row, unknown, order = [], [], []
    for g in flat.groups:
        for leaf in {leaf for side in (g.left, g.right) for leaf in dag.slots(side)} if g.rows else ():
            if flat.kind[g.slots[0, leaf.value[0]]] == Kind.UNKNOWN:
                row.append(counted(first, first + g.rows))
                unknown.append(column[g.slots[:, leaf.value[0]]])
                order.append(np.full(g.rows, leaf.value[1], INDEX))
        first += g.rows
    used = column[flat.sums.index] >= 0
    row.append((first + np.repeat(np.arange(flat.sums.rows), np.diff(flat.sums.start)))[used])
    unknown.append(column[flat.sums.index[used]])
    order.append(np.zeros(int(used.sum()), INDEX))
    return Incidence.of(first + flat.sums.rows, columns, *map(np.concatenate, (row, unknown, order)))


def _marked(shape: Expr, decides: Callable[[Expr], bool]) -> Expr:
    """The shape with events where conditions decide; extremes and magnitudes of such as what they stand for."""
    new: dict[int, Expr] = {}
    for node in dag.postorder(shape):
        args = tuple(new[id(a)] for a in node.args)
        relations = [r for r in _relations(node) if decides(r)]
        if not relations:
            same = all(a is b for a, b in zip(args, node.args, strict=True))
            new[id(node)] = node if same else dag.rebuild(node.op, args)
        elif node.op == "if":
            new[id(node)] = dag.if_(dag.event(args[0]), *args[1:])
        else:
            other = args[1] if node.op in _EXTREMES else dag.neg(args[0])
            new[id(node)] = dag.if_(dag.event(relations[0]), args[0], other)
    return new[id(shape)]


def _without_events(shape: Expr) -> Expr:
    """The shape with something known in the place of each event."""
    known = dag.slot(1 + max((leaf.value[0] for leaf in dag.slots(shape)), default=0))  # a column behind all others
    new: dict[int, Expr] = {}
    for node in dag.postorder(shape):
        args = tuple(new[id(a)] for a in node.args)
        same = all(a is b for a, b in zip(args, node.args, strict=True))
        new[id(node)] = known if node.op == "event" else node if same else dag.rebuild(node.op, args)
    return new[id(shape)]


def _with_relations(flat: FlatDAE, found: list[int], together: _Together, work: Extraction) -> FlatDAE:
    """The flat model with the relations of some groups taken out."""
    groups = list(flat.groups)
    for k in found:
        group = groups[k]
        (left, right), slots = work.without(together.marked(k, group), group.slots, group.span, group.part)
        groups[k] = replace(group, left=left, right=right, slots=slots)
    added = np.concatenate([b.offset + np.arange(b.size) for b in work.blocks])
    return replace(
        flat,
        blocks=(*flat.blocks, *work.blocks),
        groups=(*groups, *work.groups),
        events=_with_added(flat, added, work),
    )


def _with_added(flat: FlatDAE, added: np.ndarray, work: Extraction) -> Events:
    old = flat.events
    if old is not None:
        return replace(old, discrete=np.concatenate([old.discrete, added]), relations=(*old.relations, *work.relations))
    nothing = np.zeros((2, 0), np.int64)
    return Events(added, nothing, tuple(work.relations), (), (), (), (), (), (), flat.groups)
