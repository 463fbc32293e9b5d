"""Connected components: which connectors are joined by all connects together."""

from __future__ import annotations

import numpy as np


def components(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Connected components of a graph given by its edges.

    FastSV (Zhang, Azad and Hu 2020): every node points to a smaller one of its component; pointers hook onto the
    smallest grandparents along the edges and are shortened, until they all show the smallest node. A few rounds,
    whatever the size.

    Returns
    -------
    nodes : the distinct end points, ascending
    label : number of the component of each node, in the order of their first nodes
    left, right : the edges as positions in `nodes`
    """
    used = np.zeros(int(max(left.max(), right.max())) + 1, bool)
    used[left] = used[right] = True
    nodes = np.flatnonzero(used)
    number = np.cumsum(used, dtype=np.int32) - 1
    a, b = number[left], number[right]
    parent = np.arange(len(nodes), dtype=np.int32)
    grandparent = parent.copy()
    while True:
        before = grandparent
        for u, v in ((a, b), (b, a)):
            hook = grandparent[v]
            np.minimum.at(parent, parent[u], hook)
            np.minimum.at(parent, u, hook)
        np.minimum(parent, grandparent, out=parent)
        grandparent = parent[parent]
        if np.array_equal(grandparent, before):
            break
    first = grandparent == np.arange(len(nodes))
    return nodes, (np.cumsum(first) - 1)[grandparent], a, b
