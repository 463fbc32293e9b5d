"""Layout of a one-dimensional arrangement: nodes along a line, elements between them in rows, nothing crossing.

A node is a bar across the line, an element a segment along it: a visibility representation (Tamassia and Tollis,
Discrete and Computational Geometry 1, 1986). Places along the line are longest paths. Rows are found chain by chain,
each in the row with the least conflicts, and improved by exchange, which finds the rows without conflict in scenes as
people draw them; planar graphs have such rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, permutations

from lmoc.support.records import dataclass

MOST_IMPROVED = 60  # elements; with more, the first rows found are kept
MOST_PERMUTED = 7  # chains
CONFLICT = 1000.0
SLIGHT = 0.5  # what the middle of a bar may cost more than its end


@dataclass(frozen=True)
class Segment:
    """An element between two nodes, from left to right as its ports say, at least `length` long."""

    a: int
    b: int
    length: float


@dataclass(frozen=True)
class Rows:
    """Where everything is.

    Attributes
    ----------
    along : {node: place of its middle along the line}
    row : for each segment its row; halves occur
    span : {node: (first row, last row)}
    turned : segments that run from right to left
    conflicts : overlaps that are left
    """

    along: dict[int, float]
    row: tuple[float, ...]
    span: dict[int, tuple[float, float]]
    turned: frozenset[int]
    conflicts: int


def lay_out(nodes: Sequence[int], half: Mapping[int, float], segments: Sequence[Segment]) -> Rows:
    """Return the layout.

    Parameters
    ----------
    nodes : in the order in which they are preferred on the left
    half : {node: half of its extent along the line}
    """
    turned = _turned(nodes, segments)
    directed = [(s.b, s.a, s.length) if k in turned else (s.a, s.b, s.length) for k, s in enumerate(segments)]
    along = _along(nodes, half, directed)
    search = _Search(nodes, half, directed, along)
    row, conflicts = search.run()
    return Rows(along, tuple(row), search.spans(row), frozenset(turned), conflicts)


def _turned(nodes: Sequence[int], segments: Sequence[Segment]) -> set[int]:
    """Segments that would close a directed cycle: those that lead back on a depth-first search."""
    leaving: dict[int, list[int]] = {n: [] for n in nodes}
    entered = set()
    for k, s in enumerate(segments):
        leaving[s.a].append(k)
        entered.add(s.b)
    turned: set[int] = set()
    state = dict.fromkeys(nodes, 0)  # 1 on the way, 2 done
    for start in [*(n for n in nodes if n not in entered), *nodes]:
        if state[start]:
            continue
        state[start] = 1
        stack = [(start, iter(leaving[start]))]
        while stack:
            node, rest = stack[-1]
            k = next(rest, None)
            if k is None:
                state[node] = 2
                stack.pop()
            elif state[segments[k].b] == 1:
                turned.add(k)
            elif state[segments[k].b] == 0:
                state[segments[k].b] = 1
                stack.append((segments[k].b, iter(leaving[segments[k].b])))
    return turned


def _along(nodes: Sequence[int], half: Mapping[int, float], directed: Sequence[tuple[int, int, float]]):
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
    along: dict[int, float] = {}
    for n in order:
        along[n] = max((along[a] + w for a, w in before[n]), default=0.0)
    for n in reversed(order):
        if not before[n] and after[n]:
            along[n] = min(along[b] - w for b, w in after[n])
    return along


class _Search:
    def __init__(self, nodes, half, directed, along) -> None:
        self.nodes, self.half, self.directed, self.along = nodes, half, directed, along
        self.at: dict[int, list[int]] = {n: [] for n in nodes}
        for k, (a, b, _) in enumerate(directed):
            self.at[a].append(k)
            self.at[b].append(k)

    def run(self) -> tuple[list[float], int]:
        row: list[float | None] = [None] * len(self.directed)
        chains = self._chains()
        for chain in chains:
            self._place(row, chain)
        if len(row) <= MOST_IMPROVED:
            for _ in range(3):
                before = self.cost(row)
                for chain in chains:
                    self._place(row, chain)
                self._exchange(row, chains)
                if self.cost(row) >= before:
                    break
            if self.cost(row) >= CONFLICT and len(chains) <= MOST_PERMUTED:
                self._permute(row, chains)
            self._centre(row, chains)
        lowest = min((r for r in row if r is not None), default=0.0)
        found = [float(r - lowest) for r in row]
        return found, int(self.cost(found) // CONFLICT)

    def _chains(self) -> list[list[int]]:
        """Maximal paths through nodes with one segment on each side, the longest extent first."""
        inner = {
            n for n in self.nodes
            if len(self.at[n]) == 2 and {self.directed[k][1] == n for k in self.at[n]} == {True, False}
        }  # fmt: skip
        used: set[int] = set()
        chains = []
        for k in range(len(self.directed)):
            if k in used:
                continue
            chain = [k]
            for end in (0, 1):
                while True:
                    last = chain[-1] if end else chain[0]
                    node = self.directed[last][end]
                    more = [j for j in self.at[node] if j not in chain] if node in inner else []
                    if not more:
                        break
                    chain.insert(len(chain) if end else 0, more[0])
            used.update(chain)
            chains.append(chain)
        return chains

    def _place(self, row: list, chain: list[int]) -> None:
        """Move a chain to its best row."""
        given = [r for k, r in enumerate(row) if r is not None and k not in chain]
        low, high = (int(min(given)), int(max(given))) if given else (0, 0)
        candidates = sorted(range(low - 1, high + 2), key=lambda r: (r < 0, abs(r)))
        best = None
        for r in candidates:
            for k in chain:
                row[k] = r
            value = self.cost(row)
            if best is None or value < best[0] - 1e-9:
                best = value, r
        for k in chain:
            row[k] = best[1]

    def _exchange(self, row: list, chains: list[list[int]]) -> None:
        for one, other in combinations(chains, 2):
            before, kept = self.cost(row), row[:]
            r, s = row[one[0]], row[other[0]]
            for k in one:
                row[k] = s
            for k in other:
                row[k] = r
            if self.cost(row) >= before - 1e-9:
                row[:] = kept

    def _permute(self, row: list, chains: list[list[int]]) -> None:
        """Give each chain a row of its own, in the best of all orders."""
        best = self.cost(row), row[:]
        for order in permutations(range(len(chains))):
            for chain, r in zip(chains, order):
                for k in chain:
                    row[k] = r
            value = self.cost(row)
            if value < best[0] - 1e-9:
                best = value, row[:]
        row[:] = best[1]

    def _centre(self, row: list, chains: list[list[int]]) -> None:
        """Move chains that are alone between two nodes to the middle of the wider one."""
        for chain in chains:
            first, last = self.directed[chain[0]][0], self.directed[chain[-1]][1]
            others = [[row[j] for j in self.at[n] if j not in chain] for n in (first, last)]
            middles = {(min(o) + max(o)) / 2 for o in others if o}
            before, kept = self.cost(row), row[:]
            for middle in sorted(middles, key=lambda m: abs(m - row[chain[0]])):
                for k in chain:
                    row[k] = middle
                if self.cost(row) <= before + SLIGHT:
                    break
                row[:] = kept

    def spans(self, row: Sequence[float | None]) -> dict[int, tuple[float, float]]:
        """Return the rows that each node reaches over."""
        found = {}
        for n in self.nodes:
            rows = [row[k] for k in self.at[n] if row[k] is not None]
            found[n] = (min(rows), max(rows)) if rows else (0.0, 0.0)
        return found

    def cost(self, row: Sequence[float | None]) -> float:
        spans = self.spans(row)
        total = sum(2 * (high - low) for low, high in spans.values())
        placed = [k for k, r in enumerate(row) if r is not None]
        total += 0.01 * sum(abs(row[k]) for k in placed)
        along, half = self.along, self.half
        for i, k in enumerate(placed):
            a, b, _ = self.directed[k]
            for j in placed[:i]:
                c, d, _ = self.directed[j]
                if abs(row[j] - row[k]) < 1 and max(along[a], along[c]) < min(along[b], along[d]):
                    total += CONFLICT
            for n in self.nodes:
                low, high = spans[n]
                if n not in (a, b) and along[a] < along[n] < along[b] and low - 1 < row[k] < high + 1:
                    total += CONFLICT
        bodies = [n for n in self.nodes if any(row[k] is not None for k in self.at[n])]
        for n, m in combinations(bodies, 2):
            near = abs(along[n] - along[m]) < half[n] + half[m] + 4
            if near and max(spans[n][0], spans[m][0]) - min(spans[n][1], spans[m][1]) < 1:
                total += CONFLICT
        return total
