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
from lmoc.view.scene.picture import Anchor, Item
from lmoc.view.scene.placing import Wish, placed_labels
from lmoc.view.scene.planar import DOMAINS, Plane, draw_plane
from lmoc.view.scene.text import escaped

BODIES = ("body", "bar", "particle")
ARMS = ("link", "point")
LONG = 44.0  # px, of an arrow that is not to scale
LONGEST = 80.0  # px, of the largest force, where they are
NEGLIGIBLE = 1e-9  # of the largest force
NEAR = 0.01  # px


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

    @property
    def couple(self) -> str:
        """The name of the torque."""
        return self.name.replace("F_", "M_", 1)

    def moment(self, about: tuple[float, float], scale: float) -> float:
        """Return its moment about a point of the picture, N·m, counter-clockwise.

        Parameters
        ----------
        scale : px per metre
        """
        x, y = (self.at[0] - about[0]) / scale, (about[1] - self.at[1]) / scale
        return x * self.y - y * self.x + self.torque


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
    """Return the forces on a body: those of the parts at its ports and at the ends of its arms, and its weight."""
    arms = arms_of(plane, body)
    found = []
    for mine in (body, *arms):
        for port in (p for p in mine.ports if p.domain in DOMAINS):
            end = plane.end(port)
            for other in plane.elements:
                if other in arms:
                    continue
                for theirs in other.ports:
                    same = other.name == mine.name and theirs.name == port.name
                    held = other.name == body.name and mine is not body  # where an arm begins
                    if theirs.node == port.node and theirs.domain in DOMAINS and not (same or held):
                        found.append((theirs, _pull(plane, other, theirs, (end.x, end.y))))
    met = {(p.name, pull.part): pull for p, pull in found}  # several arms may begin where a part acts
    forces = list(met.values())
    m = plane.value(f"{body.name}.m")
    if gravity and m:
        name = f"{plane.names.parameter(body, 'm') or _named('m', body.name)}·g"
        forces.append(Pull(body.name, name, centre_of(plane, body), 0.0, -m * gravity))
    return forces


def arms_of(plane: Plane, body: Element) -> list[Element]:
    """Return the rigid links without mass that are fixed to a body, also by one another."""
    nodes, found = _frames(body), []
    rest = [e for e in plane.elements if e.symbol in ARMS]
    while more := [e for e in rest if nodes & _frames(e)]:
        found += more
        nodes = nodes.union(*map(_frames, more))
        rest = [e for e in rest if e not in more]
    return found


def _frames(element: Element) -> set[int]:
    """The nodes at which what is connected turns with an element."""
    return {p.node for p in element.ports if p.domain == "frame"}


def _pull(plane: Plane, element: Element, port: Port, at: tuple[float, float]) -> Pull:
    flows = [-plane.value(plane.graph.flat.variable_name(f)) for f in port.flows]
    own = plane.names.own(plane.graph.variable(element, "f"))
    if element.symbol == "rolling-wheel":  # the ground acts where it touches the rim
        r = plane.own(element, "r")
        at, flows[2] = (at[0], at[1] + r * plane.scale), flows[2] - r * flows[0]
    return Pull(element.name, own or _named("F", element.name), at, *flows)


def _named(letter: str, part: str) -> str:
    return f"{letter}_{{{escaped(part)}}}" if "{" not in part and "}" not in part else escaped(f"{letter} {part}")


def centre_of(plane: Plane, body: Element) -> tuple[float, float]:
    """Return the centre of mass in px."""
    first = plane.end(body.ports[0])
    if body.symbol == "bar":
        last = plane.end(body.ports[1])
        return (first.x + last.x) / 2, (first.y + last.y) / 2
    if body.symbol == "body":
        frame = Item("", "", (first,), (), plane.turn(body.ports[0])).frame()
        return frame.place((0.0, plane.own(body, "cx") * plane.scale, -plane.own(body, "cy") * plane.scale))
    return first.x, first.y


def _drawn(plane: Plane, body: Element, found: Sequence[Pull], largest: float, scaled: bool) -> Block:
    shapes = ("body", "bar", "particle", "rolling-wheel", *ARMS)
    nodes = {p.node for p in body.ports}
    wheels = {e.name for e in plane.elements if e.symbol == "rolling-wheel" and e.ports[0].node in nodes}
    own = {body.name, *wheels, *(e.name for e in arms_of(plane, body))}
    items = [i for i in (*plane.items, *plane.front) if i.part in own and i.symbol in shapes]
    wishes = [Wish(plane.names.part(body, "m"), Anchor(*centre_of(plane, body)), body.name, 16.0)]
    for pull in found:
        at = Anchor(*pull.at)
        text = f"{pull.name} = {pull.size:.4g} N" if scaled else pull.name
        if _acts(pull.size, largest) and isfinite(pull.size):
            length = LONGEST * pull.size / largest if scaled else LONG
            tip = length * pull.x / pull.size, -length * pull.y / pull.size
            items.append(symbols.arrow("force", pull.part, at, (0, 0), tip, "force", 2.0))
            wishes.append(Wish(text, Anchor(at.x + tip[0], at.y + tip[1]), pull.part, 9.0, "force"))
        elif not isfinite(pull.size):
            wishes.append(Wish(f"{pull.name} = ?", at, pull.part, 12.0, "force"))
        if _turns(pull, largest):
            start, stop = (radians(20), radians(160)) if pull.torque > 0 else (radians(160), radians(20))
            items.append(symbols.turning_arrow("torque", pull.part, at, 22.0, start, stop, "force"))
            text = f"{pull.couple} = {pull.torque:.4g} N·m" if scaled else pull.couple
            wishes.append(Wish(text, Anchor(at.x, at.y - 22.0), pull.part, 9.0, "force"))
    block = Block((*items, *placed_labels(items, wishes)))
    for text in _balances(plane, body, found, largest):
        left, _, right, bottom = block.corners
        below = symbols.label(text, Anchor((left + right) / 2, bottom + 22), part=body.name)
        block = block.beside(Block((replace(below, symbol="balance"),)))
    return block


def _balances(plane: Plane, body: Element, found: Sequence[Pull], largest: float) -> list[str]:
    """The balance of forces, and of a body that can turn that of moments about its centre of mass."""
    mass = plane.names.parameter(body, "m") or _named("m", body.name)
    acting = [p for p in found if _acts(p.size, largest)]
    texts = [f"{mass}·a = {' + '.join(p.name for p in acting) or '0'}"]
    if body.symbol == "particle":
        return texts
    centre = centre_of(plane, body)
    arms = [f"r×{p.name}" for p in acting if hypot(p.at[0] - centre[0], p.at[1] - centre[1]) > NEAR]
    couples = [p.couple for p in found if _turns(p, largest)]
    inertia = plane.names.parameter(body, "J") or _named("J", body.name)
    return [*texts, f"{inertia}·α = {' + '.join((*arms, *couples)) or '0'}"]


def _acts(size: float, largest: float) -> bool:
    """Return whether a force is more than rounding; one without a value may be."""
    return not isfinite(size) or size > NEGLIGIBLE * largest


def _turns(pull: Pull, largest: float) -> bool:
    return isfinite(pull.torque) and abs(pull.torque) > NEGLIGIBLE * max(largest, abs(pull.torque))
