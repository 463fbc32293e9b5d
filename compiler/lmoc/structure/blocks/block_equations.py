"""The square system for all computed jets: its equations over registers, matched and in blocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.structure.blocks.blocks import Blocks, blocks_of
from lmoc.structure.index.incidence import Incidence, ranges
from lmoc.structure.index.system import EquationBatch, SumBatch
from lmoc.structure.linear.explicit import as_formula
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX, counted
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class BatchRows:
    """A batch with the registers of its leaves.

    Attributes
    ----------
    first : number of its first equation
    leaves : the leaves of the shape, ordered as in `explicit.as_formula`
    registers : (n, leaves)
    """

    batch: EquationBatch
    first: int
    leaves: tuple[Expr, ...]
    registers: np.ndarray

    @property
    def count(self) -> int:
        return len(self.batch.row)

    @property
    def equations(self) -> np.ndarray:
        return counted(self.first, self.first + self.count)

    @cached_property
    def unknown(self) -> list[int]:
        """Positions of the unknown jets among the leaves."""
        jets = set(self.batch.unknown)
        return [i for i, leaf in enumerate(self.leaves) if leaf in jets]


@dataclass(frozen=True, eq=False)
class SumRows:
    """Long sums with the registers of their entries."""

    sums: SumBatch
    first: int
    registers: np.ndarray

    @property
    def equations(self) -> np.ndarray:
        return np.arange(self.first, self.first + len(self.sums.row))


class SquareSystem:
    """All equations and their derivatives, and the register that each is matched with.

    Attributes
    ----------
    rows : BatchRows in the order of their equations, then `sums`
    match : (equations,) register that the equation stands for
    owner : (registers,) equation that computes it, -1 for what is given
    incidence : which computed registers stand in which equations (columns are registers)
    given : the same for the unknown jets that are states
    """

    def __init__(self, batches: Sequence[EquationBatch], sums: Sequence[SumBatch], base: np.ndarray, registers: int):
        self.rows: list[BatchRows] = []
        self.sums: list[SumRows] = []
        self.registers = registers
        first = 0
        for b in batches:
            leaves = as_formula(b.shape)[1]
            table = np.empty((len(b.row), len(leaves)), INDEX)
            for i, leaf in enumerate(leaves):
                table[:, i] = base[b.slots[:, leaf.value[0]]] + leaf.value[1]
            self.rows.append(BatchRows(b, first, leaves, table))
            first += len(b.row)
        for s in sums:
            self.sums.append(SumRows(s, first, base[s.index] + s.order))
            first += len(s.row)
        self.count = first

    def equation_numbers(self, system_rows: int) -> list[np.ndarray]:
        """For each number of differentiations: (rows,) which equation that derivative of each row is, -1 for none."""
        most = max([r.batch.times for r in self.rows] + [len(self.sums) - 1, 0])
        table = [np.full(system_rows, -1, INDEX) for _ in range(most + 1)]
        for r in self.rows:
            table[r.batch.times][r.batch.row] = r.equations
        for times, s in enumerate(self.sums):
            table[times][s.sums.row] = s.equations
        return table

    def finish(self, match: np.ndarray) -> None:
        """Take the matching and find the blocks."""
        self.match = match
        self.owner = np.full(self.registers, -1, INDEX)
        self.owner[match] = counted(0, self.count)
        rows, registers = [np.zeros(0, INDEX)], [np.zeros(0, INDEX)]
        for r in self.rows:
            for i in r.unknown:
                rows.append(r.equations)
                registers.append(r.registers[:, i])
        for s in self.sums:
            rows.append(s.first + s.sums.entry_row)
            registers.append(s.registers)
        row, register = np.concatenate(rows), np.concatenate(registers)
        computed = self.owner[register] >= 0
        self.incidence = _incidence(self.count, self.registers, row[computed], register[computed])
        self.given = _incidence(self.count, self.registers, row[~computed], register[~computed])
        self.blocks: Blocks = blocks_of(self.incidence.row, self.owner[self.incidence.column], self.count)

    def needed_for(self, registers: np.ndarray) -> np.ndarray:
        """(equations,) mask of those without which the given registers are not known."""
        needed = np.zeros(self.count, bool)
        new = distinct(self.owner[registers])
        new = new[new >= 0]
        while len(new):
            needed[new] = True
            sources = self.owner[self.incidence.column[ranges(self.incidence.start, new)]]
            new = distinct(sources[~needed[sources]])
        return needed

    def states_read(self, needed: np.ndarray) -> np.ndarray:
        """Registers of given jets that these equations read."""
        return distinct(self.given.column[needed[self.given.row]])


def _incidence(rows: int, columns: int, row: np.ndarray, column: np.ndarray) -> Incidence:
    return Incidence.of(rows, columns, row, column, np.zeros(len(row), np.int8))
