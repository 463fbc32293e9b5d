"""How often each equation must be differentiated: the Σ-method (J. D. Pryce, BIT 41, 2001).

A highest-value transversal of the signature matrix (an assignment of equations to unknowns whose derivative orders
have the largest sum) gives the number of degrees of freedom; its smallest dual solution gives the offsets: equation i
is differentiated ``c[i]`` times, unknown j occurs up to order ``d[j]``.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np

from lmoc.structure.incidence import Incidence
from lmoc.structure.matching import forced_pairs

# rows up to which the assignment is found in Python
SMALL = 500


def highest_value_transversal(incidence: Incidence) -> np.ndarray | None:
    """Column of each row in an assignment with the largest sum of orders; None where there is no assignment."""
    if incidence.rows != incidence.columns:
        return None
    match, rows, columns = forced_pairs(incidence)
    if len(rows) != len(columns):
        return None
    if len(rows):
        core = incidence.submatrix(rows, columns)
        found = _assign(core) if core.rows <= SMALL else _assign_large(core)
        if found is None:
            return None
        match[rows] = columns[found]
    return match


def _assign_large(core: Incidence) -> np.ndarray | None:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    # an order of 0 is an entry too, but an explicit zero would be dropped
    weight = (core.order + 1).astype(float)
    graph = csr_matrix((weight, core.column, core.start), (core.rows, core.columns))
    try:
        rows, columns = min_weight_full_bipartite_matching(graph, maximize=True)
    except ValueError:
        return None
    match = np.empty(core.rows, np.int64)
    match[rows] = columns
    return match


def _assign(core: Incidence) -> np.ndarray | None:
    """Successive shortest paths with potentials (Edmonds and Karp 1972; Tomizawa 1971)."""
    start, column, order = core.start.tolist(), core.column.tolist(), core.order.tolist()
    entries = [list(zip(column[a:b], order[a:b], strict=False)) for a, b in zip(start, start[1:], strict=False)]
    if not all(entries):
        return None
    row_price = [max(w for _, w in row) for row in entries]
    column_price = [0] * core.columns
    owner, match = [-1] * core.columns, [-1] * core.rows
    for i, row in enumerate(entries):
        for j, w in row:
            if owner[j] < 0 and w == row_price[i]:
                owner[j], match[i] = i, j
                break
    for i in range(core.rows):
        if match[i] < 0 and not _shortest_path(i, entries, row_price, column_price, owner, match):
            return None
    return np.array(match, np.int64)


def _shortest_path(
    root: int,
    entries: list[list[tuple[int, int]]],
    row_price: list[int],
    column_price: list[int],
    owner: list[int],
    match: list[int],
) -> bool:
    """Match one more row along the cheapest augmenting path (Dijkstra over reduced costs); False: there is none."""
    distance: dict[int, int] = {}  # of columns
    source: dict[int, int] = {}
    done: dict[int, int] = {}
    heap: list[tuple[int, int]] = []
    row, base = root, 0
    while True:
        for j, w in entries[row]:
            new = base + row_price[row] + column_price[j] - w
            if j not in done and new < distance.get(j, 1 << 60):
                distance[j], source[j] = new, row
                heappush(heap, (new, j))
        while heap and heap[0][1] in done:
            heappop(heap)
        if not heap:
            return False
        base, j = heappop(heap)
        done[j] = base
        if owner[j] < 0:
            break
        row = owner[j]
    for k, at in done.items():
        if k != j:
            row_price[owner[k]] -= base - at
            column_price[k] += base - at
    row_price[root] -= base
    while True:
        row = source[j]
        previous = match[row]
        owner[j], match[row] = row, j
        if row == root:
            return True
        j = previous


def offsets(incidence: Incidence, match: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest offsets, by Pryce's fixed-point iteration over the rows that still change.

    Parameters
    ----------
    match : a highest-value transversal
    lower : (columns,) orders that are needed whatever the equations say (a velocity that somebody wants to see)

    Returns
    -------
    c : (rows,) times each equation is differentiated
    d : (columns,) highest order of each unknown
    """
    c, d = np.zeros(incidence.rows, np.int64), lower.astype(np.int64)
    np.maximum.at(d, incidence.column, incidence.order)
    matched = match[incidence.row] == incidence.column
    own = np.zeros(incidence.rows, np.int64)
    own[incidence.row[matched]] = incidence.order[matched]
    row_of = np.empty(incidence.columns, np.int64)
    row_of[match] = np.arange(incidence.rows)
    rows = np.arange(incidence.rows)
    while True:
        new = d[match[rows]] - own[rows]
        changed = new > c[rows]
        rows, new = rows[changed], new[changed]
        if not len(rows):
            return c, d
        c[rows] = new
        entries = incidence.of_rows(rows)
        columns = incidence.column[entries]
        needed = incidence.order[entries] + c[incidence.row[entries]]
        raised = needed > d[columns]
        np.maximum.at(d, columns[raised], needed[raised])
        rows = row_of[np.unique(columns[raised])]
