"""An executable as one block of bytes, which the engine reads where it runs without Python (``engine/c/bytes.c``)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from lmoc.lower.tape import SolveBlock, Tape

_LARGEST = 63  # bits of an integer without its sign


class Packer:
    """Bytes that are being written.

    Integers are of 7 bits a byte, the lowest first, with the sign in the lowest bit: most take one byte or two. Numbers
    are 8 bytes each, the lowest first.
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def integer(self, value: int) -> None:
        self._parts.append(_packed(np.array([value], np.int64)))

    def integers(self, values: ArrayLike) -> None:
        """Write how many there are, and each."""
        own = np.ravel(np.asarray(values, np.int64))
        self._parts.append(_packed(np.concatenate([[len(own)], own])))

    def reals(self, values: ArrayLike) -> None:
        """Write how many there are, and each."""
        own = np.ravel(np.asarray(values, "<f8"))
        self.integer(len(own))
        self._parts.append(own.tobytes())

    def each(self, values: Iterable[int]) -> None:
        """Write integers whose number is known."""
        self._parts.append(_packed(np.fromiter(values, np.int64)))

    def tape(self, tape: Tape, patient: bool) -> None:
        """Write a tape; `patient` as of `engine.kernel.Kernel`."""
        self.each((tape.size, tape.time))
        self.integers(tape.constants[0])
        self.reals(tape.constants[1])
        self.integers(tape.code)
        self.integers(tape.index)
        self.integer(len(tape.blocks))
        for block in tape.blocks:
            self._block(block, patient)

    def _block(self, block: SolveBlock, patient: bool) -> None:
        instances, size = block.unknowns.shape
        shape = instances, size, block.fill.shape[1], block.right.shape[1]
        sparse = block.pattern is not None
        self.each((*shape, block.a, block.b, block.work, block.x, patient, block.kept, sparse))
        for table in (*block.tables, *(block.pattern or ())):
            self.integers(table)

    def finish(self) -> bytes:
        return b"".join(self._parts)


def _packed(values: np.ndarray) -> bytes:
    """Return integers in groups of 7 bits, all but the last of each with the highest bit set."""
    left = ((values << 1) ^ (values >> _LARGEST)).view(np.uint64)
    columns = []
    more = np.ones(len(left), bool)
    while more.any():
        low, rest = left & np.uint64(127), left >> np.uint64(7)
        columns.append((low | np.where(rest > 0, 128, 0).astype(np.uint64), more))
        left, more = rest, more & (rest > 0)
    if not columns:
        return b""
    digits = np.stack([digit for digit, _ in columns], axis=1).astype(np.uint8)
    there = np.stack([shown for _, shown in columns], axis=1)
    found: bytes = digits[there].tobytes()
    return found
