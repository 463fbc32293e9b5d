"""The constraints of many loops, loop by loop: what is judged of a place costs and measures no more than its loops.

The dependent coordinates follow from the states block by block (block lower triangular form: Duff, Erisman and Reid,
Direct Methods for Sparse Matrices, 2nd ed., 2017, chapter 6). With those of the blocks before it eliminated, the rows
of a block are ``A [1, T]``: A by its own dependent coordinates, T how these follow from the states. Where the rows of
all blocks are independent so are all constraints; and a combination of a block's rows that comes to c is one of all
constraints that comes to c, of no smaller length, so that no singular value here is below the smallest one of the
whole matrix. That one also falls with the number of loops in a row, far from any singular place; these do not.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.sparse import SparseMatrix
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.tableau import SHARE, VANISHING, in_rows_of_one_size, rank_margin, stays_regular
from lmoc.numerics.plan.plan import Plan
from lmoc.structure.blocks.blocks import blocks_of
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass


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


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Where the dependent part of a matrix has entries, and its blocks.

    Attributes
    ----------
    row, column : (nnz,) places
    blocks : rows and columns, (blocks, size) each, of those blocks of one size whose entries change along the motion
    """

    row: np.ndarray
    column: np.ndarray
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]


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
    blocks = []
    for size in distinct(np.array([len(m) for m in moving], int)).tolist():
        mine = np.array([m for m in moving if len(m) == size])
        blocks.append((mine, match[mine]))
    return _Pattern(row, column, tuple(blocks))


class LocalForm:
    """The blocks of one set of constraints."""

    def __init__(self, plan: Plan) -> None:
        own = plan.once(_pattern)
        self._row, self._column, self._blocks = own.row, own.column, own.blocks
        self._matrix = SparseMatrix(plan.reduced.constraints.rows, own.row, own.column)

    @property
    def sizes(self) -> list[int]:
        """Return the numbers of rows of the blocks."""
        return [rows.shape[1] for rows, _ in self._blocks for _ in rows]

    def followed(self, matrix: np.ndarray) -> tuple[np.ndarray, bytes]:
        """Return how the dependent coordinates follow, (rows, states), and the signs of the blocks' determinants.

        Without numbers where they do not follow.
        """
        rows = len(matrix)
        table = self._matrix.solve(matrix[self._row, self._column], matrix[:, rows:])
        signs = np.concatenate([np.zeros(0), *(np.linalg.slogdet(own)[0] for own in self._own(matrix))])
        if not (np.isfinite(table).all() and (np.abs(signs) == 1.0).all()):
            return np.full(table.shape, np.nan), b""
        return table, signs.astype(np.int8).tobytes()

    def local(self, matrix: np.ndarray, factors: object = None, table: np.ndarray | None = None) -> LocalRows:
        """Return the rows of the blocks of a matrix (rows, columns).

        Parameters
        ----------
        factors : with which it has been scaled
        table : what `followed` has returned of it
        """
        if table is None:
            table, _ = self.followed(matrix)
        if not np.isfinite(table).all():
            known = matrix if np.isfinite(matrix).all() else np.zeros_like(matrix)
            return LocalRows((known[None],), (np.array([rank_margin(matrix)]),), factors)
        parts = zip(self._own(matrix), self._blocks, strict=True)
        rows = tuple(np.concatenate([a, a @ table[columns]], axis=2) for a, (_, columns) in parts)
        return LocalRows(rows, tuple(np.linalg.svd(r, compute_uv=False)[:, -1] for r in rows), factors)

    def vanishes(self, matrix: np.ndarray) -> bool:
        """Return whether the dependent coordinates of a block do not follow, in rows of one size."""
        parts = self._own(in_rows_of_one_size(matrix))
        return not all(
            np.isfinite(a).all() and np.linalg.svd(a, compute_uv=False)[:, -1].min() >= VANISHING for a in parts
        )

    def _own(self, matrix: np.ndarray) -> list[np.ndarray]:
        """The blocks themselves, (blocks, size, size) for each size."""
        return [matrix[rows[:, :, None], columns[:, None, :]] for rows, columns in self._blocks]
