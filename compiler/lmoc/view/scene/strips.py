"""Strips: what moves along one line, or turns on shafts in one line, as it is drawn from one end to the other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import End, Item, Label, Move, Path, Point, Turn
from lmoc.view.scene.rows import Rows, Segment, lay_out
from lmoc.view.scene.text import escaped, width

Direction = tuple[float, float]
RIGHT, UP, DOWN = (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)

IN_LINE = {
    "spring": 76.0, "damper": 72.0, "spring-damper": 76.0, "rod": 46.0, "string": 56.0, "elastic-string": 70.0,
    "stop": 56.0, "friction": 70.0, "torsion-spring": 76.0, "torsion-damper": 62.0, "bearing-friction": 56.0,
    "clutch": 56.0, "ratchet": 56.0, "gear": 76.0, "backlash": 76.0, "gear-pair": 76.0, "ellipsis": 84.0,
}  # fmt: skip
BODIES = ("mass", "inertia", "disk", "turning-bar")
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
    hung : {node: number of joints there}
    """

    shaft: bool
    nodes: list[int] = field(default_factory=list)
    links: list[tuple[Element, int, int]] = field(default_factory=list)
    on: dict[int, list[Element]] = field(default_factory=lambda: defaultdict(list))
    frames: list[tuple[Element, int, int]] = field(default_factory=list)
    hubs: dict[int, Element] = field(default_factory=dict)

    def apart(self) -> Strip:
        """Return the strip with a wall of its own for each element that ends at one."""
        made = Strip(self.shaft, [], [], self.on, self.frames, self.hubs)
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

    def bodies(self, node: int) -> list[Element]:
        """The bodies at a node."""
        return [e for e in self.on[node] if e.symbol in BODIES]

    def held(self, node: int) -> Element | None:
        """The wall or the prescribed motion at a node."""
        return next((e for e in self.on[node] if e.symbol in HELD), None)


@dataclass(frozen=True)
class Style:
    """What a drawing of strips needs to know of the scene."""

    names: Names
    coordinates: Mapping[int, str]  # {node: symbol}
    variables: Mapping[int, str]  # {node: dotted name of the potential}

    def end(self, node: int, at: Point, direction: Direction, shaft: bool, moves: bool = True) -> End:
        """A point of the picture that moves with a node along a direction."""
        if shaft or not moves or node not in self.variables:
            return End(*at)
        return End(*at, (Move(self.variables[node], *direction, None, GROUP),))


@dataclass(frozen=True)
class DrawnStrip:
    """A strip as drawn.

    Attributes
    ----------
    block : its anchors are the nodes' middles
    reach : {node: half of its body along the line}
    along : {node: place along the line}
    conflicts : crossings that are left
    """

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


def draw_strip(strip: Strip, style: Style, direction: Direction = RIGHT, mirrored: bool = False) -> DrawnStrip:
    """Return a strip, drawn.

    Parameters
    ----------
    direction : of +q in the picture
    mirrored : its first row is the last one
    """
    drawing = _Drawing(strip, style, direction, mirrored)
    if drawing.rows.conflicts:  # a wall that everything leads to may be what is in the way
        apart = _Drawing(strip.apart(), style, direction, mirrored)
        drawing = apart if apart.rows.conflicts < drawing.rows.conflicts else drawing
    return drawing.drawn()


class _Drawing:
    def __init__(self, strip: Strip, style: Style, direction: Direction, mirrored: bool) -> None:
        self.strip, self.style, self.direction, self.mirrored = strip, style, direction, mirrored
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
        segments = [Segment(a, b, self._length(e, kind)) for e, a, b, kind in self.parts]
        segments += [Segment(a, b, 60.0) for _, a, b in strip.frames if not self._linked(a, b)]
        self.rows: Rows = lay_out(strip.nodes, self.half, segments)
        self.pitch = self._pitch()

    def _linked(self, a: int, b: int) -> bool:
        return any({a, b} == {c, d} for _, c, d in self.strip.links)

    # ------------------------------------------------------------------ sizes

    def _title(self, node: int) -> str:
        bodies = self.strip.bodies(node)
        parameter = "J" if self.strip.shaft else "m"
        return " + ".join(self.names.part(e, parameter) for e in bodies)

    def _half(self, node: int) -> float:
        """Half of what a node needs along the line."""
        if node in self.strip.hubs:
            return width(self.strip.hubs[node].name, 13) / 2 + 10
        if self.strip.shaft:
            turned = bool(self.strip.bodies(node) or any(e.symbol in PUSHED for e in self.strip.on[node]))
            return 8.0 + (24.0 if turned else 0.0)
        if not self.strip.bodies(node):
            return 4.0 if self.strip.held(node) else 2.0
        return 19.0 if self.upright else max(22.0, width(self._title(node), 13) / 2 + 9)

    def _length(self, element: Element, kind: str) -> float:
        base = 30.0 if kind == "hub" else IN_LINE.get(kind, 0.0) or width(self.names.called(element), 13) + 50
        text = self._text(element, kind)
        ratio = self._lengths.get(element.name, 1.0)
        return max(base * ratio, 0.0 if self.upright else width(text, 13) + 12)

    @property
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

    def _text(self, element: Element, kind: str) -> str:
        """What stands beside an element."""
        if kind == "hub":
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
        texts = [self._text(e, kind) for e, _, _, kind in self.parts]
        return max(40.0, 30.0 + symbols.widest(texts))

    def _abreast(self) -> bool:
        """Return whether two disks stand beside each other on shafts of their own."""
        along = sorted((self.rows.along[n], self.half[n]) for n in self.strip.nodes if self.strip.bodies(n))
        return any(b - a < h + k for (a, h), (b, k) in zip(along, along[1:]))

    # ------------------------------------------------------------------ places

    def place(self, along: float, across: float) -> Point:
        """A point at a place along the line (px) and across it (px, downwards or to the right)."""
        across = -across if self.mirrored else across
        dx, dy = self.direction
        return along * dx + (across if self.upright else 0.0), along * dy + (0.0 if self.upright else across)

    def end(self, node: int, along: float = 0.0, across: float | None = None) -> End:
        """A point that moves with a node: so far along from its middle, at a place across."""
        if across is None:
            low, high = self.rows.span[node]
            across = (low + high) / 2 * self.pitch
        held = self.strip.held(node)
        still = held is not None and held.symbol in ("wall", "fixed-shaft")
        at = self.place(self.rows.along[node] + along, across)
        return self.style.end(node, at, self.direction, self.strip.shaft, not still)

    def drawn(self) -> DrawnStrip:
        for k, (element, a, b, kind) in enumerate(self.parts):
            self._element(k, element, a, b, kind)
        for node in self.strip.nodes:
            self._node(node)
        for element, base, flange in self.strip.frames:
            self._frame(element, base, flange)
        anchors = {}
        for node in self.strip.nodes:
            end = self.end(node)
            anchors[node] = (end.x, end.y)
        reach = {n: self._edge(n) for n in self.strip.nodes}
        return DrawnStrip(Block((*self.items, *self.labels), anchors), reach, self.rows.along, self.rows.conflicts)

    # ------------------------------------------------------------------ elements between nodes

    def _element(self, k: int, element: Element, a: int, b: int, kind: str) -> None:
        if k in self.rows.turned:
            first = self.end(a, -self._edge(a), self.rows.row[k] * self.pitch)
            second = self.end(b, self._edge(b), self.rows.row[k] * self.pitch)
        else:
            first = self.end(a, self._edge(a), self.rows.row[k] * self.pitch)
            second = self.end(b, -self._edge(b), self.rows.row[k] * self.pitch)
        flow = "tau" if self.strip.shaft else "f"
        made = between(element, kind, first, second, self.strip.shaft, self.names)
        variables = {"force": f"{element.name}.{flow}"} if self.names.graph.variable(element, flow) is not None else {}
        self.items.append(Item(made.symbol, made.part, made.ends, made.shapes, made.turn, variables))
        text = self._text(element, kind)
        if text and made.symbol != "box":
            room = 28.0 if element.look.drawing else self._room(kind)
            self.labels.append(self._beside(element, first, second, text, room))

    def _room(self, kind: str) -> float:
        """How far a symbol reaches across."""
        return {"rod": 2.0, "string": 2.0, "torsion-damper": 19.0, "gear": 21.0, "gear-pair": 21.0, "backlash": 21.0,
                "clutch": 15.0, "ratchet": 15.0, "bearing-friction": 15.0}.get(kind, 9.0)  # fmt: skip

    def _beside(self, element: Element, a: End, b: End, text: str, room: float) -> Item:
        """A label at the middle of an element, above it or to its right."""
        halves = tuple(Move(m.variable, m.dx / 2, m.dy / 2, m.reference, m.group) for m in (*a.moves, *b.moves))
        middle = End((a.x + b.x) / 2, (a.y + b.y) / 2, halves)
        if self.upright:
            return symbols.label(text, middle, room + 5, 0, "start", element.name)
        return symbols.label(text, middle, 0, -room - 10, "middle", element.name)

    def _edge(self, node: int) -> float:
        """Where elements begin, from the middle of a node."""
        if self.strip.shaft or node in self.strip.hubs:
            return self.half[node]
        return self.half[node] if self.strip.bodies(node) else 0.0

    # ------------------------------------------------------------------ what stands on a node

    def _node(self, node: int) -> None:
        low, high = (r * self.pitch for r in self.rows.span[node])
        held = self.strip.held(node)
        if self.strip.shaft:
            self._shaft_node(node, low, high)
        elif node in self.strip.hubs:
            self._hub(node, low, high)
        elif self.strip.bodies(node):
            self._body(node, low, high)
        elif high > low:
            a, b = self.end(node, 0, low), self.end(node, 0, high)
            if held is None or held.symbol == "motion":
                self.items.append(symbols.line("joint", "", a, b, 3.0 if held is None else 5.0))
        if held is not None and not self.strip.shaft:
            self._held(node, held, low, high)
        others = [e for e in self.strip.on[node] if e.symbol not in (*BODIES, *HELD, *PUSHED)]
        for element in others:
            self._other(node, element, low, high)
        for element in self.strip.on[node]:
            if element.symbol == "force":
                self._force(node, element, low, high)
        if node in self.style.coordinates and not self.strip.shaft:
            moving = held is None or held.symbol == "motion"
            if moving:
                self._coordinate(node, low, high)

    def _body(self, node: int, low: float, high: float) -> None:
        half = self.half[node]
        bodies = self.strip.bodies(node)
        thick = THICK
        if self.upright:
            thick = max(thick, width(self._title(node), 13) / 2 + 9 - (high - low) / 2)
        middle = (low + high) / 2
        corner = [self.place(s * half, t) for s in (-1, 1) for t in (low - thick - middle, high + thick - middle)]
        xs, ys = [x for x, _ in corner], [y for _, y in corner]
        variables = {"coordinate": self.style.variables[node]}
        made = symbols.box(
            "mass", bodies[0].name, self.end(node), (min(xs), min(ys), max(xs), max(ys)), self._title(node), variables
        )
        self.items.append(made)

    def _hub(self, node: int, low: float, high: float) -> None:
        element, half = self.strip.hubs[node], self.half[node]
        middle = (low + high) / 2
        corner = [self.place(s * half, t) for s in (-1, 1) for t in (low - 16 - middle, high + 16 - middle)]
        xs, ys = [x for x, _ in corner], [y for _, y in corner]
        corners = (min(xs), min(ys), max(xs), max(ys))
        self.items.append(symbols.box("box", element.name, self.end(node), corners, self.names.called(element)))

    def _held(self, node: int, held: Element, low: float, high: float) -> None:
        """A wall on the side where nothing is connected."""
        leaving = any(a == node for _, a, _, _ in self.parts) or not self.parts
        sign = -1.0 if leaving else 1.0
        outwards = self.direction[0] * sign, self.direction[1] * sign
        middle = (low + high) / 2
        reach = 20.0 if high == low else 16.0
        if held.symbol == "wall":
            made = symbols.wall(held.name, self.end(node), outwards, low - reach - middle, high + reach - middle)
            self.items.append(made)
        else:
            a, b = self.end(node, 0, low - reach), self.end(node, 0, high + reach)
            self.items.append(symbols.line("motion", held.name, a, b, 5.0))

    def _force(self, node: int, element: Element, low: float, high: float) -> None:
        """An arrow along +q: from the free side of the body, or below it."""
        text = self.names.signal(element, "f")
        dx, dy = self.direction
        half = self.half[node] if self.strip.bodies(node) else 3.0
        variables = {"force": f"{element.name}.f"}
        if not any(a == node for _, a, _, _ in self.parts):
            at = self.end(node, half)
            tip = (dx * ARROW, dy * ARROW)
            self.items.append(symbols.arrow("force", element.name, at, (0, 0), tip, "force", 2.0, (), variables))
            if self.upright:
                self.labels.append(symbols.label(text, at, 12, dy * (ARROW - 6), "start", element.name, colour="force"))
            else:
                self.labels.append(symbols.label(text, at, ARROW + 6, 0, "start", element.name, colour="force"))
            return
        thick = THICK + 11 if self.strip.bodies(node) else 16
        at = self.end(node, 0, high + thick)
        if self.upright:
            tail, tip = (0, -dy * ARROW / 2), (0, dy * ARROW / 2)
            self.labels.append(symbols.label(text, at, 8, 0, "start", element.name, colour="force"))
        else:
            tail, tip = (-4, 0), (ARROW - 4, 0)
            self.labels.append(symbols.label(text, at, ARROW + 2, 0, "start", element.name, colour="force"))
        self.items.append(symbols.arrow("force", element.name, at, tail, tip, "force", 2.0, (), variables))

    def _crowded(self, node: int, row: float) -> bool:
        """Return whether an element passes where a coordinate's arrow beside a row would be."""
        x = self.rows.along[node]
        for k, (_, a, b, _) in enumerate(self.parts):
            start, stop = sorted((self.rows.along[a], self.rows.along[b]))
            if abs(self.rows.row[k] - row) < 0.8 and start < x + ARROW + 20 and stop > x:
                return True
        return False

    def _coordinate(self, node: int, low: float, high: float) -> None:
        """A reference line and an arrow along +q, above the body or to its left; below it where there is more room."""
        text = self.style.coordinates[node]
        dx, dy = self.direction
        thick = THICK if self.strip.bodies(node) else 18.0
        if self.upright and self.strip.bodies(node):
            thick = max(thick, width(self._title(node), 13) / 2 + 9)
        at = self.place(self.rows.along[node], low)
        end = End(*at)
        if not self.upright and self._crowded(node, low / self.pitch - 1):
            pushed = any(e.symbol == "force" for e in self.strip.on[node])
            if not pushed and not self._crowded(node, high / self.pitch + 1):
                end = End(at[0], self.place(0.0, high)[1])
                self._coordinate_below(node, end, thick)
                return
        if not self.upright and self._is_loose(node):
            shapes = (Label(text, (0, ARROW + 10, 0), "start"),)
            variables = {"coordinate": self.style.variables[node]}
            tip = (ARROW + 5, 0.0)
            made = symbols.arrow("coordinate", "", self.end(node), (6, 0), tip, "ink", 1.2, shapes, variables)
            self.labels.append(made)
            return
        if self.upright:
            side = 1.0 if self.mirrored else -1.0
            ref = _reference((side * (thick + 3), 0), (side * (thick + 28), 0))
            x = side * (thick + 19)
            shapes = (ref, Label(text, (0, x + side * 6, dy * 19), "end" if side < 0 else "start"))
            tail, tip = (x, 0), (x, dy * 28)
        else:
            ref = _reference((0, -thick - 3), (0, -thick - 26))
            shapes = (ref, Label(text, (0, ARROW + 5, -thick - 19), "start"))
            tail, tip = (0, -thick - 19), (ARROW, -thick - 19)
        variables = {"coordinate": self.style.variables[node]}
        self.labels.append(symbols.arrow("coordinate", "", end, tail, tip, "ink", 1.2, shapes, variables))

    def _is_loose(self, node: int) -> bool:
        """Return whether a node is the right end of something, with nothing there."""
        return not any(a == node for _, a, _, _ in self.parts) and not self.strip.on[node]

    def _coordinate_below(self, node: int, end: End, thick: float) -> None:
        """A reference line and an arrow below a body."""
        ref = _reference((0, thick + 3), (0, thick + 26))
        shapes = (ref, Label(self.style.coordinates[node], (0, ARROW + 5, thick + 19), "start"))
        variables = {"coordinate": self.style.variables[node]}
        tail, tip = (0.0, thick + 19), (ARROW, thick + 19)
        self.labels.append(symbols.arrow("coordinate", "", end, tail, tip, "ink", 1.2, shapes, variables))

    def _frame(self, element: Element, base: int, flange: int) -> None:
        """A coordinate counted from another body: from its middle to that of the moving frame's point."""
        text = self.style.coordinates.get(-flange - 1, self.names.called(element))
        lift = min(self.rows.span[base][0], self.rows.span[flange][0]) * self.pitch - THICK - 46
        if self.upright:
            lift -= 24
        a, b = self.end(base, 0, lift), self.end(flange, 0, lift)
        shapes = [Path(((0, 0, 0), (1, 0, 0)), width=1.2), symbols.head((1, 0, 0), (1, 0))]
        shapes += [Path(((f, 0, -5), (f, 0, 20)), False, "", "muted", 1.0, (4, 3)) for f in (0, 1)]
        variables = {"coordinate": f"{element.name}.q"}
        self.labels.append(Item("coordinate", element.name, (a, b), tuple(shapes), Turn(), variables))
        halves = tuple(Move(m.variable, m.dx / 2, m.dy / 2, m.reference, m.group) for m in (*a.moves, *b.moves))
        middle = End((a.x + b.x) / 2, (a.y + b.y) / 2, halves)
        dx, dy = (-8, 0) if self.upright else (0, -11)
        self.labels.append(symbols.label(text, middle, dx, dy, "end" if self.upright else "middle", element.name))

    def _other(self, node: int, element: Element, low: float, high: float) -> None:
        """A part that has no symbol and one port here: a box on a stem."""
        text = self.names.called(element)
        half = width(text, 13) / 2 + 8
        at = self.end(node, 0, high + (THICK if self.strip.bodies(node) else 0.0))
        stem = symbols.path((0, 0), (0, 14))
        made = symbols.box("box", element.name, at, (-half, 14, half, 38), text)
        shapes = (stem, *made.shapes)
        if element.look.drawing:
            shapes = (stem, *symbols.icon(element.look.drawing, 22, 22, text))
            shapes = (stem, *(_moved(s, 36) for s in shapes[1:]))
        self.items.append(Item(made.symbol, made.part, made.ends, shapes))

    # ------------------------------------------------------------------ shafts seen from the side

    def _shaft_node(self, node: int, low: float, high: float) -> None:
        middle, half = (low + high) / 2, self.half[node]
        held = self.strip.held(node)
        end = self.end(node)
        if node in self.strip.hubs:
            self._hub(node, low, high)
            return
        if held is not None and held.symbol == "fixed-shaft":
            leaving = any(a == node for _, a, _, _ in self.parts) or not self.parts
            sign = -1.0 if leaving else 1.0
            outwards = self.direction[0] * sign, self.direction[1] * sign
            at = self.end(node, half if leaving else -half)
            ends = low - middle - 24, high - middle + 24
            self.items.append(symbols.wall(held.name, at, outwards, *ends, "fixed-shaft"))
            return
        for side in (-1, 1):
            rows = [
                self.rows.row[k] for k, (_, a, b, _) in enumerate(self.parts)
                if (a if (side > 0) != (k in self.rows.turned) else b) == node
            ]  # fmt: skip
            if not rows:
                continue
            reached = [0.0, *(r * self.pitch - middle for r in rows)]
            if min(reached) < max(reached):
                bar = [self.place(side * half, t) for t in (min(reached), max(reached))]
                self.items.append(Item("joint", "", (end,), (symbols.path(*bar, width=3.0),)))
            start = self.place(side * 8.0 if self.strip.bodies(node) else 0.0, 0.0)
            self.items.append(Item("shaft", "", (end,), (symbols.path(start, self.place(side * half, 0), width=3.0),)))
        turn = Turn(0.0, self.style.variables.get(node, ""))
        bodies = self.strip.bodies(node)
        if bodies:
            tall = max(34.0, (high - low) / 2 + 14)
            a, b = self.place(-8, -tall), self.place(8, tall)
            corners = (min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1]))
            made = symbols.box("disk", bodies[0].name, end, corners, "")
            shapes = tuple(s for s in made.shapes if not isinstance(s, Label))
            self.items.append(Item("disk", made.part, made.ends, shapes, Turn(), {"angle": turn.variable}))
            x, y = (tall + 8, 0.0) if self.upright else (0.0, -tall - 10)
            self.labels.append(symbols.label(self._title(node), end, x, y, "middle", bodies[0].name))
        if held is not None:  # a prescribed rotation
            self._around(end, -16.0, 15.0, self.names.signal(held, "theta"), "rotation", held.name, "ink")
        for element in self.strip.on[node]:
            if element.symbol == "torque":
                self._around(end, -20.0, 17.0, self.names.signal(element, "tau"), "torque", element.name, "force")
            elif element.symbol == "brake":
                self._brake(end, element)
            elif element.symbol not in (*BODIES, *HELD):
                self._other(node, element, low, high)
        if node in self.style.coordinates and held is None:
            self._around(end, 19.0, 17.0, self.style.coordinates[node], "coordinate", "", "ink", turn.variable)

    def _around(
        self, end: End, along: float, radius: float, text: str, symbol: str, part: str, colour: str, angle: str = ""
    ) -> None:
        """An arrow around the shaft beside a disk."""
        x, y = self.place(along, 0)
        vertices = [(0.0, x + 0.4 * (px), y + py) for _, px, py in symbols.arc(radius, -2.3, 2.3)]
        if self.upright:
            vertices = [(0.0, x + px, y + 0.4 * py) for _, px, py in symbols.arc(radius, -2.3 + 1.57, 2.3 + 1.57)]
        tip, before = vertices[-1], vertices[-2]
        length = ((tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2) ** 0.5
        way = (tip[1] - before[1]) / length, (tip[2] - before[2]) / length
        shapes = (Path(tuple(vertices[:-1]), False, "", colour), symbols.head(tip, way, colour))
        variables = {"angle": angle} if angle else {}
        self.items.append(Item(symbol, part, (end,), shapes, Turn(), variables))
        if text:
            dx, dy = (x + radius + 8, y) if self.upright else (x, y + radius + 13)
            anchor = "start" if self.upright else "middle" if width(text, 13) <= 26 else "start" if along > 0 else "end"
            self.labels.append(symbols.label(text, end, dx, dy, anchor, part, colour=colour))

    def _brake(self, end: End, element: Element) -> None:
        shapes = []
        for s in (1, -1):
            shapes += [symbols.path((-7, s * 36), (7, s * 36), (7, s * 43), (-7, s * 43), closed=True, fill="ground")]
        self.items.append(Item("brake", element.name, (end,), tuple(shapes)))
        self.labels.append(symbols.label(self.names.called(element), end, 0, 54, "middle", element.name))


def _reference(a: Point, b: Point) -> Path:
    """A reference line, from which a coordinate counts."""
    return symbols.path(a, b, colour="muted", width=1.0, dash=(4, 3))


def _moved(shape, dy: float):
    """A shape of one end, lower by some px."""
    from dataclasses import replace

    if isinstance(shape, Label):
        f, x, y = shape.at
        return replace(shape, at=(f, x, y + dy))
    return replace(shape, vertices=tuple((f, x, y + dy) for f, x, y in shape.vertices))


def between(element: Element, kind: str, a: End, b: End, shaft: bool, names: Names) -> Item:
    """Return the symbol of an element between two ends."""
    name = element.name
    if element.hidden:
        return symbols.ellipsis(name, a, b, "")
    if element.look.drawing:
        return symbols.drawing_between(name, a, b, element.look.drawing, name)
    if kind == "spring":
        return symbols.spring(name, a, b)
    if kind == "damper":
        return symbols.damper(name, a, b)
    if kind == "rod":
        return symbols.line("rod", name, a, b, 3.0)
    if kind in ("string", "elastic-string"):
        return symbols.string(name, a, b, kind)
    if kind == "stop":
        return symbols.stop(name, a, b)
    if kind == "friction":
        return symbols.friction(name, a, b)
    if kind == "torsion-spring":
        return symbols.torsion_spring(name, a, b)
    if kind in ("torsion-damper", "bearing-friction", "clutch", "ratchet"):
        return symbols.plates(name, a, b, kind)
    if kind in ("gear", "gear-pair", "backlash"):
        return symbols.gearbox(name, a, b, kind)
    if kind == "hub":
        return symbols.line("shaft" if shaft else "rod", name, a, b, 3.0)
    return symbols.box_between(name, a, b, names.called(element))
