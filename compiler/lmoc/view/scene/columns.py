"""Places along the line: longest paths, and more room where what is drawn in rows would overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

BETWEEN = 4.0  # px between two bars, at least
ROUNDS = 40

Constraint = tuple[int, int, float]  # from a node to one on its right: px between their outlines, at least


def along(
    nodes: Sequence[int], half: Mapping[int, float], directed: Sequence[tuple[int, int, float]]
) -> dict[int, float]:
    """Longest paths from the left; what nothing holds on the left moves to its neighbour on the right."""
    before: dict[int, list[tuple[int, float]]] = {n: [] for n in nodes}
    after: dict[int, list[tuple[int, float]]] = {n: [] for n in nodes}
    for a, b, length in directed:
        before[b].append((a, half[a] + length + half[b]))
        after[a].append((b, half[a] + length + half[b]))
    waiting = {n: len(before[n]) for n in nodes}
    order = [n for n in nodes if not waiting[n]]
    for n in order:
        for b, _ in after[n]:
            waiting[b] -= 1
            if not waiting[b]:
                order.append(b)
    place: dict[int, float] = {}
    for n in order:
        place[n] = max((place[a] + w for a, w in before[n]), default=0.0)
    for n in reversed(order):
        if not before[n] and after[n]:
            place[n] = min(place[b] - w for b, w in after[n])
    return place


def separated(
    nodes: Sequence[int],
    half: Mapping[int, float],
    directed: Sequence[Constraint],
    place: Mapping[int, float],
    row: Sequence[float],
    spans: Mapping[int, tuple[float, float]],
) -> dict[int, float]:
    """Return places where less overlaps: what is in the way in a row moves beyond its end, if the order permits.

    Parameters
    ----------
    place : as of `along`
    row : of each segment
    spans : {node: the rows that it reaches over}
    """
    order = _Order(nodes, directed)
    found: list[Constraint] = list(directed)
    place = dict(place)
    for _ in range(ROUNDS):
        more = [*_bars(nodes, half, place, spans, order), *_segments(directed, place, row, spans, order, nodes)]
        if not more:
            break
        found += more
        place = along(nodes, half, found)
    return place


class _Order:
    """Which nodes are on the left of which, as far as that is decided."""

    def __init__(self, nodes: Sequence[int], directed: Sequence[Constraint]) -> None:
        self.bit = {n: 1 << i for i, n in enumerate(nodes)}
        self.after = {n: self.bit[n] for n in nodes}  # each node, and those on its right
        for a, b, _ in directed:
            self.decide(a, b)

    def decide(self, a: int, b: int) -> bool:
        """Put a node on the left of another; returns whether that is possible."""
        if self.after[b] & self.bit[a]:
            return False
        for n, reached in self.after.items():
            if reached & self.bit[a]:
                self.after[n] = reached | self.after[b]
        return True


def _bars(nodes, half, place, spans, order: _Order) -> list[Constraint]:
    """Keep nodes apart that reach over the same rows."""
    found = []
    known = sorted(nodes, key=lambda n: place[n])
    for i, n in enumerate(known):
        for m in known[i + 1 :]:
            if place[m] - place[n] >= half[n] + half[m] + BETWEEN:
                continue
            if max(spans[n][0], spans[m][0]) - min(spans[n][1], spans[m][1]) < 1:
                if order.decide(n, m):
                    found.append((n, m, BETWEEN + 1.0))
                elif order.decide(m, n):
                    found.append((m, n, BETWEEN + 1.0))
    return found


def _segments(directed, place, row, spans, order: _Order, nodes) -> list[Constraint]:
    """Keep segments apart from each other and from the nodes that they do not meet."""
    found = []

    def one_of(*pairs: tuple[int, int]) -> None:
        for a, b in sorted(pairs, key=lambda p: place[p[0]] - place[p[1]]):
            if order.decide(a, b) or a == b:
                found.append((a, b, BETWEEN + 1.0))
                return

    for k, (a, b, _) in enumerate(directed):
        for j, (c, d, _) in enumerate(directed[:k]):
            if abs(row[j] - row[k]) < 1 and max(place[a], place[c]) < min(place[b], place[d]):
                if b != c and d != a and a != c and b != d:
                    one_of((b, c), (d, a))
        for n in nodes:
            low, high = spans[n]
            if n not in (a, b) and place[a] < place[n] < place[b] and low - 1 < row[k] < high + 1:
                one_of((n, a), (b, n))
    return found
