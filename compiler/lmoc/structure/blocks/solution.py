"""From blocks to steps: what is explicit is applied, alike rows of a level together; the rest is solved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply, Program, Solve, Step, Total
from lmoc.structure.blocks import large_blocks, small_blocks
from lmoc.structure.blocks.block_equations import BatchRows, SquareSystem, SumRows
from lmoc.structure.linear.explicit import as_formula, pivot, solved
from lmoc.structure.linear.substitution import partition
from lmoc.support.records import dataclass
from lmoc.support.sizes import LARGE_BLOCK


@dataclass(eq=False)
class Solution:
    """Collects steps with their levels.

    Attributes
    ----------
    helpers : how many registers beyond the system's own have been used
    tests : see `small_blocks.Surroundings`
    singular : the equations of blocks whose matrix is singular for the present values
    """

    system: SquareSystem
    needed: np.ndarray
    favourite: np.ndarray
    values: np.ndarray
    helpers: int = 0
    tests: list[tuple[str, Callable[[np.ndarray], np.ndarray]]] = field(default_factory=list)
    singular: list[np.ndarray] = field(default_factory=list)
    _steps: list[tuple[bool, int, Step]] = field(default_factory=list)
    _explicit: dict[tuple[bool, int, Expr], list[tuple[np.ndarray, np.ndarray]]] = field(default_factory=dict)

    def new_registers(self, count: int) -> np.ndarray:
        first = self.system.registers + self.helpers
        self.helpers += count
        return np.arange(first, first + count)

    def run(self) -> tuple[Program, Program]:
        """The steps of the equations marked as needed, and all others; each in order of their levels."""
        system, blocks = self.system, self.system.blocks
        alone = blocks.size[blocks.block] == 1
        for rows in system.rows:
            self._scalar(rows, np.flatnonzero(alone[rows.first : rows.first + rows.count]))
        for sums in system.sums:
            self._scalar_sums(sums, np.flatnonzero(alone[sums.first : sums.first + len(sums.sums.row)]))
        if not alone.all():
            self._blocks(np.flatnonzero(~alone))
        for (needed, level, formula), parts in self._explicit.items():
            slots, out = (np.concatenate(tables) for tables in zip(*parts, strict=True))
            self._steps.append((needed, level, Apply(formula, slots, out)))
        ordered = sorted(self._steps, key=lambda item: item[1])
        return (
            tuple(step for needed, _, step in ordered if needed),
            tuple(step for needed, _, step in ordered if not needed),
        )

    # ------------------------------------------------------------------ one equation

    def _scalar(self, rows: BatchRows, which: np.ndarray) -> None:
        if not len(which):
            return
        equations, registers = rows.first + which, rows.registers[which]
        own = registers[:, rows.unknown] == self.system.match[equations][:, None]
        level = self.system.blocks.level[self.system.blocks.block[equations]]
        keys = np.stack([own.argmax(axis=1), level, self.needed[equations]], axis=1)
        for (position, at, needed), part in partition(keys):
            leaf = rows.leaves[rows.unknown[position]]
            table = registers if part is None else registers[part]
            self._solved(rows, leaf, table, equations if part is None else equations[part], at, bool(needed))

    def _solved(
        self, rows: BatchRows, leaf: Expr, table: np.ndarray, equations: np.ndarray, level: int, needed: bool
    ) -> None:
        out = table[:, rows.leaves.index(leaf)]
        formula = solved(rows.batch.shape, leaf)
        if formula is None:
            residual = self.new_registers(len(out))
            inner = Apply(as_formula(rows.batch.shape)[0], table, residual)
            self._steps.append((needed, level, Solve((inner,), out[:, None], residual[:, None], False, False)))
            return
        self._check(rows, leaf, table, equations)
        formula, leaves = as_formula(formula)
        columns = [rows.leaves.index(f) for f in leaves]
        self._explicit.setdefault((needed, level, formula), []).append((table[:, columns], out))

    def _check(self, rows: BatchRows, leaf: Expr, table: np.ndarray, equations: np.ndarray) -> None:
        """A constant coefficient must not be zero."""
        coefficient = pivot(rows.batch.shape, rows.batch.kinds, leaf)
        if coefficient is None or coefficient.is_const:
            return
        place = {f.value[0]: i for i, f in enumerate(rows.leaves)}
        zero = evaluate(coefficient, lambda k, _: self.values[table[:, place[k]]]) == 0
        if np.any(zero):
            self.singular += [equations[i : i + 1] for i in np.flatnonzero(np.broadcast_to(zero, len(equations)))]

    def _scalar_sums(self, sums: SumRows, which: np.ndarray) -> None:
        if not len(which):
            return
        equations = sums.first + which
        level = self.system.blocks.level[self.system.blocks.block[equations]]
        for (at, needed), part in partition(np.stack([level, self.needed[equations]], axis=1)):
            chosen = which if part is None else which[part]
            self._steps.append((bool(needed), at, self._explicit_total(sums, chosen)))

    def _explicit_total(self, sums: SumRows, which: np.ndarray) -> Total:
        out = self.system.match[sums.first + which]
        step = large_blocks.total(sums, which, out)
        owner = np.repeat(np.arange(len(out)), np.diff(step.start))
        own = step.index == out[owner]
        pivots = step.coefficient[own]
        kept = ~own
        start = np.concatenate([[0], np.cumsum(np.bincount(owner[kept], minlength=len(out)))])
        return Total(start, step.index[kept], -step.coefficient[kept] / pivots[owner[kept]], out)

    # ------------------------------------------------------------- several equations

    def _blocks(self, members: np.ndarray) -> None:
        system, blocks = self.system, self.system.blocks
        large = blocks.size > LARGE_BLOCK
        for s in system.sums:
            large[blocks.block[s.equations]] = True
        number = blocks.block[members]
        small = members[~large[number]]
        if len(small):
            for alike in small_blocks.alike_blocks(system, small, self.needed):
                self._add(alike.needed, alike.level, small_blocks.steps_of, alike)
        rest = members[large[number]]
        rest = rest[np.lexsort((rest, blocks.block[rest]))]
        cuts = np.flatnonzero(np.diff(blocks.block[rest])) + 1
        for equations in np.split(rest, cuts) if len(rest) else []:
            level = int(blocks.level[blocks.block[equations[0]]])
            self._add(bool(self.needed[equations[0]]), level, large_blocks.steps_of, system, equations)

    def _add(self, needed: bool, level: int, maker: Callable[..., list[Step]], *what: object) -> None:
        try:
            around = small_blocks.Surroundings(self.favourite, self.values, self.new_registers, self.tests)
            steps = maker(*what, around)
        except small_blocks.SingularBlocks as error:
            self.singular.append(error.equations[0])
            return
        self._steps += [(needed, level, step) for step in steps]
