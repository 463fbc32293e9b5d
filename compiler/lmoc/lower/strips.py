"""What is done to some copies before the next ones are begun, as the body of one loop (`lower.joined`).

It is written as items on values, each of which has a number for every copy and is computed once. What nobody needs is
left out. A value stands in its own register where that is possible, else in a buffer, which is free for others after
its last use.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import frexp

import numpy as np

from lmoc.lower.operations import NUMBER
from lmoc.lower.strip_body import Body
from lmoc.lower.strip_items import (
    NEVER,
    BlockOfCopies,
    Code,
    Column,
    Item,
    Memory,
    Operand,
    Places,
    Single,
    Step,
    Value,
)

_SMALL = 2.0**-1000  # and its inverse are far from what has fewer digits


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
        return Body(self.writer, self.items).code

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
            read = self.items[k].column
            if self.items[k].op == "load" and read is not None:
                over[read.places] = False

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
            soon[column.places] = NEVER
        for item in self.items:
            place = item.column
            value = item.args[0] if item.op == "store" else item
            if place is None or not place.contiguous or not isinstance(value, Item):
                continue
            if (item.op == "load" or own.get(value) is item) and item.next >= value.until:
                value.place = place.first, 1

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
