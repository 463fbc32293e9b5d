"""A strip: what moves along one line, or turns on shafts in one line."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import field

from lmoc.support.records import dataclass
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Anchor, Move, Point

Direction = tuple[float, float]
RIGHT, UP, DOWN = (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)

IN_LINE = {
    "spring": 76.0, "damper": 72.0, "spring-damper": 76.0, "rod": 46.0, "string": 56.0, "elastic-string": 70.0,
    "stop": 56.0, "friction": 70.0, "torsion-spring": 76.0, "torsion-damper": 62.0, "bearing-friction": 56.0,
    "clutch": 56.0, "ratchet": 56.0, "gear": 76.0, "backlash": 76.0, "gear-pair": 76.0, "ellipsis": 84.0,
    "belt": 92.0, "chain": 92.0, "continuation": 16.0,
}  # fmt: skip
BODIES = ("mass", "inertia", "disk", "turning-bar", "pendulum")
HELD = ("wall", "fixed-shaft", "motion", "rotation")
PUSHED = ("force", "torque", "brake")
PITCH = 46.0  # between rows, across a horizontal line
THICK = 19.0  # half of a box, across
ARROW = 34.0
GROUP = "line"  # of the moves


@dataclass
class Strip:
    """Nodes along one line, with everything that is drawn there.

    Attributes
    ----------
    shaft : it turns; else it moves along the line
    links : (element, node a, node b) of elements between two nodes
    on : {node: elements that stand on it alone}
    frames : moving frames (element, base, flange)
    hubs : {node in the middle of a part with three ports or more: that part}
    marks : {node where a line breaks off: the one where it goes on}
    same : {node that was made: the one that it stands for}
    """

    shaft: bool
    nodes: list[int] = field(default_factory=list)
    links: list[tuple[Element, int, int]] = field(default_factory=list)
    on: dict[int, list[Element]] = field(default_factory=lambda: defaultdict(list))
    frames: list[tuple[Element, int, int]] = field(default_factory=list)
    hubs: dict[int, Element] = field(default_factory=dict)
    marks: dict[int, int] = field(default_factory=dict)
    same: dict[int, int] = field(default_factory=dict)

    def apart(self) -> Strip:
        """Return the strip with a wall of its own for each element that ends at one."""
        made = Strip(self.shaft, [], [], self.on, self.frames, self.hubs, self.marks, self.same)
        fresh = min(self.nodes) - 1

        def own(node: int) -> int:
            nonlocal fresh
            held = self.held(node)
            if held is None or held.symbol not in ("wall", "fixed-shaft"):
                return node
            fresh -= 1
            made.on[fresh] = [held]
            return fresh

        made.links = [(e, own(a), own(b)) for e, a, b in self.links]
        made.nodes = list(dict.fromkeys([n for _, a, b in made.links for n in (a, b)]))
        walled = [n for n in self.nodes if self.held(n) is None or self.held(n).symbol in ("motion", "rotation")]
        made.nodes += [n for n in walled if n not in made.nodes]
        return made

    def broken(self, links: Sequence[tuple[Element, int, int]]) -> Strip:
        """Return the strip with some links broken off at one end, where a number says how it goes on."""
        made = Strip(self.shaft, list(self.nodes), [], self.on, self.frames, self.hubs, dict(self.marks), self.same)
        fresh = min(self.nodes) - 1

        def cut(node: int) -> int:
            nonlocal fresh
            fresh -= 1
            made.marks[fresh] = self.meets(node)
            made.nodes.append(fresh)
            return fresh

        for e, a, b in self.links:
            if (e, a, b) in links and self.meets(b) >= 0 and b not in self.marks:
                b = cut(b)
            elif (e, a, b) in links and self.meets(a) >= 0 and a not in self.marks:
                a = cut(a)
            made.links.append((e, a, b))
        return made

    def meets(self, node: int) -> int:
        """Return the connection set that a node shows, -1 for none: the inside of a part, or a piece of a wall."""
        return max(self.marks.get(node, self.same.get(node, node)), -1)

    def bodies(self, node: int) -> list[Element]:
        """The bodies at a node."""
        return [e for e in self.on[node] if e.symbol in BODIES]

    def held(self, node: int) -> Element | None:
        """The wall or the prescribed motion at a node."""
        return next((e for e in self.on[node] if e.symbol in HELD), None)


@dataclass(frozen=True)
class Style:
    """The facts of a scene that a drawing of strips depends on.

    Attributes
    ----------
    coordinates : {node: symbol}
    variables : {node: dotted name of the potential}
    scales : {node that moves to scale: px per metre, and the place at which it is drawn, None: that at the start}
    """

    names: Names
    coordinates: Mapping[int, str]
    variables: Mapping[int, str]
    scales: Mapping[int, tuple[float, float | None]] = field(default_factory=dict)

    def end(self, node: int, at: Point, direction: Direction, shaft: bool, moves: bool = True) -> Anchor:
        """A point of the picture that moves with a node along a direction."""
        if shaft or not moves or node not in self.variables:
            return Anchor(*at)
        variable, (dx, dy) = self.variables[node], direction
        if node in self.scales:
            scale, reference = self.scales[node]
            return Anchor(*at, (Move(variable, dx * scale, dy * scale, reference),))
        return Anchor(*at, (Move(variable, dx, dy, None, GROUP),))


@dataclass(frozen=True)
class DrawnStrip:
    """A strip as drawn.

    Attributes
    ----------
    strip : what was drawn: with a wall of its own for each element, it may be, or with lines broken off
    block : its anchors are the nodes' middles
    reach : {node: half of its body along the line}
    along : {node: place along the line}
    conflicts : crossings that are left
    """

    strip: Strip
    block: Block
    reach: Mapping[int, float]
    along: Mapping[int, float]
    conflicts: int

    def is_last(self, node: int) -> bool:
        """Return whether nothing lies beyond a node along +q."""
        return self.along[node] >= max(self.along.values()) - 1e-9

    def is_first(self, node: int) -> bool:
        """Return whether nothing lies before a node."""
        return self.along[node] <= min(self.along.values()) + 1e-9
