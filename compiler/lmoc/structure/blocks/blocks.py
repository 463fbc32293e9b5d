"""Block lower triangular form: which equations must be solved together, and in which order.

Strongly connected components by Tarjan's algorithm (SIAM J. Comput. 1, 1972), iterative, or SciPy's where the graph is
large; levels by peeling the graph of blocks from its sources (Kahn 1962), all blocks of a level at once.
"""

from __future__ import annotations

import numpy as np

from lmoc.structure.index.incidence import pointers, ranges
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass
from lmoc.support.sizes import WITHOUT_SCIPY


@dataclass(frozen=True, eq=False)
class Blocks:
    """Equations in blocks.

    Attributes
    ----------
    block : (equations,) number of the block of each
    size : (blocks,) its number of equations
    level : (blocks,) blocks of level 0 need no other block, those of level n need one of level n-1
    """

    block: np.ndarray
    size: np.ndarray
    level: np.ndarray


def blocks_of(user: np.ndarray, source: np.ndarray, count: int) -> Blocks:
    """Blocks of `count` equations, where equation ``user[i]`` reads what equation ``source[i]`` computes."""
    label = _tarjan(user, source, count) if len(user) <= WITHOUT_SCIPY else _scipy(user, source, count)
    total = int(label.max()) + 1 if count else 0
    a, b = label[user], label[source]
    across = a != b
    bits = total.bit_length()
    edges = distinct(b[across].astype(np.int64) << bits | a[across])
    users, sources = (edges & ((1 << bits) - 1)).astype(INDEX), (edges >> bits).astype(INDEX)
    return Blocks(label, np.bincount(label, minlength=total), _levels(users, sources, total))


def _levels(users: np.ndarray, sources: np.ndarray, count: int) -> np.ndarray:
    """Return the level of each block, given who uses which source; the sources ascend."""
    start = pointers(sources, count)
    waiting = np.bincount(users, minlength=count)
    level = np.zeros(count, INDEX)
    ready, now = np.flatnonzero(waiting == 0), 0
    while len(ready):
        level[ready] = now
        freed = users[ranges(start, ready)].astype(np.int64)  # ufunc.at is fast for equal types only
        np.subtract.at(waiting, freed, 1)
        ready = distinct(freed[waiting[freed] == 0])
        now += 1
    return level


def _scipy(user: np.ndarray, source: np.ndarray, count: int) -> np.ndarray:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    graph = csr_matrix((np.ones(len(user), np.int8), (user, source)), (count, count))
    result: np.ndarray = connected_components(graph, directed=True, connection="strong")[1]
    return result


def _tarjan(user: np.ndarray, source: np.ndarray, count: int) -> np.ndarray:
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for a, b in zip(user.tolist(), source.tolist(), strict=True):
        if a != b:
            neighbours[a].append(b)
    index, low, label = [-1] * count, [0] * count, [-1] * count
    visited = components = 0
    path: list[int] = []  # Tarjan's stack
    for root in range(count):
        if index[root] >= 0:
            continue
        work = [(root, iter(neighbours[root]))]
        index[root] = low[root] = visited
        visited += 1
        path.append(root)
        while work:
            node, rest = work[-1]
            for nxt in rest:
                if index[nxt] < 0:
                    index[nxt] = low[nxt] = visited
                    visited += 1
                    path.append(nxt)
                    work.append((nxt, iter(neighbours[nxt])))
                    break
                if label[nxt] < 0:
                    low[node] = min(low[node], index[nxt])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:
                    while True:
                        member = path.pop()
                        label[member] = components
                        if member == node:
                            break
                    components += 1
    return np.array(label, INDEX)
