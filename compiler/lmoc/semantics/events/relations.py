"""Relations, and what else jumps, as discrete variables.

In the shapes of equations ``event(…)`` marks what jumps at events only. Here each relation in it becomes a discrete
variable of its own, and a row of `ir.events.Relations`: between events the equations then have no jump. ``sign``
becomes two relations; ``floor`` and its kin one discrete number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.expression.text import to_text
from lmoc.ir.events import Relations
from lmoc.ir.flat import Block, Group, Kind
from lmoc.messages.source import Span
from lmoc.support.records import dataclass


@dataclass(eq=False)
class Extraction:
    """Relations taken out of equations so far.

    Attributes
    ----------
    count : number of variables, those added included
    name : gives the name of a variable, for texts
    """

    count: int
    name: object
    blocks: list[Block] = field(default_factory=list)
    relations: list[Relations] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)  # equations of added variables
    _known: dict[tuple, np.ndarray] = field(default_factory=dict)

    def without(
        self, shapes: Sequence[Expr], slots: np.ndarray, span: Span | None, part: int, jets: bool = True
    ) -> tuple[list[Expr], np.ndarray]:
        """The shapes with discrete slots in place of what jumps, and the table with their columns.

        Parameters
        ----------
        jets : derivatives may stand outside of relations; else they get variables of their own, too
        """
        if not any(_needs(node, jets) for shape in shapes for node in dag.postorder(shape)):
            return list(shapes), slots
        table = _Table(self, slots, span, part)
        new: dict[int, Expr] = {}
        order = [node for shape in shapes for node in dag.postorder(shape)]
        inside = _inside_events(shapes)
        for node in order:
            if id(node) in new:
                continue
            if not node.args:
                plain = node.op != "slot" or not node.value[1] or (jets and id(node) not in inside)
                new[id(node)] = node if plain else table.derivative(node)
                continue
            args = tuple(new[id(a)] for a in node.args)
            same = all(a is b for a, b in zip(args, node.args, strict=True))
            rebuilt = node if same else dag.rebuild(node.op, args)
            new[id(node)] = table.jump(rebuilt) if id(node) in inside else rebuilt
        return [_bare(new[id(shape)]) for shape in shapes], table.slots

    def variables(self, text: str, rows: int, kind: Kind, quantity: str, part: int, span: Span | None) -> np.ndarray:
        """Add a block of variables; their indices."""
        path = ((text, (rows,) if rows != 1 else ()),)
        self.blocks.append(
            Block(path, self.count, rows, kind, quantity=quantity, protected=True, part=part, span=span)
        )
        first, self.count = self.count, self.count + rows
        return np.arange(first, first + rows)


def _needs(node: Expr, jets: bool) -> bool:
    return node.op == "event" or (not jets and node.op == "slot" and node.value[1] > 0)


def _inside_events(shapes: Sequence[Expr]) -> set[int]:
    """The nodes below an `event`."""
    return {
        id(inner)
        for shape in shapes
        for node in dag.postorder(shape)
        if node.op == "event"
        for inner in dag.postorder(node.args[0])
    }


def _bare(shape: Expr) -> Expr:
    """Without the marks."""
    new: dict[int, Expr] = {}
    for node in dag.postorder(shape):
        args = tuple(new[id(a)] for a in node.args)
        same = all(a is b for a, b in zip(args, node.args, strict=True))
        new[id(node)] = args[0] if node.op == "event" else node if same else dag.rebuild(node.op, args)
    return new[id(shape)]


class _Table:
    """The columns of one group while its relations are taken out."""

    def __init__(self, work: Extraction, slots: np.ndarray, span: Span | None, part: int) -> None:
        self.work, self.slots, self.span, self.part = work, slots, span, part

    def column(self, variables: np.ndarray) -> Expr:
        self.slots = np.column_stack([self.slots, variables])
        return dag.slot(self.slots.shape[1] - 1)

    def jump(self, node: Expr) -> Expr:
        """Return the replacement of a node below an `event`."""
        if node.op in ("gt", "ge", "lt", "le"):
            a, b = node.args if node.op in ("gt", "ge") else node.args[::-1]
            return self.relation("gt" if node.op in ("gt", "lt") else "ge", dag.sub(a, b), node)
        if node.op == "sign":
            (x,) = node.args
            negative = self.relation("gt", dag.neg(x), dag.function("lt", x, dag.ZERO))
            positive = self.relation("gt", x, dag.function("gt", x, dag.ZERO))
            return dag.if_(positive, dag.ONE, dag.if_(negative, dag.const(-1), dag.ZERO))
        if node.op in ("floor", "integer"):
            return self.relation("floor", node.args[0], node)
        if node.op == "ceil":
            return dag.neg(self.relation("floor", dag.neg(node.args[0]), node))
        if node.op == "mod":
            x, y = node.args
            return x - self.relation("floor", x / y, dag.function("floor", x / y)) * y
        if node.op in ("div_integer", "rem"):
            x, y = node.args
            down, up = (self.relation("floor", s * (x / y), dag.function("floor", s * (x / y))) for s in (1, -1))
            forward = self.relation("ge", x / y, dag.function("ge", x / y, dag.ZERO))
            quotient = dag.if_(forward, down, dag.neg(up))
            return quotient if node.op == "div_integer" else x - quotient * y
        return node

    def relation(self, op: str, zero: Expr, written: Expr) -> Expr:
        """The slot of the discrete variable that holds a relation's value; known where nothing in it changes."""
        columns = sorted({leaf.value[0] for leaf in dag.slots(zero)})
        if zero.is_const:
            return dag.function(op, zero) if op == "floor" else dag.function(op, zero, dag.ZERO)
        shape = dag.substitute(zero, {dag.slot(c): dag.slot(k) for k, c in enumerate(columns)})
        table, number = np.unique(self.slots[:, columns], axis=0, return_inverse=True)
        if not columns:
            table, number = np.zeros((1, 0), np.int64), np.zeros(len(self.slots), np.int64)
        key = (op, shape, table.tobytes())
        target = self.work._known.get(key)
        if target is None:
            names = table[0]
            text = to_text(_renumbered(written, columns), lambda k, n: _jet(self.work.name(int(names[k])), n))
            quantity = "Integer" if op == "floor" else "Boolean"
            target = self.work.variables(text, len(table), Kind.DISCRETE, quantity, self.part, self.span)
            self.work._known[key] = target
            self.work.relations.append(Relations(op, shape, table, target, text, self.span))
        return self.column(target[number.reshape(-1)])

    def derivative(self, leaf: Expr) -> Expr:
        """The slot of a variable for a derivative."""
        column, order = leaf.value
        table, number = np.unique(self.slots[:, column], return_inverse=True)
        key = ("der", order, table.tobytes())
        target = self.work._known.get(key)
        if target is None:
            text = _jet(self.work.name(int(table[0])), order)
            target = self.work.variables(text, len(table), Kind.UNKNOWN, "Real", self.part, self.span)
            self.work._known[key] = target
            slots = np.column_stack([target, table])
            self.work.groups.append(Group(dag.slot(0), dag.slot(1, order), slots, self.span, self.part, "argument"))
        return self.column(target[number.reshape(-1)])


def _renumbered(shape: Expr, columns: list[int]) -> Expr:
    new = {
        leaf: dag.slot(columns.index(leaf.value[0]), leaf.value[1])
        for leaf in dag.slots(shape)
        if leaf.value[0] in columns
    }
    return dag.substitute(shape, new)


def _jet(name: str, order: int) -> str:
    for _ in range(order):
        name = f"der({name})"
    return name
