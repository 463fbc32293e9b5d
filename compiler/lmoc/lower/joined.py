"""Loops over the same copies become one, in which all is done to some of the copies before the next ones are begun.

A scene of many equal parts is a row of loops, each of which fills some registers of all copies. One after the other,
all of them go through the whole memory, which is in no cache. Loops are joined here if their rows do not read what
other rows write, with the sums and products between them and with the blocks that have an instance for each copy. What
stands between them and has to do with none of them is done before.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from lmoc.lower.operations import NUMBER, OPERATIONS
from lmoc.lower.strip_items import BlockOfCopies, Code, Column, Memory, Operand, Places, Single, Step
from lmoc.lower.strips import Strip
from lmoc.lower.tape import SolveBlock, row_instructions
from lmoc.support.records import dataclass
from lmoc.support.sizes import DENSE_IN_C

_ONE_RESULT = range(1, NUMBER["dot"] + 1)  # operations
_LOOPS = ("rows", "linear", "newton")
_ON_BLOCKS = ("linear", "constant", "correct", "implicit", "factor")


class _Written(Places, Protocol):
    """A tape with what has been written to it."""

    size: int
    own: int
    code: list[Code | None]
    tables: list[np.ndarray]
    blocks: list[SolveBlock]


class _Apart(Exception):
    """An instruction cannot be part of a loop."""


def joined(writer: _Written, results: np.ndarray) -> list[Code | None]:
    """Return the code of a tape with its loops joined; instructions keep their places in the list."""
    counts = [c[1] for c in writer.code if c is not None and OPERATIONS[c[0]] == "rows"]
    if len(counts) == len(set(counts)):
        return list(writer.code)
    return _Joiner(writer, results).code()


@dataclass(frozen=True, eq=False)
class _On:
    """Something on a block within a loop; `changing` are the places that an iteration fills."""

    op: str
    block: BlockOfCopies
    changing: np.ndarray


class _Rows:
    """Which copy has written each place, and which has read it, as long as a loop grows."""

    NOBODY, SEVERAL = -1, -2

    def __init__(self, size: int) -> None:
        self.owner = np.full(size, self.NOBODY, np.int32)
        self.reader = np.full(size, self.NOBODY, np.int32)
        self._log: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.rows = np.zeros(0, np.int32)

    def begin(self, count: int) -> None:
        self.back(0)
        self.rows = np.arange(count, dtype=np.int32)

    def state(self) -> int:
        return len(self._log)

    def back(self, state: int) -> None:
        """Undo what has been noted since then."""
        while len(self._log) > state:
            table, places, before = self._log.pop()
            table[places] = before

    def _set(self, table: np.ndarray, places: np.ndarray, value: np.ndarray | int) -> None:
        self._log.append((table, places, table[places]))
        table[places] = value

    def read(self, where: Column | Single) -> None:
        """Note that each copy reads its place.

        Raises
        ------
        _Apart
            Another copy writes it.
        """
        if not isinstance(where, Column):
            if self.owner[where] != self.NOBODY:
                raise _Apart
            self._set(self.reader, np.array([where]), self.SEVERAL)
            return
        places, rows = where.places, self.rows
        owner, reader = self.owner[places], self.reader[places]
        if not ((owner == self.NOBODY) | (owner == rows)).all():
            raise _Apart
        self._set(self.reader, places, np.where((reader == self.NOBODY) | (reader == rows), rows, self.SEVERAL))
        shared = places[self.reader[places] != rows]
        if len(shared):
            self._set(self.reader, shared, self.SEVERAL)

    def write(self, column: Column) -> None:
        """Note that each copy writes its place.

        Raises
        ------
        _Apart
            Another copy reads or writes it.
        """
        places, rows = column.places, self.rows
        for table in (self.owner, self.reader):
            before = table[places]
            if not ((before == self.NOBODY) | (before == rows)).all():
                raise _Apart
        self._set(self.owner, places, rows)
        if (self.owner[places] != rows).any():
            raise _Apart

    def untouched(self, reads: np.ndarray, writes: np.ndarray) -> bool:
        """Whether an instruction that does this may come before the loop."""
        nobody = self.NOBODY
        return bool(
            (self.owner[reads] == nobody).all()
            and (self.owner[writes] == nobody).all()
            and (self.reader[writes] == nobody).all()
        )


class _Joiner:
    """The code of one tape."""

    def __init__(self, writer: _Written, results: np.ndarray) -> None:
        self.writer = writer
        self.old = list(writer.code)
        self._tables = dict(zip(np.cumsum([0, *map(len, writer.tables)]).tolist(), writer.tables, strict=False))
        self._rows = _Rows(writer.size)
        self._memory = Memory(writer.size)
        self._columns: dict[bytes, Column | Single] = {}
        self._blocks: dict[int, BlockOfCopies] = {}
        self._targets = {c[2] for c in self.old if c is not None and OPERATIONS[c[0]] in ("correct", "ready")}
        every = [self._effects(c)[0] for c in self.old if c is not None]
        self._reads = np.bincount(np.concatenate([*every, results]), minlength=writer.size)

    def code(self) -> list[Code | None]:
        """Return the new code."""
        found: list[Code | None] = list(self.old)
        k = 0
        while k < len(found):
            count = self._count(found[k])
            end = self._loop(found, k, count) if count else k + 1
            k = max(end, k + 1)
        return found

    def _count(self, c: Code | None) -> int:
        """Return over how many copies a loop that begins here would go; 0 for none."""
        if c is None:
            return 0
        if OPERATIONS[c[0]] == "rows":
            return c[1]
        if OPERATIONS[c[0]] in ("newton", "linear") and self._fits(c[1]):
            return len(self.writer.blocks[c[1]].unknowns)
        return 0

    def _fits(self, number: int) -> bool:
        block = self.writer.blocks[number]
        instances, size = block.unknowns.shape
        return block.pattern is None and not block.kept and 1 < instances and size <= DENSE_IN_C

    # ------------------------------------------------------------------ one loop

    def _loop(self, code: list[Code | None], first: int, count: int) -> int:
        """Join what can be from an instruction on, in its place; returns where the next one is."""
        self._rows.begin(count)
        steps: list[Step | _On] = []
        taken: list[int] = []
        before: list[int] = []
        k = first
        while k < len(code):
            if k in self._targets and k > first:
                break
            end = self._take(code, k, count, steps, taken, before)
            if end == k:
                break
            k = end
        if sum(OPERATIONS[(code[j] or (0,))[0]] in _LOOPS for j in taken) > 1:
            self._put(code, first, count, steps, taken, before)
        return k

    def _take(
        self, code: list[Code | None], k: int, count: int, steps: list[Step | _On], taken: list[int], before: list[int]
    ) -> int:
        """Take the instruction k, or the iteration that it begins; returns where the next one is, k if it cannot be."""
        c = code[k]
        if c is None:
            return k + 1
        if OPERATIONS[c[0]] == "newton":
            return self._iteration(code, k, count, steps, taken, before)
        state = self._rows.state()
        try:
            found = list(self._steps(c, count))
            for step in found:
                self._note(step)
        except _Apart:
            self._rows.back(state)
            if OPERATIONS[c[0]] in (*_ON_BLOCKS, "ready", "end") or not self._rows.untouched(*self._effects(c)):
                return k
            before.append(k)
            return k + 1
        steps += found
        taken.append(k)
        return k + 1

    def _iteration(
        self, code: list[Code | None], k: int, count: int, steps: list[Step | _On], taken: list[int], before: list[int]
    ) -> int:
        """Take a whole iteration of Newton's method, or nothing of it."""
        begin, number = k, (code[k] or (0, 0))[1]
        state, n_steps, n_taken, n_before = self._rows.state(), len(steps), len(taken), len(before)
        try:
            block = self._block(number, count)
            place = len(steps)
            steps.append(_On("newton", block, np.zeros(0, np.int64)))
            self._note(steps[-1])
            k += 1
            while (code[k] or (0,))[0] != NUMBER["correct"]:
                own = code[k]
                end = self._take(code, k, count, steps, taken, before)
                if end == k or (own is not None and OPERATIONS[own[0]] == "newton"):
                    raise _Apart
                k = end
            changing = [s.out.places for s in steps[place:] if isinstance(s, Step) and isinstance(s.out, Column)]
            steps[place] = _On("newton", block, np.concatenate([np.zeros(0, np.int64), *changing]))
            steps.append(_On("correct", block, np.zeros(0, np.int64)))
            self._note(steps[-1])
        except _Apart:
            self._rows.back(state)
            del steps[n_steps:], taken[n_taken:], before[n_before:]
            return begin
        taken += (begin, k)
        return k + 1

    def _note(self, step: Step | _On) -> None:
        """Note what copies read and write in a step."""
        if isinstance(step, _On):
            if step.op != "newton":
                for own in (*step.block.entries, *step.block.residuals):
                    self._rows.read(own)
            for column in step.block.unknowns:
                self._rows.write(column)
            return
        for a in step.args:
            if not isinstance(a, str):
                self._rows.read(a)
        if isinstance(step.out, Column):
            self._rows.write(step.out)

    def _put(
        self,
        code: list[Code | None],
        first: int,
        count: int,
        steps: list[Step | _On],
        taken: list[int],
        before: list[int],
    ) -> None:
        """Put a loop in the place of what it has taken, behind what comes before."""
        for k in taken:
            np.subtract.at(self._reads, self._effects(code[k] or ())[0], 1)
        strip = Strip(self.writer, self._memory)
        for step in steps:
            if isinstance(step, Step):
                strip.step(step)
            elif step.op == "newton":
                strip.begin_newton(step.block, step.changing)
            elif step.op == "correct":
                strip.end_newton(step.block)
            else:
                strip.linear(step.block)
        stored = {i.column.key: i.column for i in strip.items if i.op == "store" and i.column is not None}
        unread = [c for c in stored.values() if c.places.min() >= self.writer.own and not self._reads[c.places].any()]
        body = strip.body(unread)
        ahead = [code[k] or () for k in before]
        for k in (*taken, *before):
            code[k] = None
        pieces = [*ahead, *strip.before, (NUMBER["rows"], count, 3 + len(body), *body)]
        code[first] = tuple(x for piece in pieces for x in piece)

    # ------------------------------------------------------------------ instructions as steps

    def _where(self, places: np.ndarray) -> Column | Single:
        places = np.ascontiguousarray(places, np.int64)
        key = places.tobytes()
        if key not in self._columns:
            strides = np.diff(places)
            stride = int(strides[0]) if (strides == strides[0]).all() else None
            found = int(places[0]) if stride == 0 else Column(places, int(places[0]), stride, key)
            self._columns[key] = found
        return self._columns[key]

    def _column(self, places: np.ndarray) -> Column:
        found = self._where(places)
        if not isinstance(found, Column):
            raise _Apart
        return found

    def _block(self, number: int, count: int) -> BlockOfCopies:
        block = self.writer.blocks[number]
        if not self._fits(number) or len(block.unknowns) != count:
            raise _Apart
        if number not in self._blocks:
            entries, residuals = (tuple(map(self._where, t.T)) for t in (block.fill, block.residuals))
            unknowns = tuple(map(self._column, block.unknowns.T))
            self._blocks[number] = BlockOfCopies(number, block, entries, residuals, unknowns)
        return self._blocks[number]

    def _steps(self, c: Code, count: int) -> Iterator[Step | _On]:
        """Yield what an instruction does to copies.

        Raises
        ------
        _Apart
            It is not the same for each of them.
        """
        name = OPERATIONS[c[0]]
        if name == "rows" and c[1] == count:
            yield from self._of_rows(c)
        elif name == "products":
            yield from self._of_products(c, count)
        elif name == "fill" and c[1] % count == 0:
            for places in self._tables[c[2]].reshape(count, -1).T:
                yield Step("store", self._column(places), (c[3],))
        elif name == "linear":
            yield _On("linear", self._block(c[1], count), np.zeros(0, np.int64))
        else:
            raise _Apart

    def _of_rows(self, c: Code) -> Iterator[Step]:
        count = c[1]

        def operand(place: int, flag: int) -> Operand:
            return f"b{place}" if flag == 0 else place if flag < 0 else self._where(place + np.arange(count))

        for name, rest in row_instructions(list(c[1:])):
            out = operand(*rest[:2])
            if name == "gather":
                yield Step("load", out, (self._where(self._tables[rest[2]][:count]),))
            elif name == "strided":
                yield Step("load", out, (self._where(rest[2] + rest[3] * np.arange(count)),))
            elif name == "scatter":
                yield Step("store", self._column(self._tables[rest[2]]), (out,))
            elif name == "spread":
                yield Step("store", self._column(rest[2] + rest[3] * np.arange(count)), (out,))
            elif name in ("linear", "newton", "correct"):
                raise _Apart  # joined already
            else:
                yield Step(name, out, tuple(operand(*rest[k : k + 2]) for k in range(2, len(rest), 2)))

    def _of_products(self, c: Code, count: int) -> Iterator[Step]:
        """Sums of products that have the same terms for each copy."""
        n, out, start, factor, source = c[1:]
        if n % count:
            raise _Apart
        each = n // count
        lengths = np.ones(n, int) if start < 0 else np.diff(self._tables[start])
        pattern = lengths.reshape(count, each)
        if (pattern != pattern[0]).any() or not pattern[0].all():
            raise _Apart
        terms = int(pattern[0].sum())
        outs, sources = (self._tables[t].reshape(count, -1).T for t in (out, source))
        factors = None if factor < 0 else self._tables[factor].reshape(count, -1).T
        assert len(sources) == terms
        term = 0
        for own, length in zip(outs, pattern[0].tolist(), strict=True):
            total = ""
            for j in range(term, term + length):
                yield from self._term(f"p{j}", sources[j], None if factors is None else factors[j])
                if total:
                    yield Step("add", f"s{j}", (total, f"p{j}"))
                total = f"s{j}" if total else f"p{j}"
            term += length
            yield Step("store", self._column(own), (total,))

    def _term(self, name: str, source: np.ndarray, factor: np.ndarray | None) -> Iterator[Step]:
        if factor is None:
            yield Step("load", name, (self._where(source),))
        else:
            yield Step("mul", name, (self._where(factor), self._where(source)))

    # ------------------------------------------------------------------ what instructions read and write

    def _effects(self, c: Code) -> tuple[np.ndarray, np.ndarray]:
        """Return the places that an instruction reads and writes."""
        name = OPERATIONS[c[0]]
        if c[0] in _ONE_RESULT:
            return np.array(c[3:] if name == "dot" else c[2:]), np.array(c[1:2])
        if name == "rows":
            steps = list(self._of_rows(c))
            reads = [a for s in steps for a in s.args]
            return _places(reads), _places([s.out for s in steps])
        if name == "products":
            n, out, start, factor, source = c[1:]
            tables = [self._tables[t] for t in (source, factor) if t >= 0]
            return np.concatenate(tables).astype(np.int64), self._tables[out].astype(np.int64)
        if name == "fill":
            return np.array([c[3]]), self._tables[c[2]].astype(np.int64)
        if name in _ON_BLOCKS:
            block = self.writer.blocks[c[1]]
            own = [block.fill, block.residuals, block.right, block.unknowns]
            return np.concatenate([t.ravel() for t in own]).astype(np.int64), block.unknowns.ravel().astype(np.int64)
        return np.zeros(0, np.int64), np.zeros(0, np.int64)


def _places(operands: list[Operand]) -> np.ndarray:
    own = [o.places if isinstance(o, Column) else np.array([o]) for o in operands if not isinstance(o, str)]
    return np.concatenate([np.zeros(0, np.int64), *own])
