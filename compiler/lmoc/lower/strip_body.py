"""The instructions of a strip's items (`lower.strips`), and the buffers that their values share."""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.lower.operations import NUMBER
from lmoc.lower.strip_items import Item, Places, Value


class Body:
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
