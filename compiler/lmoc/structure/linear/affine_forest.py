"""Spanning forests of the graph whose edges are the rows that tie two variables."""

from __future__ import annotations

from collections import deque

import numpy as np

from lmoc.support.indices import INDEX, counted, positions
from lmoc.support.sizes import WITHOUT_SCIPY

UNUSED, FIRST_IS_CHILD, SECOND_IS_CHILD = 0, 1, 2


def orient(first: np.ndarray, second: np.ndarray, known: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Choose a spanning forest and orient its edges towards the roots.

    Every known node is a root; a component without one is rooted at the node with the lowest (score, number).
    Trees grow breadth first from the roots, so that paths are short.

    Parameters
    ----------
    first, second : (n,) ends of the edges, as node numbers
    known : (nodes,) bool
    score : (nodes,) the lower, the better a root

    Returns
    -------
    (n,) UNUSED for the edges outside the forest, FIRST_IS_CHILD where `second` is the parent, or SECOND_IS_CHILD
    """
    return (_orient_small if len(first) <= WITHOUT_SCIPY else _orient_large)(first, second, known, score)


def _orient_small(first: np.ndarray, second: np.ndarray, known: np.ndarray, score: np.ndarray) -> np.ndarray:
    ends = list(zip(first.tolist(), second.tolist(), strict=True))
    neighbours: dict[int, list[int]] = {}
    for edge, (a, b) in enumerate(ends):
        neighbours.setdefault(a, []).append(edge)
        neighbours.setdefault(b, []).append(edge)
    nodes = np.fromiter(neighbours, np.int64, len(neighbours))
    fixed, marks = known[nodes], score[nodes]
    candidates = nodes[np.lexsort((nodes, marks, ~fixed))].tolist()
    direction = np.zeros(len(ends), np.int8)
    seen: set[int] = set(nodes[fixed].tolist())
    queue = deque(n for n in candidates if n in seen)
    for root in [None, *(n for n in candidates if n not in seen)]:
        if root is not None:
            if root in seen:
                continue
            seen.add(root)
            queue.append(root)
        while queue:
            node = queue.popleft()
            for edge in neighbours[node]:
                a, b = ends[edge]
                other = b if a == node else a
                if other not in seen:
                    seen.add(other)
                    queue.append(other)
                    direction[edge] = FIRST_IS_CHILD if other == a else SECOND_IS_CHILD
    return direction


def _orient_large(first: np.ndarray, second: np.ndarray, known: np.ndarray, score: np.ndarray) -> np.ndarray:
    """The same by one breadth-first search in C from a node tied to all roots."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    met = np.zeros(len(known), bool)
    met[first] = met[second] = True
    nodes = positions(met)
    number = np.empty(len(known), INDEX)
    number[nodes] = counted(0, len(nodes))
    a, b, n = number[first], number[second], len(nodes)
    fixed = known[nodes]
    free = ~(fixed[a] | fixed[b])
    ones = np.ones(int(free.sum()), np.int8)
    _, component = connected_components(csr_matrix((ones, (a[free], b[free])), (n, n)), directed=False)
    settled = np.zeros(component.max() + 1, bool)
    settled[component[fixed]] = True
    for near, far in ((a, b), (b, a)):
        settled[component[near[fixed[far]]]] = True
    key = score[nodes].astype(np.int64) << 32 | counted(0, n)
    best = np.full(len(settled), np.iinfo(np.int64).max)
    np.minimum.at(best, component.astype(np.int64), key)
    chosen = (best & ((1 << 32) - 1)).astype(INDEX)
    roots = np.concatenate([positions(fixed), chosen[~settled]])

    tail = np.concatenate([a, b, np.full(len(roots), n, INDEX)])
    head = np.concatenate([b, a, roots])
    graph = csr_matrix((np.ones(len(tail), np.int8), (tail, head)), (n + 1, n + 1))
    _, parent = breadth_first_order(graph, n, directed=True)
    forward, backward = (parent[a] == b), (parent[b] == a)
    direction = np.zeros(len(a), np.int8)
    # of parallel edges the first only is in the tree: of what is written to one place, the last stays
    used = np.flatnonzero(forward | backward)[::-1]
    edge = np.full(n, -1, INDEX)
    edge[np.where(forward[used], a[used], b[used])] = used
    kept = edge[edge >= 0]
    direction[kept] = np.where(forward[kept], FIRST_IS_CHILD, SECOND_IS_CHILD)
    return direction
