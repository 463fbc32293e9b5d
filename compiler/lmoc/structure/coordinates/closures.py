"""The equations that close loops, and the system in which all coordinates of the loops are states.

What is left of the constraints where everything has been eliminated that follows by a formula: the closures. Minimal
coordinates solve them, and their derivatives, for as many of the loops' coordinates. Here these stay states, and of a
closure only the highest derivative is solved, for the accelerations and reactions: the system of index 1 (Hairer &
Wanner, Solving Ordinary Differential Equations II, VII.1). The closures themselves are invariants of its motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from lmoc.expression.dag import slot, sub
from lmoc.structure.blocks.block_equations import SquareSystem
from lmoc.structure.blocks.blocks import blocks_of
from lmoc.structure.blocks.tearing import tear
from lmoc.structure.coordinates.coordinates import Choice
from lmoc.structure.coordinates.selection import Selection, finished
from lmoc.structure.index.system import EquationBatch
from lmoc.structure.linear.coefficients import INPUT
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

_HOWEVER_DEEP = 1 << 30
_MOST = 300  # constraints of one mechanism that are torn; with more, all of them count as closures


@dataclass(frozen=True, eq=False)
class Closures:
    """The constraints that change along the motion, torn.

    Attributes
    ----------
    row : (k,) the closures, rows of the system
    column : (k,) coordinates that the others of their loop would determine through them
    formula : (2, m) rows that give a coordinate by a formula, and the column of that
    """

    row: np.ndarray
    column: np.ndarray
    formula: np.ndarray

    def among(self, count: int) -> np.ndarray:
        """(count,) mask of the closures among the rows of a system."""
        mask = np.zeros(count, bool)
        mask[self.row] = True
        return mask


def closures(selection: Selection) -> Closures | None:
    """Return the closures of a scene; None where everything follows by formulas, or by constant factors."""
    if selection.start is None or not selection.choice.dependent:
        return None
    tied, rows = selection.tied, selection.system.rows
    dependent = np.full(len(selection.d), -1)
    dependent[selection.choice.match[0][1]] = selection.choice.match[0][0]
    inner = dependent[tied.column] >= 0
    row, column, constant = tied.row[inner], tied.column[inner], tied.constant[inner]
    watched = rows_to_watch(tied.row, tied.column, tied.constant, dependent, rows)[1]
    own = watched[row] & watched[dependent[column]] & (tied.value[inner] != 0)
    if not own.any():
        return None
    row, column, constant = row[own], column[own], constant[own]
    label = blocks_of(np.concatenate([row, dependent[column]]), np.concatenate([dependent[column], row]), rows).block
    order = np.argsort(label[row], kind="stable")
    cuts = np.flatnonzero(np.diff(label[row][order])) + 1
    parts = [_torn(row[k].tolist(), column[k].tolist(), constant[k].tolist()) for k in np.split(order, cuts)]
    closing, free, formula = (np.concatenate(found, axis=-1) for found in zip(*parts, strict=True))
    place = np.argsort(closing)
    return Closures(closing[place], free, formula)


def _torn(row: list[int], column: list[int], constant: list[bool]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tear constraints that share coordinates: closures, coordinates that they would give, and what has a formula."""
    unknowns: dict[int, set[int]] = {}
    safe: dict[int, set[int]] = {}
    for i, j, fixed in zip(row, column, constant, strict=True):
        unknowns.setdefault(i, set()).add(j)
        safe.setdefault(i, set()).update([j] if fixed else [])
    equations = sorted(unknowns)
    if len(equations) > _MOST:
        return np.array(equations, np.int64), np.unique(column), np.zeros((2, 0), np.int64)
    found = tear(
        [frozenset(unknowns[e]) for e in equations], [frozenset(safe[e]) for e in equations], frozenset(), _HOWEVER_DEEP
    )
    formula = np.array([(equations[e], v) for e, v in found.steps], np.int64).reshape(-1, 2).T
    return np.array([equations[e] for e in found.residuals], np.int64), np.array(found.torn, np.int64), formula


def rows_to_watch(
    row: np.ndarray, column: np.ndarray, constant: np.ndarray, dependent: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of rows: those that are kept, and those of blocks that change along the motion.

    Parameters
    ----------
    row, column, constant : entries of the constraint matrix, and whether each depends on parameters only
    dependent : (columns,) the row that each dependent column stands for, -1 for the others
    count : number of rows
    """
    reads = dependent[column]
    inner = reads >= 0
    blocks = blocks_of(row[inner], reads[inner], count)
    changing = np.zeros(len(blocks.size), bool)
    within = inner & ~constant & (blocks.block[row] == blocks.block[np.where(inner, reads, row)])
    changing[blocks.block[row[within]]] = True
    watched = np.zeros(count, bool)
    watched[row] = changing[blocks.block[row]]
    kept, before = watched.copy(), -1
    while before != (before := int(kept.sum())):  # what the rows read, too
        kept[reads[inner & kept[row]]] = True
    return kept, watched


class NotReleasedError(Exception):
    """The coordinates of the loops cannot all be states; the text says why."""


def released(selection: Selection, found: Closures) -> tuple[Selection, np.ndarray]:
    """Return the selection with all coordinates of the loops as states.

    Returns
    -------
    selection : without the closures below their highest derivative
    rate : (k,) registers, one for each closure, that its highest derivative is set to

    Raises
    ------
    NotReleasedError
    """
    system, c = selection.system, selection.c
    if np.isin(found.row, system.sums.row).any():
        raise NotReleasedError("a sum over very many parts closes a loop")
    batches, sums = system.differentiated(c)
    parts = [part for b in batches for part in _Split(b, found, system.rows, c, len(system.kind)).parts()]
    layout = selection.layout
    base = np.concatenate([layout.base, layout.count + np.arange(len(found.row))]).astype(INDEX)
    square = SquareSystem(parts, sums, base, layout.count + len(found.row))
    choice = _choice(selection, found)
    wanted = np.concatenate([selection.wanted, found.column])  # states although no equation reads them
    whole = replace(selection, choice=choice, wanted=wanted)
    return finished(whole, layout, square), base[len(layout.base) :]


@dataclass(frozen=True, eq=False)
class _Split:
    """A batch apart: rows that close no loop, and the highest derivatives of closures, each set to a register."""

    batch: EquationBatch
    closures: Closures
    rows: int
    c: np.ndarray
    extended: int

    @cached_property
    def closing(self) -> np.ndarray:
        result: np.ndarray = self.closures.among(self.rows)[self.batch.row]
        return result

    def parts(self) -> Iterator[EquationBatch]:
        b = self.batch
        if not self.closing.any():
            yield b
            return
        if not self.closing.all():
            yield b.take(np.flatnonzero(~self.closing))
        top = np.flatnonzero(self.closing & (self.c[b.row] == b.times))
        if len(top):
            yield self._with_rate(b.take(top))

    def _with_rate(self, b: EquationBatch) -> EquationBatch:
        number = np.full(self.rows, -1)
        number[self.closures.row] = self.extended + np.arange(len(self.closures.row))
        column = b.slots.shape[1]
        table = np.column_stack([b.slots, number[b.row]]).astype(INDEX)
        return EquationBatch(sub(b.shape, slot(column)), (*b.kinds, INPUT), table, b.row, b.times)


def _choice(selection: Selection, found: Closures) -> Choice:
    """Return the choice without the closures: what follows by a formula is dependent, nothing else of the loops."""
    closing, c = found.among(selection.system.rows), selection.c
    by_formula = np.full(selection.system.rows, -1, np.int64)
    by_formula[found.formula[0]] = found.formula[1]
    free = np.zeros(len(selection.d), bool)
    free[found.column] = True
    dependent, match = [], []
    for rows, columns in selection.choice.match:
        kept = ~closing[rows]
        rows, columns = rows[kept], np.where(by_formula[rows[kept]] >= 0, by_formula[rows[kept]], columns[kept])
        if len(np.unique(columns)) < len(columns) or free[columns].any() or (selection.d[columns] < c[rows]).any():
            raise NotReleasedError("constraints on positions and on velocities close one loop together")
        dependent.append(np.sort(columns))
        match.append((rows, columns))
    return Choice(tuple(dependent), tuple(match), selection.choice.singular)
