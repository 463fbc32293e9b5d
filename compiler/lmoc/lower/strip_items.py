"""What a strip (`lower.strips`) consists of: columns, items on values, blocks; and what is known of their places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from lmoc.lower.tape import SolveBlock
from lmoc.support.records import dataclass

Code = tuple[int, ...]
NEVER = np.iinfo(np.int64).max


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
        self.at, self.until, self.next = -1, -1, NEVER
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
        self.soon = np.full(size, NEVER)
        self.clock = 0

    def write(self, places: np.ndarray) -> int:
        self.clock += 1
        self.written[places] = self.clock
        return self.clock
