"""Free bodies of the plane: each where it is at one instant, with the forces on it in their directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import hypot, isfinite, radians

from lmoc.support.records import dataclass
from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block, packed
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import End, Item
from lmoc.view.scene.placing import Wish, placed_labels
from lmoc.view.scene.planar import DOMAINS, Plane, draw_plane
from lmoc.view.scene.text import escaped

BODIES = ("body", "bar", "particle")
LONG = 44.0  # px, of an arrow that is not to scale
LONGEST = 80.0  # px, of the largest force, where they are
NEGLIGIBLE = 1e-9  # of the largest force


@dataclass(frozen=True)
class Pull:
    """A force on a body, at a port of it or at its centre of mass.

    Attributes
    ----------
    name : what stands at the arrow
    at : where it acts, px
    x, y : its components, N, y upwards
    torque : N·m, counter-clockwise
    """

    part: str
    name: str
    at: tuple[float, float]
    x: float
    y: float
    torque: float = 0.0

    @property
    def size(self) -> float:
        return hypot(self.x, self.y)


def bodies_of(graph: Graph) -> list[Element]:
    """Return the bodies of the plane."""
    return [e for e in graph.elements if e.symbol in BODIES and e.ports[0].domain in DOMAINS]


def draw_plane_bodies(graph: Graph, value: Callable[[str], float], gravity: float, scaled: bool) -> Block:
    """Return the free bodies of the plane side by side.

    Parameters
    ----------
    value : of a variable at the instant, by its name
    gravity : m/s², downwards
    scaled : arrows are as long as the forces are large, and their labels say how large
    """
    plane = draw_plane(graph, Names(graph), value)
    bodies = [(body, pulls(plane, body, gravity)) for body in bodies_of(graph)]
    largest = max((p.size for _, found in bodies for p in found if isfinite(p.size)), default=0.0)
    return packed([_drawn(plane, body, found, largest, scaled) for body, found in bodies], 760.0, 46.0)


def pulls(plane: Plane, body: Element, gravity: float) -> list[Pull]:
    """Return the forces on a body: those of the parts at its ports, and its weight."""
    found = []
    for port in (p for p in body.ports if p.domain in DOMAINS):
        end = plane.end(port)
        for other in plane.elements:
            for theirs in other.ports:
                mine = other.name == body.name
                if theirs.node == port.node and theirs.domain in DOMAINS and not (mine and theirs.name == port.name):
                    found.append(_pull(plane, other, theirs, (end.x, end.y)))
    m = plane.value(f"{body.name}.m")
    if gravity and m:
        name = f"{plane.names.parameter(body, 'm') or _named('m', body.name)}·g"
        found.append(Pull(body.name, name, _centre(plane, body), 0.0, -m * gravity))
    return found


def _pull(plane: Plane, element: Element, port: Port, at: tuple[float, float]) -> Pull:
    flows = [-plane.value(plane.graph.flat.variable_name(f)) for f in port.flows]
    own = plane.names.own(plane.graph.variable(element, "f"))
    return Pull(element.name, own or _named("F", element.name), at, *flows)


def _named(letter: str, part: str) -> str:
    return f"{letter}_{{{escaped(part)}}}" if "{" not in part and "}" not in part else escaped(f"{letter} {part}")


def _centre(plane: Plane, body: Element) -> tuple[float, float]:
    """The centre of mass in px."""
    first = plane.end(body.ports[0])
    if body.symbol == "bar":
        last = plane.end(body.ports[1])
        return (first.x + last.x) / 2, (first.y + last.y) / 2
    if body.symbol == "body":
        frame = Item("", "", (first,), (), plane.turn(body.ports[0])).frame()
        return frame.place((0.0, plane.own(body, "cx") * plane.scale, -plane.own(body, "cy") * plane.scale))
    return first.x, first.y


def _drawn(plane: Plane, body: Element, found: Sequence[Pull], largest: float, scaled: bool) -> Block:
    shapes = ("body", "bar", "particle", "rolling-wheel")
    nodes = {p.node for p in body.ports}
    wheels = {e.name for e in plane.elements if e.symbol == "rolling-wheel" and e.ports[0].node in nodes}
    items = [i for i in (*plane.items, *plane.front) if i.part in {body.name, *wheels} and i.symbol in shapes]
    wishes = [Wish(plane.names.part(body, "m"), End(*_centre(plane, body)), body.name, 16.0)]
    for pull in found:
        at = End(*pull.at)
        text = f"{pull.name} = {pull.size:.4g} N" if scaled else pull.name
        if isfinite(pull.size) and pull.size > NEGLIGIBLE * largest:
            length = LONGEST * pull.size / largest if scaled else LONG
            tip = length * pull.x / pull.size, -length * pull.y / pull.size
            items.append(symbols.arrow("force", pull.part, at, (0, 0), tip, "force", 2.0))
            wishes.append(Wish(text, End(at.x + tip[0], at.y + tip[1]), pull.part, 9.0, "force"))
        elif not isfinite(pull.size):
            wishes.append(Wish(f"{pull.name} = ?", at, pull.part, 12.0, "force"))
        if isfinite(pull.torque) and abs(pull.torque) > NEGLIGIBLE * max(largest, abs(pull.torque)):
            start, stop = (radians(20), radians(160)) if pull.torque > 0 else (radians(160), radians(20))
            items.append(symbols.turning_arrow("torque", pull.part, at, 22.0, start, stop, "force"))
            name = pull.name.replace("F_", "M_", 1)
            text = f"{name} = {pull.torque:.4g} N·m" if scaled else name
            wishes.append(Wish(text, End(at.x, at.y - 22.0), pull.part, 9.0, "force"))
    block = Block((*items, *placed_labels(items, wishes)))
    left, _, right, bottom = block.corners
    mass = plane.names.parameter(body, "m") or _named("m", body.name)
    names = [p.name for p in found if p.size > NEGLIGIBLE * largest or not isfinite(p.size)]
    text = f"{mass}·a = {' + '.join(names) or '0'}"
    below = symbols.label(text, End((left + right) / 2, bottom + 22), part=body.name)
    return block.beside(Block((replace(below, symbol="balance"),)))
