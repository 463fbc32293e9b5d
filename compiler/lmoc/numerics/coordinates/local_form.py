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
from lmoc.numerics.coordinates.tableau import SHARE, VANISHING, in_rows_of_one_size, rank_margin, stays_regular
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
            for k in np.flatnonzero(~(change <= SHARE * both)):
                if not stays_regular(others[k] - mine[k], float(both[k])):
                    return False
        return True


class _Torn:
    """A block most of whose rows each determine one coordinate by a constant pivot, one after the other.

    Attributes
    ----------
    columns : (size,) those left
    """

    def __init__(self, rows: np.ndarray, columns: np.ndarray, steps: np.ndarray, entry: tuple[np.ndarray, np.ndarray]):
        """
        Parameters
        ----------
        steps : (n, 2) row and column of the pivots
        entry : rows and columns of all entries in dependent columns
        """
        self._steps, self._by = steps.T
        self._rows, self.columns = np.setdiff1d(rows, self._steps), np.setdiff1d(columns, self._by)
        row, column = entry
        own = np.isin(row, self._steps) & np.isin(column, self._by)
        self._row, self._column = row[own], column[own]
        number = np.zeros((2, 1 + max(row.max(), column.max())), int)
        number[0, self._steps] = number[1, self._by] = np.arange(len(steps))
        self._pivots = SparseMatrix(len(steps), number[0, self._row], number[1, self._column])
        self._turned = SparseMatrix(len(steps), number[1, self._column], number[0, self._row])

    def left(self, matrix: np.ndarray) -> np.ndarray:
        """(size, size) the rows left of a matrix (rows, columns), by the columns left."""
        entries = matrix[self._row, self._column]
        followed = self._pivots.solve(entries, matrix[np.ix_(self._steps, self.columns)])
        return matrix[np.ix_(self._rows, self.columns)] - matrix[np.ix_(self._rows, self._by)] @ followed

    def lengths(self, matrix: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """(size, 1) lengths that the rows left have, where all entries have their full sizes and nothing cancels.

        Parameters
        ----------
        matrix : (rows, columns)
        sizes : (rows, columns) magnitudes of its entries
        """
        onto = np.copysign(sizes, matrix)[np.ix_(self._rows, self._by)]
        share = np.abs(self._turned.solve(matrix[self._row, self._column], onto.T)).T
        others = np.ones(matrix.shape[1], bool)
        others[self._by] = False
        length = np.linalg.norm((sizes[self._rows] + share @ sizes[self._steps])[:, others], axis=1, keepdims=True)
        return np.where(length > 0, length, 1.0)


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Where the dependent part of a matrix has entries, and its blocks.

    Attributes
    ----------
    row, column : (nnz,) places
    blocks : rows and columns, (blocks, size) each, of those blocks of one size whose entries change along the motion
    torn : the longer ones among which many rows have constant pivots
    """

    row: np.ndarray
    column: np.ndarray
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]
    torn: tuple[_Torn, ...]


def _pattern(plan: Plan) -> _Pattern:
    own: Constraints = plan.reduced.constraints
    rows, dependent = own.rows, own.column < own.rows
    place = distinct(own.row[dependent].astype(int) * rows + own.column[dependent])
    row, column = np.divmod(place, rows)
    match = maximum_matching(Incidence.of(rows, rows, row, column, np.zeros(len(place), np.int64)))
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
            found_torn = [_torn(m, match[m], (row, column), constant) for m in mine]
            torn += [t for t in found_torn if t is not None]
            mine = [m for m, t in zip(mine, found_torn, strict=True) if t is None]
        if mine:
            blocks.append((np.array(mine), match[np.array(mine)]))
    return _Pattern(row, column, tuple(blocks), tuple(torn))


def _constant(own: Constraints) -> frozenset[tuple[int, int]]:
    """The places of entries that are numbers."""
    steps = [step for step in own.program if isinstance(step, Apply) and not step.slots.shape[1]]
    numbers = np.isin(own.register, np.concatenate([np.zeros(0, int), *(step.out for step in steps)]))
    places = np.stack([own.row, own.column], axis=1)
    _, first, count = np.unique(places, axis=0, return_index=True, return_counts=True)
    alone = first[count == 1]  # others are sums
    return frozenset(map(tuple, places[alone[numbers[alone]]].tolist()))


def _torn(
    rows: np.ndarray, columns: np.ndarray, entry: tuple[np.ndarray, np.ndarray], constant: frozenset[tuple[int, int]]
) -> _Torn | None:
    """A long block without what follows by constant pivots; None where nothing does."""
    mine = np.isin(entry[0], rows) & np.isin(entry[1], columns)
    unknowns: dict[int, set[int]] = {r: set() for r in rows.tolist()}
    for r, c in zip(entry[0][mine].tolist(), entry[1][mine].tolist(), strict=True):
        unknowns[r].add(c)
    safe = [frozenset(c for c in found if (r, c) in constant) for r, found in unknowns.items()]
    if not any(safe):
        return None
    found = tear([frozenset(u) for u in unknowns.values()], safe, frozenset(), len(rows))
    if not found.steps:
        return None
    return _Torn(rows, columns, np.array([(rows[e], v) for e, v in found.steps]), entry)


class LocalForm:
    """The blocks of one set of constraints."""

    def __init__(self, plan: Plan) -> None:
        own = plan.once(_pattern)
        self._row, self._column, self._blocks, self._torn = own.row, own.column, own.blocks, own.torn
        self._left = [*(columns for _, columns in own.blocks), *(t.columns[None] for t in own.torn)]
        self._matrix = SparseMatrix(plan.reduced.constraints.rows, own.row, own.column)
        self._lengths: tuple[object, list[np.ndarray]] = None, []  # of the rows left, with these factors

    @property
    def sizes(self) -> list[int]:
        """Return the numbers of rows by which the blocks are judged."""
        return [columns.shape[1] for columns in self._left for _ in columns]

    def followed(self, matrix: np.ndarray) -> tuple[np.ndarray, bytes]:
        """Return how the dependent coordinates follow, (rows, states), and the signs of the blocks' determinants.

        Without numbers where they do not follow. The sign of constant pivots is left out.
        """
        rows = len(matrix)
        table = self._matrix.solve(matrix[self._row, self._column], matrix[:, rows:])
        own = self._own(matrix)
        known = np.isfinite(table).all() and all(np.isfinite(a).all() for a in own)
        signs = np.concatenate([np.zeros(0), *(np.linalg.slogdet(a)[0] for a in own)]) if known else np.zeros(1)
        if not (np.abs(signs) == 1.0).all():
            return np.full(table.shape, np.nan), b""
        return table, signs.astype(np.int8).tobytes()

    def local(self, matrix: np.ndarray, sizes: Equilibration | None = None, table: np.ndarray | None = None) -> LocalRows:
        """Return the rows of the blocks of a matrix (rows, columns).

        Parameters
        ----------
        sizes : with whose factors it has been scaled; None for those of its own entries
        table : what `followed` has returned of it
        """
        factors = None if sizes is None else sizes.factors()
        if table is None:
            table, _ = self.followed(matrix)
        if not np.isfinite(table).all():
            known = matrix if np.isfinite(matrix).all() else np.zeros_like(matrix)
            return LocalRows((known[None],), (np.array([rank_margin(matrix)]),), factors)
        own = self._own(matrix)
        if self._torn:
            whole = len(self._blocks)
            lengths = self._lengths_of_rows(matrix, sizes)
            own[whole:] = [a / length for a, length in zip(own[whole:], lengths, strict=True)]
        rows = tuple(np.concatenate([a, a @ table[c]], axis=2) for a, c in zip(own, self._left, strict=True))
        return LocalRows(rows, tuple(np.linalg.svd(r, compute_uv=False)[:, -1] for r in rows), factors)

    def vanishes(self, matrix: np.ndarray) -> bool:
        """Return whether the dependent coordinates of a block do not follow, in rows of one size."""
        parts = self._own(in_rows_of_one_size(matrix))
        return not all(
            np.isfinite(a).all() and np.linalg.svd(a, compute_uv=False)[:, -1].min() >= VANISHING for a in parts
        )

    def _own(self, matrix: np.ndarray) -> list[np.ndarray]:
        """The blocks themselves, (blocks, size, size) for each size; of those torn what is left."""
        whole = [matrix[rows[:, :, None], columns[:, None, :]] for rows, columns in self._blocks]
        return whole + [torn.left(matrix)[None] for torn in self._torn]

    def _lengths_of_rows(self, matrix: np.ndarray, sizes: Equilibration | None) -> list[np.ndarray]:
        if sizes is None:
            return [torn.lengths(matrix, np.abs(matrix)) for torn in self._torn]
        factors = sizes.factors()
        if self._lengths[0] is not factors:
            largest = sizes.served() * sizes.factor
            self._lengths = factors, [torn.lengths(matrix, largest) for torn in self._torn]
        return self._lengths[1]
