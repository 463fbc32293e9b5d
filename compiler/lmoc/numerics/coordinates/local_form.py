"""The constraints of many loops, loop by loop: what is judged of a place costs and measures no more than its loops.

The dependent coordinates follow from the states block by block (block lower triangular form: Duff, Erisman and Reid,
Direct Methods for Sparse Matrices, 2nd ed., 2017, chapter 6). With those of the blocks before it eliminated, the rows
of a block are ``A [1, T]``: A by its own dependent coordinates, T how these follow from the states. Where the rows of
all blocks are independent so are all constraints; and a combination of a block's rows that comes to c is one of all
constraints that comes to c, of no smaller length, so that no singular value here is below the smallest one of the
whole matrix. That one also falls with the number of loops in a row, far from any singular place; these do not.

A block can itself be long: the bars of one closed chain. Most of its rows determine a coordinate by a constant pivot
(the end of a bar by its beginning), which never vanishes; these are eliminated in turn (tearing), and the block is
judged by the few rows that are left, ``S [1, T]`` with the Schur complement S of those rows.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.sparse import SparseMatrix
from lmoc.ir.program import Apply
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.equilibration import Equilibration
from lmoc.numerics.coordinates.limits import LIMITS
from lmoc.numerics.coordinates.tableau import in_rows_of_one_size, rank_margin, stays_regular
from lmoc.numerics.plan.plan import Plan
from lmoc.structure.blocks.blocks import blocks_of
from lmoc.structure.blocks.tearing import tear
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

_WHOLE = 8  # rows of a block that is seen as a whole: its smallest singular value is a matter of the place


@dataclass(frozen=True, eq=False)
class LocalRows:
    """The rows of all blocks at one place.

    Attributes
    ----------
    rows : a stack (blocks, size, size + states) for each size of blocks; or the whole matrix as one, where the
        dependent coordinates do not follow
    least : their smallest singular values, (blocks,) for each size
    factors : with which the matrix has been scaled
    """

    rows: tuple[np.ndarray, ...]
    least: tuple[np.ndarray, ...]
    factors: object

    @property
    def margin(self) -> float:
        """The smallest singular value of any block."""
        return float(min((least.min() for least in self.least), default=1.0))

    def stays_regular(self, other: LocalRows) -> bool:
        """Return whether each block keeps its rank on the way to another place (`tableau.stays_regular`)."""
        if [r.shape for r in self.rows] != [r.shape for r in other.rows]:
            return False
        for mine, others, least, own in zip(self.rows, other.rows, self.least, other.least, strict=True):
            change, both = np.linalg.norm(others - mine, axis=(1, 2)), least + own
            for k in np.flatnonzero(~(change <= LIMITS.share * both)):
                if not stays_regular(others[k] - mine[k], float(both[k])):
                    return False
        return True


class _Torn:
    """A block most of whose rows each determine one coordinate by a constant pivot, one after the other.

    Attributes
    ----------
    columns : (size,) those left
    """

    def __init__(self, rows: np.ndarray, columns: np.ndarray, steps: np.ndarray, number: np.ndarray) -> None:
        """
        Parameters
        ----------
        steps : (n, 2) row and column of the pivots
        number : as in `_Pattern`
        """
        self._steps, by = steps.T
        self._rows, self.columns = np.setdiff1d(rows, self._steps), np.setdiff1d(columns, by)
        pivots = number[np.ix_(self._steps, by)]
        row, column = np.nonzero(pivots >= 0)
        self._entries = pivots[row, column]
        self._pivots, self._turned = SparseMatrix(len(steps), row, column), SparseMatrix(len(steps), column, row)
        self._followed, self._onto = number[np.ix_(self._steps, self.columns)], number[np.ix_(self._rows, by)]
        self._own = number[np.ix_(self._rows, self.columns)]
        self._others = np.delete(np.arange(number.shape[1]), by)

    def left(self, padded: np.ndarray) -> np.ndarray:
        """(size, size) the rows left of a matrix, by the columns left.

        Parameters
        ----------
        padded : (nnz + 1,) its entries, and 0
        """
        followed = self._pivots.solve(padded[self._entries], padded[self._followed])
        found: np.ndarray = padded[self._own] - padded[self._onto] @ followed
        return found

    def lengths(self, padded: np.ndarray, sizes: np.ndarray, number: np.ndarray) -> np.ndarray:
        """(size, 1) lengths that the rows left have, where all entries have their full sizes and nothing cancels.

        Parameters
        ----------
        padded, sizes : (nnz + 1,) entries of the matrix, and their magnitudes
        """
        onto = np.copysign(sizes, padded)[self._onto]
        share = np.abs(self._turned.solve(padded[self._entries], onto.T)).T
        rows, steps = (sizes[number[k][:, self._others]] for k in (self._rows, self._steps))
        length: np.ndarray = np.linalg.norm(rows + share @ steps, axis=1, keepdims=True)
        return np.where(length > 0, length, 1.0)


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Where a matrix has entries, and the blocks of its dependent part.

    Attributes
    ----------
    row, column : (nnz,) places, by rows
    entry : which of them each entry of the constraints adds to
    number : (rows, columns) numbers of the entries; -1 where there is none
    dependent : (dependent part,) numbers of its entries
    blocks : rows and columns, (blocks, size) each, of those blocks of one size whose entries change along the motion
    torn : the longer ones among which many rows have constant pivots
    """

    row: np.ndarray
    column: np.ndarray
    entry: np.ndarray
    number: np.ndarray
    dependent: np.ndarray
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]
    torn: tuple[_Torn, ...]


def _pattern(plan: Plan) -> _Pattern:
    own: Constraints = plan.reduced.constraints
    rows, columns = own.rows, len(own.variable)
    all_places = own.place
    place = distinct(all_places)
    every_row, every_column = np.divmod(place, columns)
    number = np.full((rows, columns), -1)
    number[every_row, every_column] = np.arange(len(place))
    dependent = np.flatnonzero(every_column < rows)
    row, column = every_row[dependent], every_column[dependent]
    match = maximum_matching(Incidence.of(rows, rows, row, column, np.zeros(len(row), np.int64)))
    equation = np.empty(rows, int)  # in which each dependent coordinate is computed
    equation[match] = np.arange(rows)
    found = blocks_of(row, equation[column], rows)
    members = np.split(np.argsort(found.block, kind="stable"), np.cumsum(found.size)[:-1])
    moving = [m for m in members if np.isin(match[m], own.watched).any()]
    constant = _constant(own) if any(len(m) > _WHOLE for m in moving) else frozenset()
    blocks, torn = [], []
    for size in distinct(np.array([len(m) for m in moving], int)).tolist():
        mine = [m for m in moving if len(m) == size]
        if size > _WHOLE:
            found_torn = [_torn(m, match[m], number, constant) for m in mine]
            torn += [t for t in found_torn if t is not None]
            mine = [m for m, t in zip(mine, found_torn, strict=True) if t is None]
        if mine:
            blocks.append((np.array(mine), match[np.array(mine)]))
    entry = np.searchsorted(place, all_places)
    return _Pattern(every_row, every_column, entry, number, dependent, tuple(blocks), tuple(torn))


def _constant(own: Constraints) -> frozenset[tuple[int, int]]:
    """The places of entries that are numbers."""
    steps = [step for step in own.program if isinstance(step, Apply) and not step.slots.shape[1]]
    numbers = np.isin(own.register, np.concatenate([np.zeros(0, int), *(step.out for step in steps)]))
    places = np.stack([own.row, own.column], axis=1)
    _, first, count = np.unique(places, axis=0, return_index=True, return_counts=True)
    alone = first[count == 1]  # others are sums
    return frozenset(map(tuple, places[alone[numbers[alone]]].tolist()))


def _torn(
    rows: np.ndarray, columns: np.ndarray, number: np.ndarray, constant: frozenset[tuple[int, int]]
) -> _Torn | None:
    """A long block without what follows by constant pivots; None where nothing does."""
    unknowns = [frozenset(columns[number[r, columns] >= 0].tolist()) for r in rows.tolist()]
    safe = [frozenset(c for c in own if (r, c) in constant) for r, own in zip(rows.tolist(), unknowns, strict=True)]
    if not any(safe):
        return None
    found = tear(unknowns, safe, frozenset(), len(rows))
    if not found.steps:
        return None
    return _Torn(rows, columns, np.array([(rows[e], v) for e, v in found.steps]), number)


class LocalForm:
    """The blocks of one set of constraints, whose matrices are given by their entries (nnz,)."""

    def __init__(self, plan: Plan) -> None:
        self._pattern = own = plan.once(_pattern)
        self._blocks = [own.number[rows[:, :, None], columns[:, None, :]] for rows, columns in own.blocks]
        self._left = [*(columns for _, columns in own.blocks), *(t.columns[None] for t in own.torn)]
        self._matrix = SparseMatrix(len(own.number), own.row[own.dependent], own.column[own.dependent])
        self._states = np.flatnonzero(own.column >= len(own.number))
        self._lengths: tuple[object, list[np.ndarray]] = None, []  # of the rows left, with these factors

    @property
    def sizes(self) -> list[int]:
        """Return the numbers of rows by which the blocks are judged."""
        return [columns.shape[1] for columns in self._left for _ in columns]

    @property
    def count(self) -> int:
        """Return the number of entries of the matrix."""
        return len(self._pattern.row)

    def equilibration(self, units: np.ndarray) -> Equilibration:
        """Return sizes of the entries, none seen yet, of coordinates in these units."""
        rows, columns = self._pattern.number.shape
        return Equilibration((rows, columns), self._pattern.row, self._pattern.column, units)

    def summed(self, entries: np.ndarray) -> np.ndarray:
        """Return the entries of the matrix from those of the constraints, some of which share a place."""
        return np.bincount(self._pattern.entry, entries, len(self._pattern.row))

    def entries(self, dense: np.ndarray) -> np.ndarray:
        """Return the entries of a matrix (rows, columns)."""
        return dense[self._pattern.row, self._pattern.column]

    def dense(self, matrix: np.ndarray) -> np.ndarray:
        """Return the matrix (rows, columns)."""
        return np.append(matrix, 0.0)[self._pattern.number]

    def followed(self, matrix: np.ndarray) -> tuple[np.ndarray, bytes]:
        """Return how the dependent coordinates follow, (rows, states), and the signs of the blocks' determinants.

        Without numbers where they do not follow. The sign of constant pivots is left out.
        """
        own = self._pattern
        rows, columns = own.number.shape
        right = np.zeros((rows, columns - rows))
        right[own.row[self._states], own.column[self._states] - rows] = matrix[self._states]
        table, parts = self._matrix.solve(matrix[own.dependent], right), self._own(matrix)
        known = np.isfinite(table).all() and all(np.isfinite(a).all() for a in parts)
        signs = np.concatenate([np.zeros(0), *(np.linalg.slogdet(a)[0] for a in parts)]) if known else np.zeros(1)
        if not (np.abs(signs) == 1.0).all():
            return np.full(table.shape, np.nan), b""
        return table, signs.astype(np.int8).tobytes()

    def local(
        self, matrix: np.ndarray, sizes: Equilibration | None = None, table: np.ndarray | None = None
    ) -> LocalRows:
        """Return the rows of the blocks of a matrix.

        Parameters
        ----------
        sizes : with whose factors it has been scaled; None for those of its own entries
        table : what `followed` has returned of it
        """
        factors = None if sizes is None else sizes.factors()
        if table is None:
            table, _ = self.followed(matrix)
        if not np.isfinite(table).all():
            known = self.dense(matrix if np.isfinite(matrix).all() else np.zeros_like(matrix))
            return LocalRows((known[None],), (np.array([rank_margin(self.dense(matrix))]),), factors)
        own, whole = self._own(matrix), len(self._blocks)
        own[whole:] = [a / n for a, n in zip(own[whole:], self._lengths_of_rows(matrix, sizes), strict=True)]
        rows = tuple(np.concatenate([a, a @ table[c]], axis=2) for a, c in zip(own, self._left, strict=True))
        return LocalRows(rows, tuple(np.linalg.svd(r, compute_uv=False)[:, -1] for r in rows), factors)

    def vanishes(self, matrix: np.ndarray, units: np.ndarray) -> bool:
        """Return whether the dependent coordinates of a block do not follow, in rows of one size and these units."""
        parts = self._own(self._in_rows_of_one_size(matrix, units))
        return not all(
            np.isfinite(a).all() and np.linalg.svd(a, compute_uv=False)[:, -1].min() >= LIMITS.vanishing for a in parts
        )

    def _in_rows_of_one_size(self, matrix: np.ndarray, units: np.ndarray) -> np.ndarray:
        own = self._pattern
        shape = len(own.number), own.number.shape[1]
        place = np.ascontiguousarray(own.row.astype(np.int64) * shape[1] + own.column, np.int32)
        return in_rows_of_one_size(shape, place, matrix, units)

    def _own(self, matrix: np.ndarray) -> list[np.ndarray]:
        """The blocks themselves, (blocks, size, size) for each size; of those torn what is left."""
        padded = np.append(matrix, 0.0)
        return [padded[number] for number in self._blocks] + [t.left(padded)[None] for t in self._pattern.torn]

    def _lengths_of_rows(self, matrix: np.ndarray, sizes: Equilibration | None) -> list[np.ndarray]:
        factors = None if sizes is None else sizes.factors()
        if factors is None or self._lengths[0] is not factors:
            largest = np.abs(matrix) if sizes is None else sizes.served() * sizes.factor
            own, padded, full = self._pattern, np.append(matrix, 0.0), np.append(largest, 0.0)
            self._lengths = factors, [torn.lengths(padded, full, own.number) for torn in own.torn]
        return self._lengths[1]
