"""What is done to some copies before the next ones are begun, as the body of one loop (`lower.joined`).

It is written as items on values, each of which has a number for every copy and is computed once. What nobody needs is
left out. A value stands in its own register where that is possible, else in a buffer, which is free for others after
its last use.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import frexp
from typing import Protocol

import numpy as np

from lmoc.lower.operations import NUMBER
from lmoc.lower.tape import SolveBlock
from lmoc.support.records import dataclass

Code = tuple[int, ...]
_SMALL = 2.0**-1000  # and its inverse are far from what has fewer digits
_NEVER = np.iinfo(np.int64).max


@dataclass(frozen=True, eq=False)
class Column:
    """Places of all copies, which follow each other with a stride, or stand in a table from `table` on."""

    places: np.ndarray
    first: int
    stride: int | None
    key: bytes

    @property
    def contiguous(self) -> bool:
        return self.stride == 1


Single = int  # a place that holds one number for all copies
Operand = Column | Single | str  # or the name of a buffer


@dataclass(frozen=True, eq=False)
class Step:
    """What an instruction does: `load` a column to a buffer, `store` an operand to a column, or an operation."""

    op: str
    out: Operand
    args: tuple[Operand, ...] = ()


@dataclass(frozen=True, eq=False)
class BlockOfCopies:
    """A block with an instance for each copy; matrices are row by row."""

    number: int
    block: SolveBlock
    entries: tuple[Column | Single, ...]
    residuals: tuple[Column | Single, ...]
    unknowns: tuple[Column, ...]


class Places(Protocol):
    """What is asked of the tape (`lower.writer.Writer`)."""

    zero: int
    one: int

    def reserve(self, count: int) -> int:
        """Return the first of so many places of their own."""

    def constant(self, value: float) -> int:
        """Return the place of a number."""

    def number(self, place: int) -> float | None:
        """Return the constant that stands at a place; None where none does."""

    def buffer(self, slot: int) -> int:
        """Return the place of a buffer."""

    def table(self, places: np.ndarray) -> int:
        """Return where a table begins."""


class Item:
    """A value of all copies, or what is done without one.

    Attributes
    ----------
    within : the iteration of which it is part
    until : where it is used last, among all items; -1 before that is known
    next : where something else is written to its column
    """

    __slots__ = ("args", "at", "block", "column", "loop", "next", "op", "outs", "place", "until", "used", "within")

    def __init__(
        self,
        op: str,
        args: Sequence[Value] = (),
        column: Column | None = None,
        block: BlockOfCopies | None = None,
        loop: Item | None = None,
    ) -> None:
        self.op, self.args, self.column, self.block, self.loop = op, tuple(args), column, block, loop
        self.outs: list[Item] = []
        self.within: Item | None = None
        self.used = False
        self.at, self.until, self.next = -1, -1, _NEVER
        self.place: tuple[int, int] | None = None


Value = Item | Single


class Memory:
    """What is known of places, shared by the strips of a tape.

    Attributes
    ----------
    written : when each place was written last, on a clock of all strips
    """

    def __init__(self, size: int) -> None:
        self.written = np.zeros(size, np.int64)
        self.over = np.zeros(size, bool)
        self.soon = np.full(size, _NEVER)
        self.clock = 0

    def write(self, places: np.ndarray) -> int:
        self.clock += 1
        self.written[places] = self.clock
        return self.clock


class Strip:
    """The items of one loop.

    Attributes
    ----------
    before : single operations that it needs, to be done before it
    """

    def __init__(self, writer: Places, memory: Memory) -> None:
        self.writer, self.memory = writer, memory
        self.before: list[Code] = []
        self.items: list[Item] = []
        self._known: dict[bytes, tuple[Value, int]] = {}  # what stands in a column, and since when
        self._values: dict[tuple[object, ...], Value] = {}
        self._buffers: dict[str, Value] = {}
        self._loop: Item | None = None
        self._entry = 0  # where what does not change in the loop can be put
        self._opened = 0

    # ------------------------------------------------------------------ values

    def step(self, step: Step) -> None:
        """Write an explicit step."""
        if step.op == "load":
            assert isinstance(step.out, str)
            self._buffers[step.out] = self._value(step.args[0])
        elif step.op == "store":
            assert isinstance(step.out, Column)
            self._store(self._value(step.args[0]), step.out)
        else:
            found = self._operation(step.op, [self._value(a) for a in step.args])
            if isinstance(step.out, str):
                self._buffers[step.out] = found
            else:
                assert isinstance(step.out, Column)
                self._store(found, step.out)

    def linear(self, block: BlockOfCopies) -> None:
        """Solve a linear block."""
        item = Item("linear", [self._value(c) for c in (*block.entries, *block.residuals)], block=block)
        item.outs = [Item("out", (item,)) for _ in block.unknowns]
        self.items.append(item)
        for out, column in zip(item.outs, block.unknowns, strict=True):
            self._store(out, column)

    def begin_newton(self, block: BlockOfCopies, changing: np.ndarray) -> None:
        """Begin an iteration, which fills some places anew."""
        self._opened = self.memory.clock + 1
        for places in (*(c.places for c in block.unknowns), changing):
            self.memory.write(places)
        self._loop = Item("newton", block=block)
        self._entry = len(self.items)
        self.items.append(self._loop)

    def end_newton(self, block: BlockOfCopies) -> None:
        """Write the correction at the end of an iteration."""
        args = [self._value(c) for c in (*block.entries, *block.residuals)]
        self.items.append(Item("correct", args, block=block, loop=self._loop))
        for column in block.unknowns:
            self.memory.write(column.places)
        self._loop = None

    def _value(self, operand: Operand) -> Value:
        if isinstance(operand, str):
            return self._buffers[operand]
        if not isinstance(operand, Column):
            return operand
        newest = int(self.memory.written[operand.places].max())
        found = self._known.get(operand.key)
        if found is not None and newest <= found[1]:
            return found[0]
        item = Item("load", column=operand)
        self._add(item, self._loop is not None and newest < self._opened)
        self._known[operand.key] = item, self.memory.clock
        return item

    def _operation(self, op: str, args: list[Value]) -> Value:
        if op == "move":
            return args[0]
        if op == "div":
            op, args = self._quotient(args)
        if op == "mul" and self.writer.one in args:
            return args[1] if args[0] == self.writer.one else args[0]
        if op in ("add", "sub") and args[1] == self.writer.zero:
            return args[0]
        if op == "add" and args[0] == self.writer.zero:
            return args[1]
        key = (op, *args)
        if key not in self._values:
            singles = [a for a in args if not isinstance(a, Item)]
            self._values[key] = self._single(op, singles) if len(singles) == len(args) else self._new(op, args)
        return self._values[key]

    def _quotient(self, args: list[Value]) -> tuple[str, list[Value]]:
        """Divide by a power of two by a product, which is the same number."""
        divisor = self.writer.number(args[1]) if not isinstance(args[1], Item) else None
        if divisor is None or abs(frexp(divisor)[0]) != 0.5 or not _SMALL < abs(divisor) < 1 / _SMALL:
            return "div", args
        return "mul", [args[0], self.writer.constant(1 / divisor)]

    def _single(self, op: str, args: list[Single]) -> Single:
        out = self.writer.reserve(1)
        self.before.append((NUMBER[op], out, *args))
        return out

    def _new(self, op: str, args: list[Value]) -> Item:
        item = Item(op, args)
        self._add(item, self._loop is not None and not any(a.within is self._loop for a in args if isinstance(a, Item)))
        return item

    def _add(self, item: Item, steady: bool) -> None:
        """Put an item behind the others, or before the iteration in which it does not change."""
        if steady:
            self.items.insert(self._entry, item)
            self._entry += 1
        else:
            item.within = self._loop
            self.items.append(item)

    def _store(self, value: Value, column: Column) -> None:
        found = self._known.get(column.key)
        if found is not None and found[0] is value and int(self.memory.written[column.places].max()) <= found[1]:
            return
        self.items.append(Item("store", (value,), column))
        self._known[column.key] = value, self.memory.write(column.places)

    # ------------------------------------------------------------------ what is needed, and where it stands

    def body(self, unread: Sequence[Column]) -> list[int]:
        """Return the instructions.

        Parameters
        ----------
        unread : columns that nobody reads behind it
        """
        self._leave_out(unread)
        self._order()
        self._settle()
        return _Body(self.writer, self.items).code

    def _leave_out(self, unread: Sequence[Column]) -> None:
        """Leave out what is overwritten before it is read, and what only that needs."""
        over, kept = self.memory.over, []
        for column in unread:
            over[column.places] = True
        for k in range(len(self.items) - 1, -1, -1):
            item = self.items[k]
            if item.op == "store":
                assert item.column is not None
                if over[item.column.places].all():
                    continue
                item.used, over[item.column.places] = True, True
            elif item.op in ("newton", "correct"):
                item.used = True
                self._read_by_iteration(k, over)
            item.used |= any(out.used for out in item.outs)
            if item.used:
                kept.append(item)
                for a in item.args:
                    if isinstance(a, Item):
                        a.used = True
                if item.op == "load" and item.column is not None:
                    over[item.column.places] = False
        for item in self.items:
            if item.column is not None:
                over[item.column.places] = False
        for column in unread:
            over[column.places] = False
        self.items = kept[::-1]

    def _read_by_iteration(self, k: int, over: np.ndarray) -> None:
        """Note what an iteration reads: the unknowns, and at its end all that the next one loads."""
        item = self.items[k]
        assert item.block is not None
        for column in item.block.unknowns:
            over[column.places] = False
        while item.loop is not None and self.items[k] is not item.loop:
            k -= 1
            column = self.items[k].column
            if self.items[k].op == "load" and column is not None:
                over[column.places] = False

    def _order(self) -> None:
        """Number the items, and find their last uses: what comes from before an iteration is used until its end."""
        ends = {item.loop: k for k, item in enumerate(self.items) if item.loop is not None}
        begin = end = -1
        for k, item in enumerate(self.items):
            item.at = k
            for out in item.outs:
                out.at = out.until = k
            if item in ends:
                begin, end = k, ends[item]
            for a in item.args:
                if isinstance(a, Item):
                    a.until = max(a.until, end if a.at < begin and k <= end else k)

    def _settle(self) -> None:
        """Decide which values stand in their columns: those that are written nowhere else, and to which nothing else is
        written as long as they are used."""
        soon, own, written = self.memory.soon, self._own_stores(), []
        for item in reversed(self.items):
            columns = item.block.unknowns if item.block is not None and item.op != "linear" else ()
            for column in columns:
                soon[column.places] = item.at
                written.append(column)
            if item.column is None:
                continue
            item.next = int(soon[item.column.places].min())
            if item.op == "store":
                value = item.args[0]
                soon[item.column.places] = value.at if isinstance(value, Item) and own.get(value) is item else item.at
                written.append(item.column)
        for column in written:
            soon[column.places] = _NEVER
        for item in self.items:
            column = item.column
            value = item.args[0] if item.op == "store" else item
            if column is None or not column.contiguous or not isinstance(value, Item):
                continue
            if (item.op == "load" or own.get(value) is item) and item.next >= value.until:
                value.place = column.first, 1

    def _own_stores(self) -> dict[Item, Item]:
        """Return for values the store to a contiguous column that follows them at once."""
        own: dict[Item, Item] = {}
        fresh: set[Item] = set()
        for item in self.items:
            if item.op != "store":
                fresh = {*item.outs} or {item}
                if item.op == "load":
                    fresh = set()
                continue
            value = item.args[0]
            if isinstance(value, Item) and value in fresh and item.column is not None and item.column.contiguous:
                own.setdefault(value, item)
        return own


class _Body:
    """Items as instructions."""

    def __init__(self, writer: Places, items: Sequence[Item]) -> None:
        self.writer = writer
        self.code: list[int] = []
        self._free: list[int] = []
        self._slots = 0
        self._slot: dict[Item, int] = {}
        self._begins: dict[Item, int] = {}
        for item in items:
            self._write(item)
            for a in dict.fromkeys([*item.args, *item.outs, item]):
                if isinstance(a, Item) and a in self._slot and a.until <= item.at:
                    self._free.append(self._slot.pop(a))

    def _write(self, item: Item) -> None:
        if item.op == "load":
            self._load(item)
        elif item.op == "store":
            self._store(item)
        elif item.block is not None:
            self._block(item)
        else:
            self._emit(item.op, self._place(item), *map(self._operand, item.args))

    def _emit(self, op: str, *operands: tuple[int, ...]) -> None:
        self.code += (NUMBER[op], *[x for operand in operands for x in operand])

    def _operand(self, value: Value) -> tuple[int, int]:
        if not isinstance(value, Item):
            return value, -1
        assert value.place is not None
        return value.place

    def _place(self, item: Item) -> tuple[int, int]:
        """Return where a new value is to stand."""
        if item.place is None:
            self._slot[item] = slot = self._take()
            item.place = self.writer.buffer(slot), 0
        return item.place

    def _take(self) -> int:
        if not self._free:
            self._free.append(self._slots)
            self._slots += 1
        return self._free.pop()

    def _load(self, item: Item) -> None:
        column = item.column
        assert column is not None
        if item.place is not None:
            return
        place = self._place(item)
        if column.contiguous:
            self._emit("move", place, (column.first, 1))
        elif column.stride is not None:
            self._emit("strided", place, (column.first, column.stride))
        else:
            self._emit("gather", place, (self.writer.table(column.places),))

    def _store(self, item: Item) -> None:
        column, operand = item.column, self._operand(item.args[0])
        assert column is not None
        if column.contiguous:
            if operand != (column.first, 1):
                self._move((column.first, 1), operand)
            return
        slot = -1
        if operand[1] < 0:
            slot = self._take()
            buffer = self.writer.buffer(slot), 0
            self._move(buffer, operand)
            operand = buffer
        if column.stride is not None:
            self._emit("spread", operand, (column.first, column.stride))
        else:
            self._emit("scatter", operand, (self.writer.table(column.places),))
        if slot >= 0:
            self._free.append(slot)

    def _move(self, out: tuple[int, int], operand: tuple[int, int]) -> None:
        """Copy rows, or one number to all of them, which is what `if` takes."""
        if operand[1] < 0:
            self._emit("if", out, operand, operand, operand)
        else:
            self._emit("move", out, operand)

    def _block(self, item: Item) -> None:
        assert item.block is not None
        pairs = [self._operand(a) for a in item.args] + [self._place(out) for out in item.outs]
        own = [item.block.number]
        if item.op == "newton":
            self._begins[item] = len(self.code) + 6  # behind it, from the number of the loop on
        elif item.op == "correct":
            assert item.loop is not None
            own.append(self._begins[item.loop])
        flat = [x for pair in pairs for x in pair]
        self.code += (NUMBER[item.op], 2 + len(own) + len(flat), *own, *flat)
