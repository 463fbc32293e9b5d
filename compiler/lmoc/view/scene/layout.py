"""The layout of a strip in px: how long and wide everything is, and where it stands."""

from __future__ import annotations

from functools import cached_property

from lmoc.view.scene import symbols
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Item, Point
from lmoc.view.scene.rows import Rows, RowSegment, lay_out
from lmoc.view.scene.strip import BODIES, HELD, IN_LINE, PITCH, PUSHED, Direction, Strip, Style
from lmoc.view.scene.text import escaped, width

MARK = 9.0  # px, radius of a mark where a row goes on
CENTRED = 20.0  # px, widest label that stands below the middle of an arrow about a shaft


class Layout:
    """Sizes and places of a strip, and what has been drawn of it.

    Attributes
    ----------
    parts : (element, node a, node b, what is drawn of it)
    half : {node: half of what it needs along the line}
    rows : places along the line, and rows
    pitch : px between two rows
    items, labels : what has been drawn; labels are painted over the items
    """

    def __init__(self, strip: Strip, style: Style, direction: Direction, backwards: bool = False) -> None:
        self.strip, self.style, self.direction = strip, style, direction
        self.names = style.names
        self.upright = direction[0] == 0
        self.items: list[Item] = []
        self.labels: list[Item] = []
        self.parts: list[tuple[Element, int, int, str]] = []  # a spring-damper is two of them
        for element, a, b in strip.links:
            kinds = ("spring", "damper") if element.symbol == "spring-damper" else (element.symbol,)
            kinds = ("hub",) if a in strip.hubs or b in strip.hubs else kinds
            self.parts += [(element, a, b, kind) for kind in kinds]
        self.half = {n: self._half(n) for n in strip.nodes}
        segments = [RowSegment(a, b, self._length(e, kind)) for e, a, b, kind in self.parts]
        segments += [RowSegment(a, b, 60.0) for _, a, b in strip.frames if not self._linked(a, b)]
        rows = lay_out(strip.nodes, self.half, segments)
        self.rows: Rows = rows.backwards() if backwards else rows
        self.pitch = self._pitch()

    def _linked(self, a: int, b: int) -> bool:
        return any({a, b} == {c, d} for _, c, d in self.strip.links)

    # ------------------------------------------------------------------ sizes

    def title(self, node: int) -> str:
        bodies = self.strip.bodies(node)
        parameter = "J" if self.strip.shaft else "m"
        return " + ".join(self.names.part(e, parameter) for e in bodies)

    def _half(self, node: int) -> float:
        """Half of what a node needs along the line."""
        if node in self.strip.hubs:
            return width(self.strip.hubs[node].name, 13) / 2 + 10
        if node in self.strip.marks:
            return MARK
        if self.strip.shaft:
            return max(8.0, *self._arrows(node))
        if not self.strip.bodies(node):
            return max(4.0 if self.strip.held(node) else 2.0, *self._boxes(node))
        return 19.0 if self.upright else max(22.0, width(self.title(node), 13) / 2 + 9)

    def _boxes(self, node: int) -> list[float]:
        """Return half of what the boxes need that stand at a node of a line for parts without a symbol."""
        named = [e for e in self.strip.on[node] if e.symbol not in (*BODIES, *HELD, *PUSHED) and not e.look.drawing]
        return [0.0, *(width(self.names.called(e), 13) / 2 + 8 for e in named)]

    def _arrows(self, node: int) -> list[float]:
        """Return the room that the arrows about a shaft need beside a disk: that of its angle, and those of torques."""
        angle = self.style.coordinates.get(node, "")
        texts = [self.names.signal(e, "tau") for e in self.strip.on[node] if e.symbol == "torque"]
        needed = [32.0] if self.strip.bodies(node) or any(e.symbol in PUSHED for e in self.strip.on[node]) else [0.0]
        for text in (angle, *texts) if needed[0] else ():
            wide = width(text, 13)
            needed.append(19.0 + (wide / 2 if wide <= CENTRED else wide) + 4.0)
        return needed

    def _length(self, element: Element, kind: str) -> float:
        base = 30.0 if kind == "hub" else IN_LINE.get(kind, 0.0) or width(self.names.called(element), 13) + 50
        text = self.text(element, kind)
        ratio = self._lengths.get(element.name, 1.0)
        return max(base * ratio, 0.0 if self.upright else width(text, 13) + 12)

    @cached_property
    def _lengths(self) -> dict[str, float]:
        """Known lengths of the elements against the middle one of them, within bounds that can be drawn."""
        known = {}
        for element, _, _ in self.strip.links:
            for name in ("d0", "L", "s_rel0"):
                value = self.names.graph.value(element, name)
                if value > 0:
                    known[element.name] = value
                    break
        if len(known) < 2:
            return {}
        middle = sorted(known.values())[len(known) // 2]
        return {name: min(1.6, max(0.7, value / middle)) for name, value in known.items()}

    def text(self, element: Element, kind: str) -> str:
        """Return the text beside an element."""
        if kind in ("hub", "continuation"):
            return ""
        if element.hidden:
            return escaped(element.name)
        if any(d.text for d in element.look.drawing):
            return ""
        wanted = {
            "spring": ("k",), "damper": ("c", "d"), "torsion-spring": ("k", "c"), "torsion-damper": ("c", "d"),
            "gear": ("N", "ratio"), "friction": ("F", "mu"), "gear-pair": ("r1", "r2"),
        }.get(kind, ())  # fmt: skip
        found = self.names.part(element, *wanted)
        if kind == "damper" and element.symbol == "spring-damper" and not self.names.parameter(element, "c"):
            return "" if not self.names.parameter(element, "k") else "c"
        return found if kind != "rod" or found != element.name else ""

    def _pitch(self) -> float:
        if self.strip.shaft:
            return 104.0 if self._abreast() else 60.0
        if not self.upright:
            return PITCH
        texts = [self.text(e, kind) for e, _, _, kind in self.parts if not e.hidden]  # dots have room around them
        return max(40.0, 30.0 + symbols.widest(texts))

    def _abreast(self) -> bool:
        """Return whether two disks stand beside each other on shafts of their own."""
        along = sorted((self.rows.along[n], self.half[n]) for n in self.strip.nodes if self.strip.bodies(n))
        return any(b - a < h + k for (a, h), (b, k) in zip(along, along[1:]))

    # ------------------------------------------------------------------ places

    def place(self, along: float, across: float) -> Point:
        """A point at a place along the line (px) and across it (px, downwards or to the right)."""
        dx, dy = self.direction
        return along * dx + (across if self.upright else 0.0), along * dy + (0.0 if self.upright else across)

    def end(self, node: int, along: float = 0.0, across: float | None = None) -> Anchor:
        """A point that moves with a node: so far along from its middle, at a place across."""
        if across is None:
            low, high = self.rows.span[node]
            across = (low + high) / 2 * self.pitch
        held = self.strip.held(node)
        still = held is not None and held.symbol in ("wall", "fixed-shaft")
        at = self.place(self.rows.along[node] + along, across)
        return self.style.end(node, at, self.direction, self.strip.shaft, not still)

    def edge(self, node: int) -> float:
        """Return the distance of an element's end from the middle of a node."""
        if self.strip.shaft or node in self.strip.hubs or node in self.strip.marks:
            return self.half[node]
        return self.half[node] if self.strip.bodies(node) else 0.0

    def leaves(self, node: int) -> bool:
        """Return whether an element begins at a node and goes on along +q."""
        return any((b if k in self.rows.turned else a) == node for k, (_, a, b, _) in enumerate(self.parts))
