"""Spanning trees of overdetermined connectors (Modelica specification, 9.4.2).

Nodes are the overdetermined records of connectors. A `branch` is an edge that is needed, a `connect` one that may be
broken. Each tree has one root; where two trees, or two ends of one tree, are connected, the connect is broken.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.support.records import dataclass


@dataclass(frozen=True)
class Forest:
    """The trees.

    Attributes
    ----------
    broken : connects, by their number, that belong to no tree
    redundant : those of them whose ends are joined by other connects: they say nothing further
    roots : the nodes that are roots
    depth : how many edges lie between each node and its root; -1 where there is no root
    """

    broken: tuple[int, ...]
    redundant: frozenset[int]
    roots: frozenset[int]
    depth: tuple[int, ...]


class Impossible(Exception):
    """There is no such tree: why, and the number of the branch, root or node that shows it."""

    def __init__(self, why: str, number: int):
        super().__init__(why)
        self.why = why
        self.number = number


class _Sets:
    """Disjoint sets of nodes."""

    def __init__(self, count: int):
        self.up = list(range(count))

    def find(self, node: int) -> int:
        while self.up[node] != node:
            self.up[node] = self.up[self.up[node]]
            node = self.up[node]
        return node

    def join(self, a: int, b: int) -> bool:
        """Join two sets; False where they are one already."""
        a, b = self.find(a), self.find(b)
        self.up[max(a, b)] = min(a, b)
        return a != b


def forest(
    count: int,
    branches: Sequence[tuple[int, int]],
    connects: Sequence[tuple[int, int]],
    roots: Sequence[int],
    potential: Sequence[tuple[int, int]],
) -> Forest:
    """Return the spanning trees of `count` nodes.

    Parameters
    ----------
    roots : nodes that must be roots
    potential : (priority, node): in a tree without root, the first one with the smallest priority becomes it

    Raises
    ------
    Impossible
        "circle" of branches (the number of one), "roots" that branches join (the number of the second one), "rootless"
        (a node of a tree in which nothing can be the root).
    """
    sets, rooted = _Sets(count), {}
    for k, (a, b) in enumerate(branches):
        if not sets.join(a, b):
            raise Impossible("circle", k)
    for k, node in enumerate(roots):
        if rooted.setdefault(sets.find(node), node) != node:
            raise Impossible("roots", k)
    kept, broken, joined = list(branches), [], _Sets(count)
    for k, (a, b) in enumerate(connects):
        ends = [rooted.pop(end, None) for end in {sets.find(a), sets.find(b)}]
        found = [root for root in ends if root is not None]
        if len(ends) == 1 or len(found) == 2:
            rooted.update((sets.find(root), root) for root in found)
            broken.append(k)
            continue
        sets.join(a, b)
        rooted.update((sets.find(root), root) for root in found)
        kept.append((a, b))
        joined.join(a, b)
    for _, node in sorted(potential, key=lambda pair: pair[0]):
        rooted.setdefault(sets.find(node), node)
    edges = (*kept[len(branches) :], *branches)
    lonely = next((a for edge in edges for a in edge if sets.find(a) not in rooted), None)
    if lonely is not None:
        raise Impossible("rootless", lonely)
    redundant = frozenset(k for k in broken if joined.find(connects[k][0]) == joined.find(connects[k][1]))
    return Forest(tuple(broken), redundant, frozenset(rooted.values()), _depths(count, kept, rooted.values()))


def _depths(count: int, edges: Sequence[tuple[int, int]], roots) -> tuple[int, ...]:
    near: list[list[int]] = [[] for _ in range(count)]
    for a, b in edges:
        near[a].append(b)
        near[b].append(a)
    depth = [-1] * count
    pending = list(roots)
    for root in pending:
        depth[root] = 0
    for node in pending:  # which grows
        for other in near[node]:
            if depth[other] < 0:
                depth[other] = depth[node] + 1
                pending.append(other)
    return tuple(depth)
