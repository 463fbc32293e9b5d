"""Maximum matchings of equations with unknowns.

Rows and columns with one entry are matched first, again and again (Karp and Sipser 1981): no maximum matching is lost,
and little is left in practice. What remains is matched along augmenting paths (Hopcroft and Karp 1973, in SciPy) or,
where it is small, by depth-first searches of our own (Pothen and Fan, ACM Trans. Math. Softw. 16, 1990), so that small
models do without SciPy.
"""

from __future__ import annotations

import numpy as np

from lmoc.structure.index.incidence import Incidence
from lmoc.support.distinct import distinct, first_of_each
from lmoc.support.indices import INDEX
from lmoc.support.sizes import WITHOUT_SCIPY


def forced_pairs(incidence: Incidence) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Match rows and columns that have one partner left, until none has.

    Returns
    -------
    match : (rows,) column of each row, -1 where undecided
    rows_left, columns_left : sorted numbers of what is still to be matched; those without any entry left are among them
    """
    row_alive, column_alive = np.ones(incidence.rows, bool), np.ones(incidence.columns, bool)
    match = np.full(incidence.rows, -1, INDEX)
    # the sum of a line's living partners is its partner when there is one left
    row_count = np.bincount(incidence.row, minlength=incidence.rows)
    row_sum = np.bincount(incidence.row, incidence.column, incidence.rows).astype(np.int64)
    column_count = np.bincount(incidence.column, minlength=incidence.columns)
    column_sum = np.bincount(incidence.column, incidence.row, incidence.columns).astype(np.int64)
    row_of, column_of = incidence.row, incidence.column
    new_columns, new_rows = np.flatnonzero(column_count == 1), np.flatnonzero(row_count == 1)
    while len(new_columns) or len(new_rows):
        if len(new_columns):
            columns = new_columns[column_alive[new_columns] & (column_count[new_columns] == 1)]
            rows, first = first_of_each(column_sum[columns])
            columns = columns[first]
        else:
            rows = new_rows[row_alive[new_rows] & (row_count[new_rows] == 1)]
            columns, first = first_of_each(row_sum[rows])
            rows = rows[first]
        match[rows] = columns
        row_alive[rows] = column_alive[columns] = False
        entries = incidence.of_rows(rows)
        touched = column_of[entries].astype(np.int64)  # ufunc.at is fast for equal types only
        np.subtract.at(column_count, touched, 1)
        np.subtract.at(column_sum, touched, row_of[entries].astype(np.int64))
        entries = incidence.of_columns(columns)
        row_touched = row_of[entries].astype(np.int64)
        np.subtract.at(row_count, row_touched, 1)
        np.subtract.at(row_sum, row_touched, column_of[entries].astype(np.int64))
        pending_rows = np.concatenate([new_rows, row_touched]) if len(new_columns) else row_touched
        new_columns = distinct(touched[column_alive[touched] & (column_count[touched] == 1)])
        alive = row_alive[pending_rows] & (row_count[pending_rows] == 1)
        new_rows = distinct(pending_rows[alive])
    return match, np.flatnonzero(row_alive), np.flatnonzero(column_alive)


def maximum_matching(incidence: Incidence) -> np.ndarray:
    """Column of each row in a matching with as many pairs as possible, -1 where there is none."""
    match, rows, columns = forced_pairs(incidence)
    if len(rows) and len(columns):
        rest = incidence.submatrix(rows, columns)
        found = _search(rest) if len(rest.row) <= WITHOUT_SCIPY else _hopcroft_karp(rest)
        match[rows] = np.where(found >= 0, columns[found], -1)
    return match


def _hopcroft_karp(incidence: Incidence) -> np.ndarray:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import maximum_bipartite_matching

    ones = np.ones(len(incidence.row), np.int8)
    graph = csr_matrix((ones, incidence.column, incidence.start), (incidence.rows, incidence.columns))
    result: np.ndarray = maximum_bipartite_matching(graph, perm_type="column").astype(INDEX)
    return result


def _search(incidence: Incidence) -> np.ndarray:
    """Augmenting paths by depth-first search, in phases: within one no column is visited twice."""
    start, column = incidence.start.tolist(), incidence.column.tolist()
    neighbours = [column[a:b] for a, b in zip(start, start[1:], strict=False)]
    owner = [-1] * incidence.columns
    roots = []
    for root in range(incidence.rows):
        free = next((c for c in neighbours[root] if owner[c] < 0), None)
        if free is not None:
            owner[free] = root
        else:
            roots.append(root)
    found = True
    while found:  # a phase without success has seen all that can be reached
        seen: set[int] = set()
        left = [root for root in roots if not _augment(root, neighbours, owner, seen)]
        found = len(left) < len(roots)
        roots = left
    match = np.full(incidence.rows, -1, INDEX)
    for c, r in enumerate(owner):
        if r >= 0:
            match[r] = c
    return match


def _augment(root: int, neighbours: list[list[int]], owner: list[int], seen: set[int]) -> bool:
    """Match a free row along an augmenting path through columns not seen yet; False where there is none."""
    path: list[tuple[int, int]] = []  # (row, the column it asks for)
    stack = [(root, iter(neighbours[root]))]
    while stack:
        row, rest = stack[-1]
        asked = next((c for c in rest if c not in seen), None)
        if asked is None:
            stack.pop()
            if path:
                path.pop()
            continue
        seen.add(asked)
        path.append((row, asked))
        if owner[asked] < 0:
            for r, c in path:
                owner[c] = r
            return True
        stack.append((owner[asked], iter(neighbours[owner[asked]])))
    return False
