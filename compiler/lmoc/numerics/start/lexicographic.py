"""Lexicographic least squares on independent parts of a sparse system."""

from __future__ import annotations

import numpy as np

from lmoc.support.distinct import distinct, distinct_rows
from lmoc.support.records import dataclass

_RANK = 1e-9  # singular values below count as zero; all rows have length 1
_DENSE = 1000  # states of a part up to which it is solved with dense matrices; rows looked at for contradictions
_SHORT, _REPEATED = 1e-8, 1e-10  # weights of short steps, and of rows that may repeat each other
_LOWER, _LOWEST = 1e-2, 3  # weight of each further rank of start rows, and how many ranks are told apart by it
_LEFT = 1e-6  # of what rows miss: if more than this cannot be made good, they contradict each other


@dataclass(frozen=True, eq=False)
class EqualParts:
    """Independent parts of equal size: (parts, rows) of each level, fixed rows first, and (parts, states)."""

    rows: tuple[np.ndarray, ...]
    states: np.ndarray


@dataclass(frozen=True, eq=False)
class Components:
    """The parts of the system that share no state."""

    batches: tuple[EqualParts, ...]
    part_of_row: np.ndarray
    rows: int
    states: int

    def step(self, jacobian, residual: np.ndarray, away: np.ndarray) -> np.ndarray:
        """The step d with least |J d + r| on fixed rows, then on start rows by their ranks, then least |away + d|.

        States that no row touches stay as they are.

        Parameters
        ----------
        away : (n,) how far the states are from where they are to be if nothing decides them
        """
        d = np.zeros(self.states)
        lookup = _Lookup(jacobian, self.states)
        for batch in self.batches:
            if batch.states.shape[1] > _DENSE:
                for *rows, states in zip(*batch.rows, batch.states, strict=True):
                    d[states] = _large(jacobian, residual, rows, states, self.states)
                continue
            levels = [(lookup.blocks(rows, batch.states), residual[rows]) for rows in batch.rows]
            d[batch.states] = _lexicographic(levels, away[batch.states])
        return d

    def connected(self, rows: np.ndarray) -> list[np.ndarray]:
        """Rows sorted into parts."""
        rows = rows[np.argsort(self.part_of_row[rows], kind="stable")]
        parts = self.part_of_row[rows]
        return [part for part in np.split(rows, np.flatnonzero(np.diff(parts)) + 1) if len(part)]

    def together(self, rows: np.ndarray) -> np.ndarray:
        """(all rows,) mask of those that share a part with these."""
        return np.isin(self.part_of_row, self.part_of_row[rows])

    def excluded(self, jacobian, residual: np.ndarray, rows: np.ndarray, straight: np.ndarray) -> bool:
        """Return whether it is certain that no states satisfy these rows, which some states miss.

        Either the straight ones contradict each other, or they leave no freedom to what the others read.

        Parameters
        ----------
        rows : numbers of rows
        straight : (all rows,) mask of affine functions of the states
        """
        rows = rows[:_DENSE]  # what some of them exclude, all of them do
        columns = distinct(jacobian[1][np.isin(jacobian[0], rows)])
        block = _Lookup(jacobian, self.states).blocks(rows[None], columns[None])
        size = _sizes(block)[0]
        block, rest = _scaled(block)[0], residual[rows] / size
        known = straight[rows]
        linear = block[known]
        inverse = _pseudo_inverse(linear[None])[0]
        left = rest[known] - linear @ (inverse @ rest[known])
        if np.abs(left).max(initial=0.0) > _LEFT * np.abs(rest).max(initial=0.0):
            return True
        free = np.abs(np.eye(len(columns)) - inverse @ linear).max(axis=1, initial=0.0) > _RANK
        read = np.isin(jacobian[0], rows[~known])
        return not np.isin(jacobian[1][read], columns[free]).any() and not known.all()


class _Lookup:
    """Dense blocks out of a matrix of (rows, columns, values)."""

    def __init__(self, jacobian, states: int) -> None:
        rows, columns, self.values = jacobian
        self.states = states
        key = rows * states + columns
        self.order = np.argsort(key)
        self.key = key[self.order]

    def blocks(self, rows: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(parts, rows, states)."""
        wanted = rows[:, :, None] * self.states + states[:, None, :]
        if not len(self.key):
            return np.zeros(wanted.shape)
        at = np.minimum(np.searchsorted(self.key, wanted), len(self.key) - 1)
        return np.where(self.key[at] == wanted, self.values[self.order[at]], 0.0)


def split(jacobian, level: np.ndarray, states: int) -> Components:
    """Find the parts, and gather those of equal size.

    Parameters
    ----------
    jacobian : (rows, columns, values)
    level : (rows,) 0 for rows that must hold, above it which of the others count first
    """
    rows, columns, _ = jacobian
    label = _connected(rows, columns, len(level), states)
    row_label, state_label = label[: len(level)], label[len(level) :]
    count = len(label)
    levels = (0, *distinct(level[level > 0]).tolist())
    members = [_Members(row_label, np.flatnonzero(level == k), count) for k in levels]
    members.append(_Members(state_label, np.arange(states), count))
    parts = distinct(row_label)
    parts = parts[members[-1].length[parts] > 0]
    sizes = np.stack([m.length[parts] for m in members], axis=1)
    first, number = distinct_rows(sizes)
    batches = []
    for k, at in enumerate(first.tolist()):
        *own, inside = (m.of(parts[number == k], int(n)) for m, n in zip(members, sizes[at], strict=True))
        batches.append(EqualParts(tuple(own), inside))
    return Components(tuple(batches), row_label, len(level), states)


class _Members:
    """Items by the part they belong to."""

    def __init__(self, label: np.ndarray, items: np.ndarray, parts: int) -> None:
        self.items = items[np.argsort(label[items], kind="stable")]
        self.length = np.bincount(label[items], minlength=parts)
        self.start = np.cumsum(self.length) - self.length

    def of(self, parts: np.ndarray, length: int) -> np.ndarray:
        """(parts, length) members of parts that have as many."""
        return self.items[self.start[parts][:, None] + np.arange(length)]


def _connected(rows: np.ndarray, columns: np.ndarray, m: int, n: int) -> np.ndarray:
    """Labels of the connected components of the graph of rows (0 … m-1) and states (m … m+n-1).

    Small graphs are labelled by passing the least label along all edges, which needs no scipy.
    """
    if m + n > 2000:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        graph = coo_matrix((np.ones(len(rows)), (rows, columns + m)), shape=(m + n, m + n))
        return connected_components(graph, directed=False)[1]
    label = np.arange(m + n)
    while True:
        before = label.copy()
        least = np.minimum(label[rows], label[columns + m])
        np.minimum.at(label, rows, least)
        np.minimum.at(label, columns + m, least)
        if (label == before).all():
            return label


def _lexicographic(levels: list[tuple[np.ndarray, np.ndarray]], x: np.ndarray) -> np.ndarray:
    """The step for a stack of parts; the free directions are kept as projectors.

    Parameters
    ----------
    levels : matrices (parts, rows, n) and residuals (parts, rows), those that count most first
    """
    n = x.shape[1]
    free = np.broadcast_to(np.eye(n), (len(x), n, n))
    d = np.zeros_like(x)
    for matrix, residual in levels:
        if not matrix.shape[1]:
            continue
        inside = _scaled(matrix) @ free
        inverse = _pseudo_inverse(inside)
        rest = (residual + (matrix @ d[..., None])[..., 0]) / _sizes(matrix)
        d = d - (inverse @ rest[..., None])[..., 0]
        free = free - inverse @ inside
    # twice: what rounding has left of a large state in directions that are not free would be missed by the rows
    rest = free @ (free @ (x + d)[..., None])
    return d - rest[..., 0]


def _large(jacobian, residual, levels: list[np.ndarray], states: np.ndarray, count: int) -> np.ndarray:
    """The step for one part with many states, from the sparse conditions of optimality.

    There the rank of a start row is a weight.

    Where the rows leave a choice the step is short (so states stay near zero, where they began). It is a step of
    Levenberg and Marquardt's method: repeated, it meets the start values as closely as can be.
    """
    from scipy.sparse import bmat, coo_matrix, identity
    from scipy.sparse.linalg import splu

    rows, columns, values = jacobian
    size = np.sqrt(np.bincount(rows, values**2, minlength=len(residual)))
    size[size == 0] = 1.0
    place = np.full(count, -1)
    place[states] = np.arange(len(states))

    def part(own: np.ndarray):
        number = np.full(len(residual), -1)
        number[own] = np.arange(len(own))
        used = number[rows] >= 0
        entries = values[used] / size[rows[used]], (number[rows[used]], place[columns[used]])
        return coo_matrix(entries, shape=(len(own), len(states))).tocsr()

    hard, *wishes = levels
    soft = np.concatenate([np.zeros(0, int), *wishes])
    fixed, wished = part(hard), part(soft)
    weight = np.repeat(_LOWER ** np.minimum(np.arange(len(wishes)), _LOWEST), [len(rows) for rows in wishes])
    weighted = wished.T.multiply(weight).tocsr()
    top = weighted @ wished + _SHORT * identity(len(states))
    # the small negative block keeps the matrix regular where fixed rows repeat each other
    matrix = bmat([[top, fixed.T], [fixed, -_REPEATED * identity(len(hard))]]).tocsc()
    right = np.concatenate([-weighted @ (residual[soft] / size[soft]), -residual[hard] / size[hard]])
    return splu(matrix).solve(right)[: len(states)]


def _pseudo_inverse(matrix: np.ndarray) -> np.ndarray:
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    with np.errstate(divide="ignore"):
        inverse = np.where(s > _RANK, 1.0 / s, 0.0)
    return (vt.swapaxes(1, 2) * inverse[:, None, :]) @ u.swapaxes(1, 2)


def _sizes(matrix: np.ndarray) -> np.ndarray:
    """Length of each row, 1 for a row of zeros: rows count alike whatever their units."""
    size = np.sqrt((matrix**2).sum(axis=2))
    return np.where(size > 0, size, 1.0)


def _scaled(matrix: np.ndarray) -> np.ndarray:
    return matrix / _sizes(matrix)[..., None]
