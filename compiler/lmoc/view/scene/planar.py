"""Mechanisms of the plane, drawn to scale where they are at the start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from math import atan2, cos, hypot, isfinite, pi, sin

from lmoc.support.records import dataclass
from lmoc.view.scene import edges, symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.names import Names, symbol
from lmoc.view.scene.parallel import moved_across, place_across
from lmoc.view.scene.picture import Anchor, Circle, Item, Move, Path, Point, Shape, Turn, Vertex, middle
from lmoc.view.scene.placing import Wish, placed_labels
from lmoc.view.scene.strip import ARROW
from lmoc.view.scene.text import width

MOST_LABELS = 60
EXTENT = 380.0  # px of the longer side
ROUNDED = 9.0  # px around the points of a body
DOMAINS = ("point", "frame")
STRINGS = ("string", "elastic-string")


@dataclass
class Plane:
    """The parts of the plane, drawn one after the other.

    Attributes
    ----------
    value : value of a variable at the start, by its name
    scale : px per metre
    """

    graph: Graph
    names: Names
    value: Callable[[str], float]
    scale: float = 1.0
    back: list[Item] = field(default_factory=list)  # grounds and rails, behind everything
    items: list[Item] = field(default_factory=list)
    front: list[Item] = field(default_factory=list)  # pins
    wishes: list[Wish] = field(default_factory=list)
    elements: Sequence[Element] = ()

    # ------------------------------------------------------------------ places

    def xy(self, port: Port) -> Point:
        """Return the place of a port at the start, in metres."""
        return self.value(self.graph.name(port, 0)), self.value(self.graph.name(port, 1))

    def end(self, port: Port) -> Anchor:
        """A port in the picture, with what moves it."""
        x, y = self.xy(port)
        s = self.scale
        moves = Move(self.graph.name(port, 0), s, 0.0, x), Move(self.graph.name(port, 1), 0.0, -s, y)
        return Anchor(s * x, -s * y, moves)

    def turn(self, port: Port) -> Turn:
        """The direction of a frame."""
        name = self.graph.name(port, 2)
        theta = self.value(name)
        return Turn(theta, name, 1.0, theta)

    def own(self, element: Element, name: str, default: float = 0.0) -> float:
        """A parameter of an element as a number."""
        value = self.graph.value(element, name, default)
        return value if isfinite(value) else default

    # ------------------------------------------------------------------ what is drawn how

    def draw(self, element: Element) -> None:
        """Draw one element."""
        layers = self.back, self.items, self.front
        known = [set(map(id, layer)) for layer in layers]
        self._draw(element, [p for p in element.ports if p.domain in DOMAINS])
        met = tuple(p.node for p in element.ports)
        for layer, old in zip(layers, known, strict=True):
            for k, item in enumerate(layer):
                if id(item) not in old:
                    spans = len(item.ends) == 2
                    between = spans or any(len(i.ends) == 2 and i.part == element.name for i in layer)
                    layer[k] = replace(item, nodes=met[:2] if spans else met[:1] if between else met)

    def _draw(self, element: Element, ports: Sequence[Port]) -> None:
        drawer = DRAWERS.get(element.symbol) if not element.look.drawing else None
        if drawer is not None:
            drawer(self, element, ports)
        elif len(ports) >= 2:
            self._between(element, ports)
        elif ports:
            self._alone(element, ports[0])

    def _between(self, element: Element, ports: Sequence[Port]) -> None:
        a, b = self.end(ports[0]), self.end(ports[1])
        name = self.names.called(element)
        if element.look.drawing:
            self.items.append(symbols.drawing_between(element.name, a, b, element.look.drawing, element.name))
            self.wishes.append(Wish(name, middle(a, b), element.name, 26.0))
        elif hypot(b.x - a.x, b.y - a.y) > width(name, 13) + 24:
            self.items.append(symbols.box_between(element.name, a, b, name))
        else:
            self.items.append(symbols.line("box", element.name, a, b, 1.5))
            self._alone(element, ports[0])

    def _alone(self, element: Element, port: Port) -> None:
        at, text = self.end(port), self.names.called(element)
        if element.look.drawing:
            shapes = tuple(symbols.icon(element.look.drawing, 22, 22, element.name))
            self.items.append(Item("icon", element.name, (at,), shapes))
            return
        half = width(text, 13) / 2 + 7
        stem = symbols.path((0, 0), (20, -26))
        made = symbols.box("box", element.name, at, (20 - half, -50, 20 + half, -26), text)
        self.items.append(replace(made, shapes=(stem, *made.shapes)))

    def two_ends(self, element: Element, ports: Sequence[Port]) -> None:
        """A spring, a damper, a rod, a string between two points."""
        a, b = self.end(ports[0]), self.end(ports[1])
        kind = element.symbol
        makers = {"spring": symbols.spring, "damper": symbols.damper}
        force = {"force": f"{element.name}.f"} if self.graph.variable(element, "f") is not None else {}
        if kind in STRINGS:
            force |= self.names.slack(element.name)
        if kind in STRINGS:
            made = symbols.string(element.name, a, b, kind)
            self.items.append(replace(made, variables=force, slack=self.scale * self._slack(force)))
        elif kind == "spring-damper":
            self.items.append(replace(symbols.spring_damper(element.name, a, b), variables=force))
        elif kind == "rod":
            self.items.append(replace(symbols.line("rod", element.name, a, b, 3.0), variables=force))
        else:
            self.items.append(replace(makers[kind](element.name, a, b), variables=force))
        text = self.names.part(element, "k", "c") if kind != "rod" else self.names.part(element, "L")
        across = place_across(element, self.elements)
        if across:
            self.items[-1] = replace(made := self.items[-1], shapes=moved_across(made.shapes, across))
        if kind != "string":
            at, frame = self.items[-1].halfway, self.items[-1].frame()
            x, y = at.x - across * frame.sin, at.y + across * frame.cos
            self.wishes.append(Wish(text, Anchor(x, y, at.moves), element.name, 12.0))

    def _slack(self, variables: Mapping[str, str]) -> float:
        """By how much a string is longer than the way between its ends, m; 0 where that is not known."""
        found = -self.value(variables["stretch"]) if "stretch" in variables else 0.0
        found = self.value(variables["slack"]) if "slack" in variables else found
        return found if isfinite(found) else 0.0

    def bar(self, element: Element, ports: Sequence[Port]) -> None:
        """A bar from one frame to another."""
        a, b = self.end(ports[0]), self.end(ports[1])
        thick = 6.0 if element.symbol == "bar" else 3.0
        corners: tuple[Vertex, ...] = (
            *((0.0, -thick * cos(t), -thick * sin(t)) for t in _half_circle(-pi / 2)),
            *((1.0, thick * cos(t), thick * sin(t)) for t in _half_circle(-pi / 2)),
        )
        self.items.append(Item(element.symbol, element.name, (a, b), (Path(corners, True, "body"),)))
        if element.symbol == "bar":
            self.wishes.append(Wish(self.names.part(element, "m"), middle(a, b), element.name, 11.0))

    def link(self, element: Element, ports: Sequence[Port]) -> None:
        """A rigid link without mass."""
        if self.is_carried(ports[0].node) or self.is_carried(ports[1].node):
            a, b = self.end(ports[0]), self.end(ports[1])
            self.items.append(symbols.line("link", element.name, a, b, 1.2, "muted"))
        else:
            self.bar(element, ports)

    def is_carried(self, node: int) -> bool:
        """Return whether a body has this frame as its own."""
        return any(e.symbol == "body" and e.ports[0].node == node for e in self.elements)

    def body(self, element: Element, ports: Sequence[Port]) -> None:
        """A body: the area around its own frame, its centre of mass and the points fixed to it."""
        port, s = ports[0], self.scale
        centre = self.own(element, "cx") * s, -self.own(element, "cy") * s
        points = [(0.0, 0.0), centre, *self._fixed(port, element)]
        hull = symbols.convex_hull(points)
        turn = self.turn(port)
        shapes: list[Shape] = []
        slides = any(e.symbol == "slider" and e.port("b").node == port.node for e in self.elements)
        rolls = any(p.node == port.node for e in self.elements for p, _ in edges.disks(self, e))
        if slides and len(hull) < 3:
            shapes.append(symbols.path((-22, -13), (22, -13), (22, 13), (-22, 13), closed=True, fill="body"))
        elif rolls:
            shapes.append(Circle((0.0, 0.0, 0.0), 4.0, "ink"))
        else:
            shapes.append(Path(tuple((0.0, x, y) for x, y in symbols.rounded(hull, ROUNDED)), True, "body"))
        shapes.append(Circle((0.0, *centre), 3.5, "paper"))
        shapes.append(Circle((0.0, *centre), 1.2, "ink"))
        self.items.insert(0, Item("body", element.name, (self.end(port),), tuple(shapes), turn))
        x, y = (sum(c) / len(hull) for c in zip(*hull))
        frame = Item("", "", (self.end(port),), (), turn).frame()
        at = frame.place((0.0, x, y))
        own = self.end(port)
        self.wishes.append(Wish(self.names.part(element, "m"), Anchor(*at, own.moves), element.name, 20.0))

    def _fixed(self, port: Port, element: Element) -> list[Point]:
        """Points fixed to a body's frame, in px as seen from it."""
        found = []
        for other in self.elements:
            own = [p for p in other.ports if p.domain in DOMAINS]
            if other.symbol in ("link", "point") and own and own[0].node == port.node:
                found.append((self.own(other, "rx") * self.scale, -self.own(other, "ry") * self.scale))
        return [*found, *edges.edges_of(self, port, ROUNDED)]

    def particle(self, element: Element, ports: Sequence[Port]) -> None:
        """A particle."""
        at = self.end(ports[0])
        self.front.append(Item("particle", element.name, (at,), (Circle((0.0, 0.0, 0.0), 8.0, "body"),)))
        self.wishes.append(Wish(self.names.part(element, "m"), at, element.name, 12.0))

    def ground(self, element: Element, ports: Sequence[Port]) -> None:
        """A place that does not move: a bearing, unless a rail begins there."""
        at = self.end(ports[0])
        others = {e.symbol for e in self.elements for p in e.ports if p.node == ports[0].node and e is not element}
        if others and others <= {"slider"}:
            self.back.append(Item("ground", element.name, (at,), ()))
            return
        self.back.append(symbols.pivot(element.name, Anchor(at.x, at.y), (0.0, 1.0), element.symbol))

    def pin(self, element: Element, ports: Sequence[Port]) -> None:
        """A pin, with the name of its angle where the model has one."""
        at = self.end(ports[0])
        angle = self.graph.variable(element, "phi")
        variables = {"angle": f"{element.name}.phi"}
        circle = Circle((0.0, 0.0, 0.0), 4.0, "paper")
        self.front.append(Item("pin", element.name, (at,), (circle,), Turn(), variables))
        if own := self.names.own(angle):
            made = symbols.turning_arrow("coordinate", element.name, at, 17.0, -0.5, 0.9, variables=variables)
            self.front.append(made)
            self.wishes.append(Wish(symbol(own), at, element.name, 19.0))

    def slider(self, element: Element, ports: Sequence[Port]) -> None:
        """A rail through the first frame, and what slides on it."""
        a, b = self.end(element.port("a")), self.end(element.port("b"))
        ex, ey = self.value(f"{element.name}.ex"), -self.value(f"{element.name}.ey")
        reach = (b.x - a.x) * ex + (b.y - a.y) * ey
        low, high = min(0.0, reach) - 34.0, max(0.0, reach) + 34.0
        fixed = any(e.symbol == "ground" and e.ports[0].node == element.port("a").node for e in self.elements)
        p, q = (low * ex, low * ey), (high * ex, high * ey)
        gap = 13.0 if fixed else 0.0
        # along the line from the first frame, on its right side as one looks along (below, where it goes to the right)
        nx, ny = -ey * gap, ex * gap
        p, q = (p[0] + nx, p[1] + ny), (q[0] + nx, q[1] + ny)
        if fixed:
            self.back.append(Item("rail", element.name, (Anchor(a.x, a.y),), tuple(symbols.hatching(p, q, 1))))
        else:
            self.back.append(Item("rail", element.name, (a,), (symbols.path(p, q, width=2.0, colour="muted"),)))
        carried = any(e.symbol == "body" and e.ports[0].node == element.port("b").node for e in self.elements)
        if not carried:
            block = symbols.path((-13, -9), (13, -9), (13, 9), (-13, 9), closed=True, fill="paper")
            turn = Turn(-atan2(ey, ex))
            self.items.append(Item("slider", element.name, (b,), (block,), turn))
        else:
            self.items.append(Item("slider", element.name, (b,), ()))  # the body itself slides
        way = self.graph.variable(element, "s")
        if own := self.names.own(way):
            self._along(element, b, (ex, ey), symbol(own), 24.0 if carried else 18.0)

    def _along(self, element: Element, at: Anchor, direction: Point, text: str, beside: float) -> None:
        """A coordinate's arrow along a line, beside what is on it."""
        ex, ey = direction
        side = beside if ex > 0 or (ex == 0 and ey > 0) else -beside  # above, or on the right of a line that is upright
        foot = (side * ey, -side * ex)
        tip = (foot[0] + ARROW * ex, foot[1] + ARROW * ey)
        variables = {"coordinate": f"{element.name}.s"}
        self.front.append(symbols.arrow("coordinate", element.name, at, foot, tip, "ink", 1.2, (), variables))
        self.wishes.append(Wish(text, Anchor(at.x + tip[0], at.y + tip[1], at.moves), element.name, 8.0))

    def guide(self, element: Element, ports: Sequence[Port]) -> None:
        """A line of the ground that a point stays on."""
        at = self.end(ports[0])
        nx, ny = self.own(element, "nx", 1.0), -self.own(element, "ny")
        size = hypot(nx, ny) or 1.0
        nx, ny = nx / size, ny / size
        p, q = (-70 * nx - ny * 9, -70 * ny + nx * 9), (70 * nx - ny * 9, 70 * ny + nx * 9)
        self.back.append(Item("guide", element.name, (Anchor(at.x, at.y),), tuple(symbols.hatching(p, q, 1))))
        flange = element.port("flange")
        masses = {e.ports[0].node for e in self.graph.elements if e.symbol == "mass"}
        if flange is not None and flange.node in masses:
            return  # the mass itself is on the line
        block = symbols.path((-16, -9), (16, -9), (16, 9), (-16, 9), closed=True, fill="paper")
        self.items.append(Item("slider", element.name, (at,), (block,), Turn(-atan2(ny, nx))))

    def rolling_wheel(self, element: Element, ports: Sequence[Port]) -> None:
        """A wheel on the ground."""
        r = self.own(element, "r", 0.1) * self.scale
        at = self.end(ports[0])
        edges.disk(self, element, ports[0], self.own(element, "r", 0.1))
        ground = symbols.hatching((-r - 60, 0), (r + 60, 0), 1)
        self.back.append(Item("ground", element.name, (Anchor(at.x, 0.0),), tuple(ground)))

    def force(self, element: Element, ports: Sequence[Port]) -> None:
        """A given force: in its direction at the start, where it has one."""
        at = self.end(ports[0])
        fx, fy = (self.value(f"{element.name}.{n}") for n in ("fx", "fy"))
        size = hypot(fx, fy)
        ux, uy = (fx / size, -fy / size) if isfinite(size) and size > 0 else (1.0, 0.0)
        made = symbols.arrow("force", element.name, at, (0, 0), (40 * ux, 40 * uy), "force", 2.0)
        self.front.append(replace(made, variables={"fx": f"{element.name}.fx", "fy": f"{element.name}.fy"}))
        tip = Anchor(at.x + 40 * ux, at.y + 40 * uy, at.moves)
        self.wishes.append(Wish(self.names.signal(element, "fx"), tip, element.name, 8.0, "force"))

    def torque(self, element: Element, ports: Sequence[Port]) -> None:
        """A given torque."""
        self.around(element, self.end(ports[0]), self.names.signal(element, "tau"), "force")

    def around(self, element: Element, at: Anchor, text: str, colour: str, radius: float = 24.0) -> None:
        """An arrow around a point, with a label."""
        made = symbols.turning_arrow(element.symbol, element.name, at, radius, 1.2, 2.9, colour)
        self.front.append(replace(made, variables={"torque": f"{element.name}.tau"}))
        self.wishes.append(Wish(text, at, element.name, radius + 4.0, colour))

    def torsion(self, element: Element, ports: Sequence[Port]) -> None:
        """A spiral about the point where two bodies are joined, or two arcs with a gap for a damper."""
        at = self.end(ports[0])
        self.spiral(element, at)

    def spiral(self, element: Element, at: Anchor) -> None:
        """The symbol of a torsional spring or damper about a point."""
        if element.symbol == "torsion-spring":
            points = [(0.0, (6 + 0.9 * t) * cos(t), -(6 + 0.9 * t) * sin(t)) for t in [k * 0.3 for k in range(42)]]
            shapes: tuple[Shape, ...] = (Path(tuple(points), width=1.2),)
        else:
            shapes = (Path(symbols.arc(11.0, 0.3, 2.8)), Path(symbols.arc(15.0, 0.0, pi)))
        self.front.append(Item(element.symbol, element.name, (at,), shapes))
        self.wishes.append(Wish(self.names.part(element, "k", "c", "tau"), at, element.name, 20.0))

    def motion(self, element: Element, ports: Sequence[Port]) -> None:
        """A point that is moved."""
        at = self.end(ports[0])
        cross = (symbols.path((-7, 0), (7, 0)), symbols.path((0, -7), (0, 7)), Circle((0.0, 0.0, 0.0), 4.0, "paper"))
        self.front.append(Item("motion", element.name, (at,), cross))
        self.wishes.append(Wish(self.names.called(element), at, element.name, 10.0))

    def nothing(self, element: Element, ports: Sequence[Port]) -> None:
        """Draw nothing: a weld has no extent."""
        self.back.append(Item(element.symbol, element.name, (self.end(ports[0]),), ()))


DRAWERS: dict[str, Callable[[Plane, Element, Sequence[Port]], None]] = {
    **dict.fromkeys(("spring", "damper", "spring-damper", "rod", "string", "elastic-string"), Plane.two_ends),
    **dict.fromkeys(("ground", "anchor"), Plane.ground),
    **dict.fromkeys(("torsion-spring", "torsion-damper"), Plane.torsion),
    **dict.fromkeys(("link", "point"), Plane.link),
    "bar": Plane.bar, "body": Plane.body, "particle": Plane.particle, "pin": Plane.pin, "slider": Plane.slider,
    "guide": Plane.guide, "rolling-wheel": Plane.rolling_wheel, "force": Plane.force,
    "torque": Plane.torque, "motion": Plane.motion, "weld": Plane.nothing,
    **dict.fromkeys(edges.CURVES, edges.track), **dict.fromkeys(("contact", "edge-contact"), edges.contact),
    "disk-contact": edges.disk_contact,
}  # fmt: skip


def is_planar(element: Element) -> bool:
    """Return whether an element has a port in the plane."""
    return any(p.domain in DOMAINS for p in element.ports)


def draw_plane(graph: Graph, names: Names, value: Callable[[str], float]) -> Plane:
    """Return the parts of the plane, drawn; more may be added before `finish`."""
    plane = Plane(graph, names, value)
    plane.elements = [e for e in graph.elements if is_planar(e)]
    places = [plane.xy(p) for e in plane.elements for p in e.ports if p.domain in DOMAINS]
    places += [place for e in plane.elements for place in edges.curve(plane, e)]
    places = [(x, y) for x, y in places if isfinite(x) and isfinite(y)] or [(0.0, 0.0)]
    radii = [radius for e in plane.elements for _, radius in edges.disks(plane, e)]
    xs, ys = [x for x, _ in places], [y for _, y in places]
    longest = max(max(xs) - min(xs), max(ys) - min(ys), 2 * max(radii, default=0.0))
    plane.scale = EXTENT / longest if longest > 0 else 200.0
    for element in plane.elements:
        plane.draw(element)
    return plane


def finish(plane: Plane) -> Block:
    """Return everything as a block, with its labels placed."""
    items = [*plane.back, *plane.items, *plane.front]
    few = plane.wishes if len(plane.wishes) <= MOST_LABELS else []
    return Block((*items, *placed_labels(items, few)))


def _half_circle(start: float) -> list[float]:
    return [start + pi * k / 6 for k in range(7)]
