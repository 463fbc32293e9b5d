"""Parts of a line or a shaft that are attached to a mechanism of the plane: drawn along the rail, or about the pin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, hypot, isfinite

from lmoc.view.scene import symbols
from lmoc.view.scene.arrange import strips_of
from lmoc.view.scene.between import between
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Circle, Item, Move, Point, Turn
from lmoc.view.scene.placing import Wish
from lmoc.view.scene.planar import Plane
from lmoc.view.scene.strip import BODIES, HELD, Strip

HALF = 22.0  # px along a rail, of a body on it
BUILT = 76.0  # px along a rail to a wall whose place is not to scale
BESIDE = 30.0  # px, across, between a rail and what is drawn beside it
FLYWHEEL = 34.0  # px, radius of a wheel about a pin: it has no size in the model
SHORTEST = 34.0  # px, of a spring that is still drawn along the rail


def attach(plane: Plane, elements: Sequence[Element]) -> list[Element]:
    """Draw what is attached to rails and pins; returns the elements that are left."""
    done: set[str] = set()
    for carrier in plane.elements:
        flange, shaft = carrier.port("flange"), carrier.port("shaft")
        if flange is not None and flange.domain == "line":
            strip = _strip_at(elements, "line", flange.node)
            if strip is not None and _fits(strip):
                done |= _along(plane, carrier, strip)
        if shaft is not None and shaft.domain == "shaft":
            strip = _strip_at(elements, "shaft", shaft.node)
            if strip is not None:
                done |= _about(plane, carrier, strip, shaft.node)
    return [e for e in elements if e.name not in done and not _only_holds(e, elements, done)]


def _strip_at(elements: Sequence[Element], domain: str, node: int) -> Strip | None:
    return next((s for s in strips_of(elements, domain) if node in s.nodes), None)


def _only_holds(element: Element, elements: Sequence[Element], done: set[str]) -> bool:
    """Return whether it is a wall whose elements have all been drawn."""
    if element.symbol not in ("wall", "fixed-shaft"):
        return False
    node = element.ports[0].node
    others = [e for e in elements if e is not element and any(p.node == node for p in e.ports)]
    return all(e.name in done for e in others) and bool(others)


def _fits(strip: Strip) -> bool:
    return not strip.hubs and not strip.frames


def _line_of(plane: Plane, carrier: Element) -> tuple[Point, Point]:
    """Return the origin of a rail's coordinate and its direction: metres, y upwards."""
    if carrier.symbol == "guide":
        nx, ny = plane.own(carrier, "nx", 1.0), plane.own(carrier, "ny")
        size = hypot(nx, ny) or 1.0
        return (plane.own(carrier, "x0"), plane.own(carrier, "y0")), (nx / size, ny / size)
    return plane.xy(carrier.port("a")), tuple(plane.value(f"{carrier.name}.{n}") for n in ("ex", "ey"))


def _along(plane: Plane, carrier: Element, strip: Strip) -> set[str]:
    """Draw a strip along its rail, to scale."""
    (x0, y0), (dx, dy) = _line_of(plane, carrier)
    s, node = plane.scale, carrier.port("flange").node
    names = {n: plane.graph.flat.variable_name(n) for n in strip.nodes if n >= 0}
    place: dict[int, float] = {}
    for n in strip.nodes:
        held = strip.held(n)
        place[n] = plane.own(held, "q0") if held is not None and held.symbol == "wall" else plane.value(names[n])

    def end(n: int, across: float) -> Anchor:
        q = place[n]
        x, y = s * (x0 + q * dx) + dy * across, -s * (y0 + q * dy) + dx * across
        still = n not in names or (strip.held(n) is not None and strip.held(n).symbol == "wall")
        return Anchor(x, y, () if still else (Move(names[n], s * dx, -s * dy, q),))

    meets = strip.meets
    done: set[str] = set()
    beside = apart = 0
    for element, a, b in strip.links:
        other = b if a == node else a
        outside = node in (a, b) and place[other] > place[node]
        if not outside:
            beside += 1
        across = 0.0 if outside else BESIDE * beside
        first, second = end(a, across), end(b, across)
        walled = next((n for n in (a, b) if strip.held(n) is not None and strip.held(n).symbol == "wall"), None)
        if abs(place[b] - place[a]) * s < SHORTEST and walled is not None and node in (a, b):
            # the wall is where the reference line is, not where it would be built: it is drawn apart, behind the body
            beside -= not outside
            own = end(node, BESIDE * apart).shifted(-HALF * dx, HALF * dy)
            at = Anchor(own.x - dx * BUILT, own.y + dy * BUILT)
            first, second = (at, own) if walled == a else (own, at)
            apart, across = apart + 1, 0.0
        elif abs(place[b] - place[a]) * s < SHORTEST:
            continue
        done.add(element.name)
        made = between(element, element.symbol, first, second, False, plane.names)
        if element.symbol == "spring-damper":
            made = symbols.spring_damper(element.name, first, second)
        plane.items.append(replace(made, variables={"force": f"{element.name}.f"}, nodes=(meets(a), meets(b))))
        middle = Anchor((first.x + second.x) / 2, (first.y + second.y) / 2)
        plane.wishes.append(Wish(plane.names.part(element, "k", "c"), middle, element.name, 16.0))
        for n, at in ((a, first), (b, second)):
            held = strip.held(n)
            if held is not None and held.symbol == "wall":
                beyond = s * (place[n] - place[node]) >= SHORTEST
                plane.back.append(_wall(held.name, at, (dx, -dy), 1.0 if beyond else -1.0))
            elif across:
                stem = symbols.line("joint", "", end(n, 0.0), at, 1.2)
                plane.items.append(replace(stem, nodes=(meets(n), meets(n))))
    for n in strip.nodes:
        for element in strip.on[n]:
            if element.symbol not in HELD:
                done.add(element.name)
                known = len(plane.items), len(plane.front)
                _on(plane, element, end(n, 0.0), (dx, -dy))
                _meeting(plane, known, meets(n))
    return done


def _meeting(plane: Plane, known: tuple[int, int], node: int) -> None:
    """Note of the items that have come since that they are at a node."""
    for layer, first in zip((plane.items, plane.front), known, strict=True):
        layer[first:] = [replace(item, nodes=(node,) * len(item.ends)) for item in layer[first:]]


def _wall(part: str, at: Anchor, direction: Point, sense: float) -> Item:
    """A piece of wall across a rail."""
    ux, uy = direction[0] * sense, direction[1] * sense
    a, b = (-uy * 16, ux * 16), (uy * 16, -ux * 16)
    return Item("wall", part, (at,), tuple(symbols.hatching(a, b, 1)))


def _on(plane: Plane, element: Element, at: Anchor, direction: Point) -> None:
    """A mass or a force at a point of a rail."""
    ux, uy = direction
    if element.symbol in BODIES:
        made = symbols.box("mass", element.name, at, (-24, -9, 24, 9), "")
        plane.items.append(replace(made, turn=Turn(-atan2(uy, ux))))
        plane.wishes.append(Wish(plane.names.part(element, "m"), at, element.name, 20.0))
    elif element.symbol == "force":
        start, tip = (24 * ux, 24 * uy), (62 * ux, 62 * uy)
        force = plane.value(f"{element.name}.f")
        if isfinite(force) and force < 0:  # it pushes against the direction: from the other side
            start, tip = tip, start
        made = symbols.arrow("force", element.name, at, start, tip, "force", 2.0)
        plane.front.append(replace(made, variables={"force": f"{element.name}.f"}))
        label = Anchor(at.x + 62 * ux, at.y + 62 * uy, at.moves)
        plane.wishes.append(Wish(plane.names.signal(element, "f"), label, element.name, 8.0, "force"))
    else:
        text = plane.names.called(element)
        plane.wishes.append(Wish(text, at, element.name, 26.0))
        plane.front.append(Item("box", element.name, (at,), (), Turn()))


def _about(plane: Plane, carrier: Element, strip: Strip, node: int) -> set[str]:
    """Draw what turns a pin, and what holds it on the ground."""
    at = plane.end(carrier.port("a"))
    done: set[str] = set()
    known = len(plane.items), len(plane.front)
    wheels = [e for e in strip.on[node] if e.symbol in BODIES]
    radius = FLYWHEEL + 9.0 * len(wheels) if wheels else 24.0
    for k, element in enumerate(wheels):
        _flywheel(plane, carrier, element, at, FLYWHEEL + 9.0 * k)
    for element in strip.on[node]:
        if element.symbol == "torque":
            plane.around(element, at, plane.names.signal(element, "tau"), "force", radius)
        elif element.symbol == "rotation":
            plane.around(element, at, plane.names.signal(element, "theta"), "ink", radius)
        elif element not in wheels:
            continue
        done.add(element.name)
    for element, a, b in strip.links:
        held = strip.held(b if a == node else a)
        if node in (a, b) and held is not None and held.symbol == "fixed-shaft":
            plane.spiral(element, at)
            done.add(element.name)
    _meeting(plane, known, node)
    return done


def _flywheel(plane: Plane, carrier: Element, element: Element, at: Anchor, radius: float) -> None:
    """A wheel about a pin, behind the mechanism."""
    turn = Turn(0.0, f"{carrier.name}.phi")
    met = tuple(p.node for p in element.ports)
    spoke = symbols.path((0, 0), (radius, 0), colour="muted", width=1.0)
    disk = Circle((0.0, 0.0, 0.0), radius, "body")
    plane.back.insert(0, Item("wheel", element.name, (at,), (disk, spoke), turn, {"angle": turn.variable}, nodes=met))
    rim = Anchor(at.x - 0.7 * radius, at.y + 0.7 * radius, at.moves)
    plane.wishes.append(Wish(plane.names.part(element, "J", "m"), rim, element.name, 10.0))
