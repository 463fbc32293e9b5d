"""A program as a tape: instructions over one vector of doubles.

Registers, constants, time and scratch have their places in that vector. The engine interprets the instructions
(``engine/c/tape.c``), or a C compiler does what they say, operation by operation in the same order, with the same
bits. An instruction is a few int32: the number of its operation and places, or where a table of places begins:

============================= ========================================================================================
op out a [b]                  ``w[out] = op(w[a], w[b])``
if out c a b                  ``w[out] = w[a] if w[c] else w[b]``
dot out n (a b)…              ``w[out] = Σ w[a]·w[b]``
rows n length …               the instructions within, on n rows, in pieces that stay in the cache
products n out start f source ``w[out[k]] = Σ_j w[f[j]]·w[source[j]]`` over ``start[k] … start[k+1]-1``; tables. Without
                              segments (-1) there is one j for each k, without factors (-1) it is a sum
fill n out a                  ``w[out[k]] = w[a]``, a table
linear, constant k            the unknowns of block k; `constant`: its matrix depends on parameters only
ready k to                    go on there if the matrix of this block has been factorized
newton k … correct k back     what stands between them until all instances are solved
implicit k                    the derivatives of the unknowns
factor k                      the factors of all matrices, for `lower.series`
============================= ========================================================================================

Within `rows`, an operand is a place and a flag: 1 where it goes on from row to row, 0 for a buffer, -1 for one number.
`gather` and `strided` fill a buffer; `scatter` and `spread` empty one. Blocks of which each row has an instance may be
within, too, with the length of the instruction behind its number: ``linear length k`` and then the entries of the
matrix row by row, the residuals and the unknowns; ``newton length k``; ``correct length k back``, which goes back to
`back` from the number of `rows`, with entries and residuals.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.ir.program import Solve
from lmoc.lower.operations import LENGTH, LENGTH_OF_ROWS, OPERATIONS
from lmoc.support.records import dataclass

CHUNK = 256  # rows worked on at once (``LMOC_CHUNK``)


@dataclass(frozen=True, eq=False)
class SolveBlock:
    """Implicit equations, as instructions refer to them. Tables hold places.

    Attributes
    ----------
    step : Solve
    unknowns, residuals : (instances, size)
    fill : (instances, each) entries of the matrices
    right : (instances, width, size) right sides of derivatives
    pattern : (indptr, rows) of a sparse matrix by columns; None where it is dense, row by row
    a, b, work, x : scratch for matrices, one right side, what Newton's method keeps, solutions
    kept : the factors stay until parameters change
    """

    step: Solve
    unknowns: np.ndarray
    residuals: np.ndarray
    fill: np.ndarray
    right: np.ndarray
    pattern: tuple[np.ndarray, np.ndarray] | None
    a: int
    b: int
    work: int
    x: int
    kept: bool

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """Return the tables of places."""
        return self.unknowns, self.residuals, self.fill, self.right


@dataclass(frozen=True, eq=False)
class Tape:
    """A program, or derivatives of one.

    Attributes
    ----------
    registers : how many; they come first
    size : doubles in all
    constants : (places, values)
    time : its place
    code, index : int32
    blocks : tuple of Block
    results : (k,) places of what has been asked for beside registers
    """

    registers: int
    size: int
    constants: tuple[np.ndarray, np.ndarray]
    time: int
    code: np.ndarray
    index: np.ndarray
    blocks: tuple[SolveBlock, ...]
    results: np.ndarray

    def instructions(self) -> Iterator[tuple[int, str, list[int]]]:
        """Yield each instruction: where it stands, its operation, and the rest of it."""
        code, at = self.code.tolist(), 0
        while at < len(code):
            name = OPERATIONS[code[at]]
            length = LENGTH[name] if name in LENGTH else code[at + 2] if name == "rows" else 3 + 2 * code[at + 2]
            yield at, name, code[at + 1 : at + length]
            at += length

    def check(self) -> None:
        """Verify that all places are in range and that instructions end where the next begins.

        Raises
        ------
        AssertionError
        """
        starts = set()
        for at, name, rest in self.instructions():
            starts.add(at)
            places = self._places(name, rest)
            assert all(0 <= p < self.size for p in places), (at, name, rest)
        assert len(self.code) and OPERATIONS[self.code[-1]] == "end"
        for _, name, rest in self.instructions():
            assert name not in ("correct", "ready") or rest[1] in starts
        for block in self.blocks:
            assert all(((0 <= t) & (t < self.size)).all() for t in block.tables)
        assert not len(self.results) or 0 <= self.results.min() <= self.results.max() < self.size

    def _places(self, name: str, rest: list[int]) -> list[int]:
        if name == "rows":
            return [p for own, places in row_instructions(rest) for p in _reached(own, places, rest[0])]
        if name == "products":
            n, out, start, factor, source = rest
            terms = n if start < 0 else int(self.index[start + n])
            tables = [(out, n), (source, terms), *([(factor, terms)] if factor >= 0 else [])]
            return [p for first, count in tables for p in _ends(self.index[first : first + count])]
        if name == "fill":
            return [*_ends(self.index[rest[1] : rest[1] + rest[0]]), rest[2]]
        if name in ("linear", "constant", "newton", "correct", "ready", "implicit", "factor"):
            assert 0 <= rest[0] < len(self.blocks)
            return []
        return [rest[0], *rest[2:]] if name == "dot" else rest

    def text(self) -> str:
        """Return one line an instruction."""
        lines = []
        for at, name, rest in self.instructions():
            lines.append(f"{at:6} {name} {' '.join(map(str, rest[:2] if name == 'rows' else rest))}".rstrip())
            if name == "rows":
                lines += [f"         {own} {' '.join(map(str, places))}" for own, places in row_instructions(rest)]
        return "\n".join(lines)


def row_instructions(rest: list[int]) -> Iterator[tuple[str, list[int]]]:
    """Yield the instructions within `rows`, given what follows its number."""
    at = 2
    while at < len(rest):
        name = OPERATIONS[rest[at]]
        length = LENGTH_OF_ROWS.get(name) or rest[at + 1]
        yield name, rest[at + 1 : at + length]
        at += length


def row_operands(name: str, rest: list[int]) -> list[int]:
    """Return the operands of an instruction within `rows`, each a place and a flag, given what follows its number."""
    if name in ("gather", "strided", "scatter", "spread"):
        return rest[:2]
    return rest[{"linear": 2, "newton": 2, "correct": 3}.get(name, 0) :]


def _reached(name: str, rest: list[int], rows: int) -> list[int]:
    """Return the first and last places of the operands of an instruction on rows."""
    operands = row_operands(name, rest)
    extent = {1: rows - 1, 0: min(rows, CHUNK) - 1, -1: 0}
    found = [p for k in range(0, len(operands), 2) for p in (operands[k], operands[k] + extent[operands[k + 1]])]
    if name in ("strided", "spread"):
        found += [rest[2], rest[2] + (rows - 1) * rest[3]]
    return found


def _ends(table: np.ndarray) -> list[int]:
    return [int(table.min()), int(table.max())] if len(table) else []
