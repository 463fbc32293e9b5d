"""Bars that cannot be put together, whatever their directions: told by lengths and distances.

In a closed polygon no side is longer than all others together. Parts of the library that keep two points at one
distance, and places that do not move, are the edges of a graph; where an edge is longer than the shortest way round it
(Dijkstra, Numer. Math. 1, 1959), no directions of the bars close that loop.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lmoc.ir.flat import Part
from lmoc.ir.normalized import Normalized
from lmoc.messages.diagnostics import Diagnostic
from lmoc.structure.linear.coefficients import KNOWN, kinds_of
from lmoc.structure.messages.equations import listed
from lmoc.support.records import dataclass

_ROOM = 1e-9  # of the longer one: a bar that just fits is left to the search
# two ports, and the parameters that are the distance between them or its components
_BARS = {
    "Planar.Bar": ("a", "b", ("l",)),
    "Planar.Rod": ("a", "b", ("L",)),
    "Planar.Link": ("a", "b", ("rx", "ry")),
    "Planar.PointOf": ("frame", "point", ("rx", "ry")),
}


class _Place(NamedTuple):
    """A point that does not move."""

    x: float
    y: float


class _Moving(NamedTuple):
    """A point that moves: the root, factor and offset of each of its coordinates."""

    x: tuple[int, int, int]
    y: tuple[int, int, int]


_Node = _Place | _Moving


@dataclass(frozen=True, eq=False)
class _Edge:
    """A distance between two points: of a part, or between places that do not move (without a part)."""

    first: _Node
    second: _Node
    length: float
    name: str = ""
    part: Part | None = None


def out_of_reach(normalized: Normalized) -> Diagnostic | None:
    """Return what is too long or too short for a loop to be closed; None where lengths alone do not tell."""
    scene = _Scene(normalized)
    edges = [edge for edge in scene.bars() if np.isfinite(edge.length)]
    grounds = sorted({node for e in edges for node in (e.first, e.second) if isinstance(node, _Place)})
    between = [
        _Edge(a, b, float(np.hypot(a.x - b.x, a.y - b.y))) for k, a in enumerate(grounds) for b in grounds[k + 1 :]
    ]
    for edge in (*between, *edges):
        others = edges if not edge.name else [e for e in (*edges, *between) if e is not edge]
        way = _shortest(others, edge.first, edge.second)
        if way is not None and sum(e.length for e in way) < edge.length * (1 - _ROOM):
            return scene.too_short(edge, way)
    for slider, part, start, distance in scene.lines(grounds):
        way = _shortest(edges, start, slider)
        if way is not None and sum(e.length for e in way) < distance * (1 - _ROOM):
            return scene.beside(part, way, start, distance)
    return None


class _Scene:
    """The parts of a scene with the points that they join."""

    def __init__(self, normalized: Normalized) -> None:
        self.n, self.flat = normalized, normalized.flat
        known = kinds_of(self.flat) == KNOWN
        self.fixed = np.append(known, np.ones(normalized.extended_count - self.flat.count, bool))

    def bars(self) -> Iterator[_Edge]:
        for part in self.flat.parts:
            if part.class_name in _BARS:
                first, second, sizes = _BARS[part.class_name]
                columns = [self._found(part, f"{port}.{axis}") for port in (first, second) for axis in "xy"]
                lengths = [self._found(part, size) for size in sizes]
                for row in zip(*columns, *lengths, strict=True):
                    length = float(np.hypot.reduce([self.n.all_values[v] for v in row[4:]])) if row[4:] else np.nan
                    name = self.flat.variable_name(int(row[4])).rsplit(".", 1)[0]
                    yield _Edge(self._node(*row[:2]), self._node(*row[2:4]), abs(length), name, part)

    def lines(self, grounds: list[_Place]) -> Iterator[tuple[_Node, Part, _Place, float]]:
        """Yield points that stay on lines of the ground, with other places of it and their distances from the line."""
        for part in self.flat.parts:
            if part.class_name == "Planar.Guide":
                names: tuple[str, ...] = ("point.x", "point.y", "x0", "y0", "nx", "ny")
            elif part.class_name == "Planar.Prismatic":
                names = ("b.x", "b.y", "a.x", "a.y", "nx", "ny", "a.theta")
            else:
                continue
            for row in zip(*(self._found(part, name) for name in names), strict=True):
                x, y, nx, ny, *turned = (self._value(int(v)) for v in row[2:])
                direction = np.arctan2(ny, nx) + sum(turned)
                if np.isfinite([x, y, direction]).all():
                    c, s = np.cos(direction), np.sin(direction)
                    for node in grounds:
                        distance = abs((node.x - x) * s - (node.y - y) * c)
                        yield self._node(*row[:2]), part, node, float(distance)

    def _found(self, part: Part, name: str) -> np.ndarray:
        found = self.flat.find(f"{part.pattern.replace('[:]', '')}.{name}")
        return np.zeros(0, int) if found is None else found

    def _value(self, variable: int) -> float:
        """The value of a flat variable, NaN where it is none that stays."""
        n, root = self.n, int(self.n.root[variable])
        if not self.fixed[root]:
            return float("nan")
        by, shift = int(n.factor[variable]), int(n.offset[variable])
        factor = n.all_values[by] if by >= 0 else -1.0 if by == -2 else 1.0
        return float(factor * n.all_values[root] + (n.all_values[shift] if shift >= 0 else 0.0))

    def _node(self, x: int, y: int) -> _Node:
        """The point of two coordinates: by its place where that is fixed, else by what it hangs on."""
        place = self._value(int(x)), self._value(int(y))
        if np.isfinite(place).all():
            return _Place(*(round(v, 12) for v in place))
        n = self.n
        return _Moving(*((int(n.root[v]), int(n.factor[v]), int(n.offset[v])) for v in (x, y)))

    # ------------------------------------------------------------------ messages

    def too_short(self, edge: _Edge, way: list[_Edge]) -> Diagnostic:
        bars, reach = [e for e in way if e.name], sum(e.length for e in way)
        names, lengths = listed([e.name for e in bars]), " + ".join(f"{e.length:g}" for e in bars)
        if not edge.name:
            a, b = (f"({p.x:g}, {p.y:g})" for p in (edge.first, edge.second) if isinstance(p, _Place))
            total = f" = {reach:g}" if len(bars) > 1 else ""
            message = f"{names} cannot span {edge.length:g} m: {lengths}{total} m between the fixed points {a} and {b}"
            missing = edge.length - reach
            return self._told(message, bars, f"longer bars, or points at least {missing:g} m nearer to each other")
        round_it = [f"{e.name} ({e.length:g} m)" for e in bars]
        round_it += [f"{e.length:g} m of ground" for e in way if not e.name]
        message = f"{edge.name} ({edge.length:g} m) is too long for its loop: {listed(round_it)} reach {reach:g} m"
        return self._told(message, [edge, *bars], f"a {edge.name} of at most {reach:g} m, or longer bars beside it")

    def beside(self, part: Part, way: list[_Edge], start: _Place, distance: float) -> Diagnostic:
        names, reach = listed([e.name for e in way]), sum(e.length for e in way)
        message = (
            f"{part.pattern} is out of reach: its line passes the fixed point ({start.x:g}, {start.y:g}) at "
            f"{distance:g} m, and {names} reach {reach:g} m"
        )
        return self._told(message, way, f"longer bars, or a line at least {distance - reach:g} m nearer")

    def _told(self, message: str, bars: list[_Edge], hint: str) -> Diagnostic:
        span = next((e.part.span for e in bars if e.part is not None), None)
        return Diagnostic("E0529", message, span, hint=hint)


def _shortest(edges: list[_Edge], start: _Node, goal: _Node) -> list[_Edge] | None:
    """The shortest way between two points; None where there is none."""
    at: dict[_Node, list[tuple[_Node, _Edge]]] = {}
    for e in edges:
        at.setdefault(e.first, []).append((e.second, e))
        at.setdefault(e.second, []).append((e.first, e))
    queue: list[tuple[float, int, _Node]] = [(0.0, 0, start)]
    came: dict[_Node, tuple[_Node, _Edge] | None] = {start: None}
    best, count = {start: 0.0}, 0
    while queue:
        length, _, node = heapq.heappop(queue)
        if node == goal:
            break
        if length > best[node]:
            continue
        for other, edge in at.get(node, []):
            if length + edge.length < best.get(other, np.inf):
                best[other], came[other], count = length + edge.length, (node, edge), count + 1
                heapq.heappush(queue, (best[other], count, other))
    if goal not in came or goal == start:
        return None
    way, step = [], came[goal]
    while step is not None:
        way.append(step[1])
        step = came[step[0]]
    return way[::-1]
