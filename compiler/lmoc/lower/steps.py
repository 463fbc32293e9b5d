"""Explicit steps on a tape: few rows as single operations, many as a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.ir.program import Apply, Total
from lmoc.lower.operations import NUMBER
from lmoc.lower.writer import Writer

FEW = 8  # rows up to which single operations cost less than a loop
_TERMS = 16  # of a sum, written as single operations

Operand = tuple[int, int]  # place and flag (`lower.tape`): -1 for a single number, 0 for a buffer, 1 for rows


def write_step(writer: Writer, step: Apply | Total) -> None:
    """Write an explicit step."""
    if isinstance(step, Total):
        write_total(writer, step)
    elif len(step.out) <= FEW:
        write_single(writer, step, [step.shape], True)
    elif len(step.out):
        write_rows(writer, step, [step.shape], True)


def write_shapes(writer: Writer, step: Apply, shapes: Sequence[Expr], values: bool) -> list[np.ndarray]:
    """Write several shapes on the rows of a step; the places (rows,) of each.

    Parameters
    ----------
    values : the first of them fills the registers of the step
    """
    return (write_single if len(step.out) <= FEW else write_rows)(writer, step, shapes, values)


def write_single(writer: Writer, step: Apply, shapes: Sequence[Expr], values: bool) -> list[np.ndarray]:
    """`write_shapes` row by row."""
    found = np.empty((len(shapes), len(step.out)), np.int64)
    for i, (row, out) in enumerate(zip(step.slots.tolist(), step.out.tolist(), strict=True)):
        place: dict[Expr, int] = {}
        for k, shape in enumerate(shapes):
            found[k, i] = _single(writer, shape, row, place, out if values and k == 0 else -1)
    return list(found)


def _single(writer: Writer, shape: Expr, row: list[int], place: dict[Expr, int], out: int) -> int:
    """Write one shape of one row; `place` has the nodes that are there already."""
    for node in postorder(shape):
        if node not in place:
            place[node] = single_node(writer, node, row, place, out if node is shape else -1)
    found = place[shape]
    if out >= 0 and found != out:
        writer.move(out, found)
    return found


def single_node(writer: Writer, node: Expr, row: list[int], place: dict[Expr, int], out: int = -1) -> int:
    """Write one node of one row, whose arguments are there already; its place."""
    op = node.op
    if op == "slot":
        return row[int(node.value[0])]
    if op == "const":
        return writer.constant(node.value)
    if op == "time":
        return writer.time
    if op in ("event", "given"):
        return place[node.args[0]]
    power = _small_power(node)
    if power:
        base = place[node.args[0]]
        square = writer.value("mul", base, base, out=out if power == 2 else -1)
        return square if power == 2 else writer.value("mul", square, base, out=out)
    return writer.value(op, *[place[a] for a in node.args], out=out)


def _small_power(node: Expr) -> int:
    """Return 2 or 3 for squares and cubes, else 0: the library's pow costs twenty times as much."""
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].value in (2.0, 3.0):
        return int(node.args[1].value)
    return 0


def write_total(writer: Writer, step: Total) -> None:
    """Write sums."""
    if len(step.out) > FEW or len(step.index) > _TERMS * len(step.out):
        if len(step.out):
            ones = (step.coefficient == 1.0).all()
            factor = None if ones else coefficients(writer, step)
            writer.products(step.out, step.start, factor, step.index)
        return
    start, index, coefficient = step.start.tolist(), step.index.tolist(), step.coefficient.tolist()
    for k, out in enumerate(step.out.tolist()):
        terms = list(zip(coefficient[start[k] : start[k + 1]], index[start[k] : start[k + 1]], strict=True))
        _write_sum(writer, terms, out)


def _write_sum(writer: Writer, terms: list[tuple[float, int]], out: int) -> None:
    total = -1
    for j, (c, place) in enumerate(terms):
        own = out if j == len(terms) - 1 else -1
        if total < 0:
            total = place if c == 1.0 else writer.value("neg", place, out=own) if c == -1.0 else -1
            if total < 0:
                total = writer.value("mul", writer.constant(c), place, out=own)
        elif c in (1.0, -1.0):
            total = writer.value("add" if c > 0 else "sub", total, place, out=own)
        else:
            total = writer.value("add", total, writer.value("mul", writer.constant(c), place), out=own)
    if total != out:
        writer.move(out, writer.zero if total < 0 else total)


def coefficients(writer: Writer, step: Total) -> np.ndarray:
    """Return the places of the coefficients."""
    values, which = np.unique(step.coefficient, return_inverse=True)
    return np.array([writer.constant(v) for v in values.tolist()], np.int64)[which.ravel()]


def write_rows(writer: Writer, step: Apply, shapes: Sequence[Expr], values: bool) -> list[np.ndarray]:
    """`write_shapes` as a loop over the rows."""
    return _Loop(writer, step, shapes).write(values)


class _Loop:
    """The instructions of one loop over rows.

    A node is a single number for all rows, which is computed before the loop; or it stands in a buffer, which is free
    for others after the last use of the node.
    """

    def __init__(self, writer: Writer, step: Apply, shapes: Sequence[Expr]) -> None:
        self.writer, self.step, self.shapes = writer, step, shapes
        self.count = len(step.out)
        self.body: list[int] = []
        self.operand: dict[int, Operand] = {}
        self.slot: dict[int, int] = {}  # of a node in a buffer
        self.free: list[int] = []
        self.slots = 0
        self.single: set[int] = set()  # places that the loop reads
        self.uses: dict[int, int] = {}
        nodes = {id(n): n for shape in shapes for n in postorder(shape)}
        for node in nodes.values():
            for a in node.args[:1] if _small_power(node) else node.args:
                self.uses[id(a)] = self.uses.get(id(a), 0) + 1
        for shape in shapes:
            self.uses[id(shape)] = self.uses.get(id(shape), 0) + 1

    def write(self, values: bool) -> list[np.ndarray]:
        found = []
        for k, shape in enumerate(self.shapes):
            out = self.step.out if values and k == 0 else None
            for node in postorder(shape):
                if id(node) not in self.operand:
                    self.operand[id(node)] = self._node(node, node is shape, out)
            found.append(self._result(shape, out))
        if self.body:
            self.writer.rows(self.count, self.body, self.single, [self.step.out] if values else [])
        place, flag = self.operand[id(self.shapes[0])]
        if values and flag < 0:
            self.writer.fill(self.step.out, place)
        return found

    def _node(self, node: Expr, root: bool, out: np.ndarray | None) -> Operand:
        if node.op == "slot":
            return self._column(node)
        if node.op == "const":
            return self.writer.constant(node.value), -1
        if node.op == "time":
            return self.writer.time, -1
        args = [self.operand[id(a)] for a in node.args]
        if node.op in ("event", "given"):
            return args[0]
        power = _small_power(node)
        if all(flag < 0 for _, flag in args[: 1 if power else None]):
            return _single_node(self.writer, node, [place for place, _ in args], power), -1
        return self._vector(node, args, power, self._target(node, out) if root else self._take(node))

    def _vector(self, node: Expr, args: list[Operand], power: int, place: Operand) -> Operand:
        """Write an operation on rows."""
        if power:
            self._emit("mul", place, args[0], args[0])
            if power == 3:
                self._emit("mul", place, place, args[0])
        else:
            self._emit(node.op, place, *args)
        self._done(node.args[:1] if power else node.args)
        return place

    def _emit(self, op: str, *operands: Operand) -> None:
        self.single.update(place for place, flag in operands if flag < 0)
        self.body += (NUMBER[op], *[x for operand in operands for x in operand])

    def _target(self, node: Expr, out: np.ndarray | None) -> Operand:
        """Return where a result is to stand: in places of its own, or in its registers where they follow each other."""
        if out is None:
            return self.writer.reserve(self.count), 1
        if (np.diff(out) == 1).all():
            return int(out[0]), 1
        return self._take(node)

    def _take(self, node: Expr) -> Operand:
        if not self.free:
            self.free.append(self.slots)
            self.slots += 1
        self.slot[id(node)] = slot = self.free.pop()
        return self.writer.buffer(slot), 0

    def _done(self, nodes: Sequence[Expr]) -> None:
        """Give back the buffers of nodes that have been used for the last time."""
        for node in nodes:
            self.uses[id(node)] -= 1
            if not self.uses[id(node)] and id(node) in self.slot:
                self.free.append(self.slot.pop(id(node)))

    def _column(self, node: Expr) -> Operand:
        registers = self.step.slots[:, node.value[0]]
        first, strides = int(registers[0]), np.diff(registers)
        if (strides == strides[0]).all():
            stride = int(strides[0])
            if stride in (0, 1):
                self.single.add(first)
                return first, stride or -1
            place = self._take(node)
            self.body += (NUMBER["strided"], *place, first, stride)
            return place
        place = self._take(node)
        self.body += (NUMBER["gather"], *place, self.writer.table(registers))
        return place

    def _result(self, shape: Expr, out: np.ndarray | None) -> np.ndarray:
        """Put a result to its registers, or to places of its own; returns these."""
        place, flag = operand = self.operand[id(shape)]
        if out is None and shape.op == "slot":
            return self.step.slots[:, shape.value[0]]
        if flag < 0:
            return np.full(self.count, place) if out is None else out
        if out is None and flag > 0:
            return place + np.arange(self.count)
        if out is None:
            first = self.writer.reserve(self.count)
            self._emit("move", (first, 1), operand)
            self._done([shape])
            return first + np.arange(self.count)
        strides = np.diff(out)
        if (strides == 1).all():
            if operand != (int(out[0]), 1):
                self._emit("move", (int(out[0]), 1), operand)
        elif (strides == strides[0]).all():
            self.body += (NUMBER["spread"], *operand, int(out[0]), int(strides[0]))
        else:
            self.body += (NUMBER["scatter"], *operand, self.writer.table(out))
        self._done([shape])
        return out


def _single_node(writer: Writer, node: Expr, args: list[int], power: int) -> int:
    """Write an operation whose arguments are the same for all rows."""
    if power:
        square = writer.value("mul", args[0], args[0])
        return square if power == 2 else writer.value("mul", square, args[0])
    return writer.value(node.op, *args)
