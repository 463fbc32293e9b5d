"""Layout of a one-dimensional arrangement: nodes along a line, elements between them in rows, nothing crossing.

A node is a bar across the line, an element a segment along it: a visibility representation (Tamassia and Tollis,
Discrete and Computational Geometry 1, 1986). Places along the line are longest paths. Rows are found chain by chain,
each in the row with the least conflicts, and improved by exchange, which finds the rows without conflict in scenes as
people draw them; planar graphs have such rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np

from lmoc.support.records import dataclass
from lmoc.view.scene.columns import BETWEEN, separated
from lmoc.view.scene.columns import along as _along

MOST_IMPROVED = 60  # elements; with more, the first rows found are kept
MOST_EXCHANGED = 16  # chains
MOST_PERMUTED = 7  # chains
CONFLICT = 1000.0
SLIGHT = 0.5  # what the middle of a bar may cost more than its end


@dataclass(frozen=True)
class RowSegment:
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
    crossing : segments without which none would be left
    """

    along: dict[int, float]
    row: tuple[float, ...]
    span: dict[int, tuple[float, float]]
    turned: frozenset[int]
    conflicts: int
    crossing: tuple[int, ...] = ()

    def backwards(self) -> Rows:
        """Return the layout in which everything runs the other way."""
        along = {node: -place for node, place in self.along.items()}
        return replace(self, along=along, turned=frozenset(range(len(self.row))) - self.turned)


def lay_out(nodes: Sequence[int], half: Mapping[int, float], segments: Sequence[RowSegment]) -> Rows:
    """Return the layout.

    Parameters
    ----------
    nodes : in the order in which they are preferred on the left
    half : {node: half of its extent along the line}
    """
    return _laid_out(tuple(nodes), tuple(half[n] for n in nodes), tuple(segments))


@lru_cache(maxsize=64)  # a strip is laid out several times before it is known how it is drawn
def _laid_out(nodes: tuple[int, ...], halves: tuple[float, ...], segments: tuple[RowSegment, ...]) -> Rows:
    half = dict(zip(nodes, halves, strict=True))
    turned = _turned(nodes, segments)
    directed = [(s.b, s.a, s.length) if k in turned else (s.a, s.b, s.length) for k, s in enumerate(segments)]
    along = _along(nodes, half, directed)
    search = _Search(nodes, half, directed, along)
    row = search.run()
    if search.conflicts(row):
        along = separated(nodes, half, directed, along, row, search.spans(row))
        search = _Search(nodes, half, directed, along)
    crossing = search.crossing(row)
    return Rows(along, row, search.spans(row), frozenset(turned), search.conflicts(row), crossing)


def _turned(nodes: Sequence[int], segments: Sequence[RowSegment]) -> set[int]:
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


class _Search:
    def __init__(self, nodes, half, directed, along) -> None:
        self.nodes, self.directed = nodes, directed
        self.at: dict[int, list[int]] = {n: [] for n in nodes}
        for k, (a, b, _) in enumerate(directed):
            self.at[a].append(k)
            self.at[b].append(k)
        x, wide = np.array([along[n] for n in nodes]), np.array([half[n] for n in nodes])
        number = {n: i for i, n in enumerate(nodes)}
        first = np.array([number[a] for a, _, _ in directed], int)
        last = np.array([number[b] for _, b, _ in directed], int)
        self.meets = np.zeros((len(nodes), len(directed)), bool)  # node, segment
        self.meets[first, np.arange(len(directed))] = self.meets[last, np.arange(len(directed))] = True
        self.side_by_side = np.maximum(x[first][:, None], x[first]) < np.minimum(x[last][:, None], x[last])
        self.side_by_side &= ~np.eye(len(directed), dtype=bool)
        self.passes = (x[first] < x[:, None]) & (x[:, None] < x[last]) & ~self.meets
        self.near = np.abs(x[:, None] - x) < wide[:, None] + wide + BETWEEN
        self.near &= ~np.eye(len(nodes), dtype=bool)

    def run(self) -> tuple[float, ...]:
        row = np.full(len(self.directed), np.nan)
        chains = self._chains()
        for chain in chains:
            self._place(row, chain)
        if len(row) <= MOST_IMPROVED:
            for _ in range(3 if len(chains) <= MOST_EXCHANGED else 1):
                before = self.cost(row)
                for chain in chains:
                    self._place(row, chain)
                if len(chains) <= MOST_EXCHANGED:
                    self._exchange(row, chains)
                if self.cost(row) >= before:
                    break
            if self.cost(row) >= CONFLICT and len(chains) <= MOST_PERMUTED:
                self._permute(row, chains)
            self._centre(row, chains)
        lowest = row.min() if len(row) else 0.0
        return tuple((row - lowest).tolist())

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

    def _place(self, row: np.ndarray, chain: list[int]) -> None:
        """Move a chain to its best row."""
        others = np.delete(row, chain)
        given = others[~np.isnan(others)]
        low, high = (int(given.min()), int(given.max())) if len(given) else (0, 0)
        candidates = sorted(range(low - 1, high + 2), key=lambda r: (r < 0, abs(r)))
        best = None
        for r in candidates:
            row[chain] = r
            value = self.cost(row)
            if best is None or value < best[0] - 1e-9:
                best = value, r
        row[chain] = best[1]

    def _exchange(self, row: np.ndarray, chains: list[list[int]]) -> None:
        before = self.cost(row)
        for one, other in combinations(chains, 2):
            kept = row.copy()
            r, s = row[one[0]], row[other[0]]
            row[one], row[other] = s, r
            value = self.cost(row)
            if value >= before - 1e-9:
                row[:] = kept
            else:
                before = value

    def _permute(self, row: np.ndarray, chains: list[list[int]]) -> None:
        """Give each chain a row of its own, in the best of all orders."""
        best = self.cost(row), row.copy()
        for order in permutations(range(len(chains))):
            for chain, r in zip(chains, order, strict=True):
                row[chain] = r
            value = self.cost(row)
            if value < best[0] - 1e-9:
                best = value, row.copy()
        row[:] = best[1]

    def _centre(self, row: np.ndarray, chains: list[list[int]]) -> None:
        """Move chains that are alone between two nodes to the middle of the wider one."""
        for chain in chains:
            first, last = self.directed[chain[0]][0], self.directed[chain[-1]][1]
            others = [[row[j] for j in self.at[n] if j not in chain] for n in (first, last)]
            middles = {(min(o) + max(o)) / 2 for o in others if o}
            before, kept = self.cost(row), row.copy()
            for middle in sorted(middles, key=lambda m: abs(m - kept[chain[0]])):
                row[chain] = middle
                if self.cost(row) <= before + SLIGHT:
                    break
                row[:] = kept

    def spans(self, row: Sequence[float]) -> dict[int, tuple[float, float]]:
        """Return the rows that each node reaches over."""
        low, high, _ = self._reach(np.asarray(row, float))
        return dict(zip(self.nodes, zip(low.tolist(), high.tolist(), strict=True), strict=True))

    def _reach(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first and the last row of each node, and whether it has any."""
        if not len(row):
            return np.zeros(len(self.nodes)), np.zeros(len(self.nodes)), np.zeros(len(self.nodes), bool)
        low = np.fmin.reduce(np.where(self.meets, row, np.inf), axis=1)  # which passes over NaN
        high = np.fmax.reduce(np.where(self.meets, row, -np.inf), axis=1)
        any_row = low <= high
        return np.where(any_row, low, 0.0), np.where(any_row, high, 0.0), any_row

    def _overlaps(
        self, row: np.ndarray, reach: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pairs that overlap: segments and segments, nodes and segments, nodes and nodes."""
        low, high, any_row = reach or self._reach(row)
        with np.errstate(invalid="ignore"):
            segments = self.side_by_side & (np.abs(row[:, None] - row) < 1)
            bars = self.passes & (low[:, None] - 1 < row) & (row < high[:, None] + 1)
        apart = np.maximum(low[:, None], low) - np.minimum(high[:, None], high)
        return segments, bars, self.near & any_row[:, None] & any_row & (apart < 1)

    def conflicts(self, row: Sequence[float]) -> int:
        segments, bars, nodes = self._overlaps(np.asarray(row, float))
        return int(segments.sum() // 2 + bars.sum() + nodes.sum() // 2)

    def crossing(self, row: Sequence[float]) -> tuple[int, ...]:
        """Return segments without which nothing overlaps, those first that are in the way most often."""
        own, found = np.array(row, float), []
        while True:
            segments, bars, nodes = self._overlaps(own)
            blame = segments.sum(axis=0) + bars.sum(axis=0) + 0.5 * (self.meets.T @ nodes.sum(axis=0))
            blame = np.where(np.isnan(own), 0.0, blame)
            if not len(blame) or not blame.any():
                return tuple(found)
            found.append(int(blame.argmax()))
            own[found[-1]] = np.nan

    def cost(self, row: np.ndarray) -> float:
        low, high, _ = reach = self._reach(row)
        segments, bars, nodes = self._overlaps(row, reach)
        total = 2 * float((high - low).sum()) + 0.01 * float(np.nansum(np.abs(row)))
        return total + CONFLICT * (segments.sum() / 2 + bars.sum() + nodes.sum() / 2)
