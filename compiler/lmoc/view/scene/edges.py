"""What points and disks of the plane touch: curves, edges of bodies, rims."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, isfinite, pi, sin
from typing import Protocol

from lmoc.view.scene import symbols
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.picture import Anchor, Circle, Item, Point, Turn

FINE = 8  # chords of a piece of a curve
HALF_EDGE = 60.0  # px that an edge reaches beyond what touches it
CURVES = ("track", "disk-track")
WIDE = 10.0  # px between the hatches of a curve


class Plane(Protocol):
    """What is needed of the picture of a plane (`planar.Plane`)."""

    graph: Graph
    scale: float
    back: list[Item]
    items: list[Item]
    elements: Sequence[Element]

    def xy(self, port: Port) -> Point: ...
    def end(self, port: Port) -> Anchor: ...
    def turn(self, port: Port) -> Turn: ...
    def own(self, element: Element, name: str, default: float = 0.0) -> float: ...


def disks(plane: Plane, element: Element) -> list[tuple[Port, float]]:
    """Return the frames at the centres of disks, and their radii in m."""
    if element.symbol == "disk-contact":
        pairs = [("a", "r1"), *([] if plane.own(element, "inside") else [("b", "r2")])]
    else:
        pairs = [("disk", "r")] if element.symbol in ("disk-track", "edge-contact") else []
        pairs = [(element.ports[0].name, "r")] if element.symbol == "rolling-wheel" else pairs
    found = [(element.port(port), plane.own(element, radius)) for port, radius in pairs]
    return [(port, radius) for port, radius in found if port is not None]


def disk(plane: Plane, element: Element, port: Port, radius: float) -> None:
    """Draw a disk with a spoke, behind what is there already."""
    r = radius * plane.scale
    shapes = (Circle((0.0, 0.0, 0.0), r, "body"), symbols.path((0, 0), (r, 0), colour="muted", width=1.0))
    plane.items.insert(0, Item(element.symbol, element.name, (plane.end(port),), shapes, plane.turn(port)))


def curve(plane: Plane, element: Element) -> list[Point]:
    """Return points of the curve that a part follows, in m; none for other parts."""
    if element.symbol not in CURVES:
        return []

    def rows(name: str) -> list[list[float]]:
        return plane.graph.table(element, name, int(plane.own(element, "n")) + 1, 5)

    found = []
    for (begin, *x), (_, *y), (end, *_) in zip(rows("xs")[1:], rows("ys")[1:], rows("xs")[2:]):
        ways = [(end - begin) * k / FINE for k in range(FINE)]
        found += [tuple(c0 + u * (c1 + u * (c2 + u * c3)) for c0, c1, c2, c3 in (x, y)) for u in ways]
    ends = [rows(name)[-1][1] for name in ("xs", "ys")]
    return [*found, tuple(ends)]


def track(plane: Plane, element: Element, ports: Sequence[Port]) -> None:
    """Draw a curve of the ground, hatched on the side that nothing moves on."""
    s = plane.scale
    points = [(s * x, -s * y) for x, y in curve(plane, element)]
    plane.back.append(Item("track", element.name, (Anchor(0.0, 0.0),), tuple(symbols.hatched(points, 1, WIDE))))
    for port, radius in disks(plane, element):
        disk(plane, element, port, radius)


def _edge(plane: Plane, element: Element, within: float = 0.0) -> list[Point]:
    """Return the ends of an edge in px, seen from what has it, around the place nearest to what may touch it.

    Parameters
    ----------
    within : px, by which they are moved into the body
    """
    nx, ny = plane.own(element, "nx"), plane.own(element, "ny", 1.0)
    size = hypot(nx, ny) or 1.0
    nx, ny, s = nx / size, ny / size, plane.scale
    x, y = plane.xy(element.port("point") or element.port("disk"))
    if (frame := element.port("frame")) is not None:
        x0, y0 = plane.xy(frame)
        c, z = cos(plane.turn(frame).angle), sin(plane.turn(frame).angle)
        x, y = c * (x - x0) + z * (y - y0), c * (y - y0) - z * (x - x0)
    away = nx * x + ny * y - plane.own(element, "d") + within / s
    foot = (s * (x - away * nx), -s * (y - away * ny)) if isfinite(away) else (0.0, 0.0)
    return [(foot[0] + k * HALF_EDGE * ny, foot[1] + k * HALF_EDGE * nx) for k in (-1, 1)]


def edges_of(plane: Plane, port: Port, within: float) -> list[Point]:
    """Return the ends of the edges of the body with a frame, in px seen from it."""
    own = [e for e in plane.elements if e.symbol == "edge-contact" and e.port("frame").node == port.node]
    return [place for e in own for place in _edge(plane, e, within)]


def contact(plane: Plane, element: Element, ports: Sequence[Port]) -> None:
    """Draw a straight edge of the ground or of a body, where a point or a disk may touch it."""
    begin, end = _edge(plane, element)
    shapes, frame = tuple(symbols.hatching(begin, end, 1)), element.port("frame")
    if frame is None:
        plane.back.append(Item("contact", element.name, (Anchor(0.0, 0.0),), shapes))
    else:
        plane.items.append(Item("contact", element.name, (plane.end(frame),), shapes[:1], plane.turn(frame)))
    for port, radius in disks(plane, element):
        disk(plane, element, port, radius)


def disk_contact(plane: Plane, element: Element, ports: Sequence[Port]) -> None:
    """Draw two disks, or one in a ring."""
    if plane.own(element, "inside"):
        ring = element.port("b")
        radius = plane.own(element, "r2") * plane.scale
        rim = symbols.hatched([v[1:] for v in symbols.arc(radius, 0.0, 2 * pi)], 1, WIDE)
        shapes = Circle((0.0, 0.0, 0.0), radius, width=2.2), *rim[1:]
        plane.back.append(Item("ring", element.name, (plane.end(ring),), shapes, plane.turn(ring)))
    for port, r in disks(plane, element):
        disk(plane, element, port, r)
