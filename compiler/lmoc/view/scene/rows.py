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
from itertools import combinations, islice, permutations

import numpy as np

from lmoc.support.records import dataclass
from lmoc.view.scene.columns import BETWEEN, separated
from lmoc.view.scene.columns import along as _along

MOST_IMPROVED = 60  # elements; with more, the first rows found are kept
MOST_EXCHANGED = 16  # chains
MOST_PERMUTED = 7  # chains
CONFLICT = 1000.0
LEAST_GAIN = 1e-9  # of a cost: what is less is rounding
TOGETHER = 512  # arrangements whose costs are found at once
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
        own = np.eye(len(nodes), dtype=bool)
        meets = own[:, first] | own[:, last]  # node, segment
        side_by_side = np.maximum(x[first][:, None], x[first]) < np.minimum(x[last][:, None], x[last])
        passes = (x[first] < x[:, None]) & (x[:, None] < x[last]) & ~meets
        near = np.abs(x[:, None] - x) < wide[:, None] + wide + BETWEEN
        self.side_by_side = np.nonzero(np.triu(side_by_side, 1))  # pairs of segments
        self.passes = np.nonzero(passes)  # nodes and the segments that pass them
        self.near = np.nonzero(np.triu(near, 1))  # pairs of nodes
        of_node, self.met = np.nonzero(meets)
        self.joined, self.first_met, self.met_by = np.unique(of_node, return_index=True, return_counts=True)

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
        rows = np.repeat(row[None], len(candidates), axis=0)
        rows[:, chain] = np.array(candidates, float)[:, None]
        best = 0
        costs = self.costs(rows)
        for k, value in enumerate(costs.tolist()):
            if value < costs[best] - LEAST_GAIN:
                best = k
        row[:] = rows[best]

    def _exchange(self, row: np.ndarray, chains: list[list[int]]) -> None:
        """Exchange the rows of two chains wherever that is better, one pair after the other."""
        pairs = list(combinations(chains, 2))
        while pairs:
            rows = np.repeat(row[None], len(pairs), axis=0)
            for own, (one, other) in zip(rows, pairs, strict=True):
                own[one], own[other] = row[other[0]], row[one[0]]
            better = np.flatnonzero(self.costs(rows) < self.cost(row) - LEAST_GAIN)
            if not len(better):
                return
            row[:] = rows[better[0]]
            pairs = pairs[better[0] + 1 :]

    def _permute(self, row: np.ndarray, chains: list[list[int]]) -> None:
        """Give each chain a row of its own, in the best of all orders."""
        chain_of = np.zeros(len(row), int)
        for k, chain in enumerate(chains):
            chain_of[chain] = k
        best, every = (self.cost(row), row.copy()), permutations(range(len(chains)))
        for orders in iter(lambda: list(islice(every, TOGETHER)), []):
            rows = np.array(orders, float)[:, chain_of]
            for value, own in zip(self.costs(rows).tolist(), rows, strict=True):
                if value < best[0] - LEAST_GAIN:
                    best = value, own
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
        low, high, _ = self._reach(np.array([row], float))
        return dict(zip(self.nodes, zip(low[0].tolist(), high[0].tolist(), strict=True), strict=True))

    def _reach(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first and the last row of each node in each of several arrangements, and whether it has any."""
        low = np.full((len(rows), len(self.nodes)), np.inf)
        high = -low
        if len(self.met):
            met = rows[:, self.met]
            low[:, self.joined] = np.fmin.reduceat(met, self.first_met, axis=1)  # which passes over NaN
            high[:, self.joined] = np.fmax.reduceat(met, self.first_met, axis=1)
        any_row = low <= high
        return np.where(any_row, low, 0.0), np.where(any_row, high, 0.0), any_row

    def _overlaps(
        self, rows: np.ndarray, reach: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of the pairs of segments, nodes and segments, nodes overlap in each of several arrangements."""
        low, high, any_row = reach
        one, other = self.side_by_side
        segments = np.abs(rows[:, one] - rows[:, other]) < 1
        node, segment = self.passes
        own = rows[:, segment]
        bars = (low[:, node] - 1 < own) & (own < high[:, node] + 1)
        one, other = self.near
        touch = np.maximum(low[:, one], low[:, other]) < 1 + np.minimum(high[:, one], high[:, other])
        return segments, bars, touch & any_row[:, one] & any_row[:, other]

    def conflicts(self, row: Sequence[float]) -> int:
        rows = np.array([row], float)
        return sum(int(found.sum()) for found in self._overlaps(rows, self._reach(rows)))

    def crossing(self, row: Sequence[float]) -> tuple[int, ...]:
        """Return segments without which nothing overlaps, those first that are in the way most often."""
        own, found = np.array(row, float), []
        while True:
            segments, bars, nodes = (f[0] for f in self._overlaps(own[None], self._reach(own[None])))
            blame = sum(np.bincount(side[segments], minlength=len(own)) for side in self.side_by_side)
            blame = blame + np.bincount(self.passes[1][bars], minlength=len(own))
            at_nodes = sum(np.bincount(side[nodes], minlength=len(self.nodes)) for side in self.near)
            blame = blame + 0.5 * np.bincount(self.met, np.repeat(at_nodes[self.joined], self.met_by), len(own))
            blame = np.where(np.isnan(own), 0.0, blame)
            if not len(blame) or not blame.any():
                return tuple(found)
            found.append(int(blame.argmax()))
            own[found[-1]] = np.nan

    def cost(self, row: np.ndarray) -> float:
        return float(self.costs(row[None])[0])

    def costs(self, rows: np.ndarray) -> np.ndarray:
        """Return what each of several arrangements costs."""
        low, high, _ = reach = self._reach(rows)
        found = self._overlaps(rows, reach)
        total = 2 * (high - low).sum(axis=1) + 0.01 * np.nansum(np.abs(rows), axis=1)
        return total + CONFLICT * sum(pairs.sum(axis=1) for pairs in found)
