"""Writes tapes: single operations, each value once, and loops over rows."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np

from lmoc.lower.joined import joined
from lmoc.lower.operations import NUMBER
from lmoc.lower.tape import SolveBlock, Tape

_MANY = 256  # registers written at once after which nothing is taken for known
_Known = dict[tuple[int, ...], tuple[int, int]]
_JUMPS = (NUMBER["correct"], NUMBER["ready"])


class Writer:
    """A tape that is being written.

    What stands at a place has a number of its own, so that a value that has been computed is found again as long as
    it stands somewhere.

    Parameters
    ----------
    taken : places that other tapes have over the same registers
    """

    def __init__(self, registers: int, taken: int = 0) -> None:
        self.registers, self.size = registers, max(registers, taken)
        self.own = self.size  # the first place that nobody else knows of
        self.code: list[tuple[int, ...] | None] = []
        self.blocks: list[SolveBlock] = []
        self._constants: dict[bytes, int] = {}
        self._number: dict[int, float] = {}
        self.tables: list[np.ndarray] = []
        self._indexed = 0
        self._content: dict[int, int] = {}  # number of what stands at a place, where it has been overwritten
        self._known: _Known = {}
        self._fresh = 0
        self._read: set[int] = set()  # places read by more than single operations
        self._buffers: list[int] = []
        self.time = self.reserve(1)
        self.zero, self.one = self.constant(0.0), self.constant(1.0)

    # ------------------------------------------------------------------ places

    def reserve(self, count: int) -> int:
        """Return the first of so many places of their own."""
        self.size += count
        return self.size - count

    def constant(self, value: float) -> int:
        """Return the place of a number."""
        key = struct.pack("d", value)  # which tells zeros apart, and finds what is no number
        if key not in self._constants:
            self._constants[key] = place = self.reserve(1)
            self._number[place] = value
        return self._constants[key]

    def number(self, place: int) -> float | None:
        """Return the constant that stands at a place; None where none does."""
        return self._number.get(place)

    def buffer(self, slot: int) -> int:
        """Return the place of one of the buffers that loops share."""
        while len(self._buffers) <= slot:
            self._buffers.append(self.reserve(264))  # a chunk and a cache line, so that they do not all meet in one set
        return self._buffers[slot]

    def table(self, places: np.ndarray) -> int:
        """Return where a table begins."""
        table = np.ascontiguousarray(places, np.int32).ravel()
        self.tables.append(table)
        self._indexed += len(table)
        return self._indexed - len(table)

    # ------------------------------------------------------------------ operations

    def value(self, op: str, *args: int, out: int = -1) -> int:
        """Return the place of a value; where `out` is given, it stands there afterwards."""
        content = self._content
        key = (NUMBER[op], *[content.get(a, a) for a in args])
        known = self._known.get(key)
        if known is not None and content.get(known[0], known[0]) == known[1]:
            if out < 0 or out == known[0]:
                return known[0]
            self.move(out, known[0])
            return out
        if out < 0:
            out = number = self.reserve(1)
        else:
            number = self._overwrite(out)
        self.code.append((key[0], out, *args))
        self._known[key] = out, number
        return out

    def move(self, out: int, place: int) -> None:
        """Copy a number."""
        if out != place:
            self.code.append((NUMBER["move"], out, place))
            self._content[out] = self._content.get(place, place)

    def dot(self, pairs: Sequence[tuple[int, int]]) -> int:
        """Return the place of a sum of products."""
        if len(pairs) == 1:
            return self.product(*pairs[0])
        out = self.reserve(1)
        self.code.append((NUMBER["dot"], out, len(pairs), *[p for pair in pairs for p in pair]))
        return out

    def product(self, a: int, b: int) -> int:
        """Return the place of a product; that of a factor where the other one is 1."""
        if a == self.one:
            return b
        if b == self.one:
            return a
        x, y = self.number(a), self.number(b)
        return self.constant(x * y) if x is not None and y is not None else self.value("mul", a, b)

    def products(
        self, out: np.ndarray, start: np.ndarray | None, factor: np.ndarray | None, source: np.ndarray
    ) -> None:
        """Write sums of products, or products where there are no segments; arrays of places."""
        tables = [-1 if t is None else self.table(t) for t in (out, start, factor, source)]
        self._written_by_table(out)
        self.code.append((NUMBER["products"], len(out), *tables))

    def fill(self, out: np.ndarray, place: int) -> None:
        """Copy one number to many places."""
        self._written_by_table(out)
        self._read.add(place)
        self.code.append((NUMBER["fill"], len(out), self.table(out), place))

    def rows(self, count: int, body: list[int], read: Iterable[int], out: Iterable[np.ndarray]) -> None:
        """Write a loop over rows.

        Parameters
        ----------
        read : places of single numbers that it reads, or where what it reads begins
        out : registers that it fills
        """
        self._read.update(read)
        for places in out:
            self._written_by_table(places)
        self.code.append((NUMBER["rows"], count, 3 + len(body), *body))

    def _overwrite(self, place: int) -> int:
        self._fresh -= 1
        self._content[place] = self._fresh
        return self._fresh

    def _written_by_table(self, places: np.ndarray) -> None:
        if not len(places) or places.min() >= self.registers:
            return  # scratch is written once
        if len(places) > _MANY:
            self._known.clear()
            self._content.clear()
        else:
            for place in places.tolist():
                self._overwrite(place)

    # ------------------------------------------------------------------ blocks

    def block(self, block: SolveBlock) -> int:
        """Return its number."""
        self.blocks.append(block)
        return len(self.blocks) - 1

    def on_block(self, op: str, number: int) -> None:
        """Write what is done to a block; its unknowns are new afterwards."""
        self.code.append((NUMBER[op], number))
        if op in ("linear", "constant"):
            self.overwritten(self.blocks[number].unknowns)

    def overwritten(self, places: np.ndarray) -> None:
        """Forget what stood at some places."""
        self._written_by_table(np.ravel(places))

    def begin_newton(self, changing: np.ndarray) -> int:
        """Begin an iteration that fills some registers anew; returns where to come back to."""
        self.code.append(None)  # the block is not yet known
        self.overwritten(changing)
        return len(self.code)

    def end_newton(self, begin: int, number: int) -> None:
        """Write the correction at the end of an iteration."""
        self.code[begin - 1] = (NUMBER["newton"], number)
        self.code.append((NUMBER["correct"], number, begin))
        self.overwritten(self.blocks[number].unknowns)

    def begin_unless_ready(self) -> tuple[int, _Known]:
        """Begin what is done only where a block is not ready; values computed there are not known afterwards."""
        self.code.append(None)
        return len(self.code), dict(self._known)

    def end_unless_ready(self, begun: tuple[int, _Known], number: int) -> None:
        """End it."""
        at, self._known = begun
        self.code[at - 1] = (NUMBER["ready"], number, len(self.code))

    # ------------------------------------------------------------------ the tape

    def finish(self, results: np.ndarray | None = None) -> Tape:
        """Return the tape.

        Parameters
        ----------
        results : places that are read behind its end
        """
        results = np.zeros(0, np.int64) if results is None else np.asarray(results, np.int64)
        self._drop(results)
        self.code = joined(self, results)
        index = np.concatenate([np.zeros(0, np.int32), *self.tables])
        self.code.append((NUMBER["end"],))
        starts = np.cumsum([0, *[0 if c is None else len(c) for c in self.code]]).tolist()
        flat: list[int] = []
        for c in self.code:
            if c is not None:
                flat += (*c[:2], starts[c[2]]) if c[0] in _JUMPS else c
        places, values = np.array(list(self._number), np.int64), np.array(list(self._number.values()))
        code = np.array(flat, np.int32)
        return Tape(
            self.registers, self.size, (places, values), self.time, code, index, tuple(self.blocks), results
        )  # fmt: skip

    def _drop(self, results: np.ndarray) -> None:
        """Drop single operations whose result nobody reads."""
        used = np.zeros(self.size + 1, bool)
        used[: self.registers] = True
        for table in self.tables:  # of segments too: what is kept too much is harmless
            used[table[(table >= 0) & (table < self.size)]] = True
        used[results] = True
        used[list(self._read)] = True
        for block in self.blocks:
            for table in block.tables:
                used[table.ravel()] = True
        needed = bytearray(used)  # as quick as a list, an eighth of its size
        dot = NUMBER["dot"]  # up to it, operations have one result
        for k in range(len(self.code) - 1, -1, -1):
            own = self.code[k]
            if own is None or not 0 < own[0] <= dot:
                continue
            if not needed[own[1]]:
                self.code[k] = None
                continue
            for place in own[3:] if own[0] == dot else own[2:]:
                needed[place] = 1
