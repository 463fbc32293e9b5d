"""Shafts seen along their axis: wheels with what drives and holds them, gears in mesh, belts and chains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import acos, cos, pi, radians, sin

from lmoc.support.records import dataclass
from lmoc.view.scene import symbols
from lmoc.view.scene.between import between
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Circle, Item, Move, Path, Turn
from lmoc.view.scene.strip import BODIES, GROUP, Direction, Strip, Style
from lmoc.view.scene.text import plain, width

LARGEST, SMALLEST = 64.0, 10.0  # px, radii of gears
GEARS, BELTS = ("gear", "gear-pair"), ("belt", "chain")
APART = 62.0  # px between two pulleys
LEG = 62.0  # length of what holds a wheel
LEGS = 46.0  # between two legs


@dataclass(frozen=True)
class Window:
    """Angles (degrees) from which to which the arrows about a wheel go, where they count counter-clockwise."""

    coordinate: tuple[float, float]
    torque: tuple[float, float]


CENTRE = Anchor(0.0, 0.0)  # of a wheel
ALL_ROUND = Window((95, 142), (38, 85))
FIRST, LAST, BETWEEN = Window((75, 118), (140, 190)), Window((45, 92), (-15, 30)), Window((70, 110), (250, 290))


@dataclass(frozen=True)
class Turning:
    """The elements of one shaft: its bodies, its drives, its supports.

    Attributes
    ----------
    sense : 1 where its angle counts counter-clockwise, -1 where clockwise
    """

    node: int
    on: tuple[Element, ...]
    legs: tuple[Element, ...]
    sense: int = 1


def turning(strip: Strip, node: int, sense: int = 1) -> Turning:
    """Return what belongs to a shaft of a strip."""
    legs = []
    for element, a, b in strip.links:
        other = b if a == node else a
        held = strip.held(other)
        if node in (a, b) and held is not None and held.symbol == "fixed-shaft":
            legs.append(element)
    return Turning(node, tuple(strip.on[node]), tuple(legs), sense)


def decorated(
    shaft: Turning,
    style: Style,
    radius: float,
    down: bool,
    title: bool = True,
    held: bool = False,
    window: Window = ALL_ROUND,
) -> tuple[list[Item], list[Item]]:
    """Return the arrows about a wheel at (0, 0), and its legs to the ground.

    Parameters
    ----------
    radius : of the wheel
    down : where the legs go; else upwards
    title : its bodies' names are written
    held : it has a bearing where nothing else holds it
    window : where there is room for arrows
    """
    names = style.names
    items: list[Item] = []
    if shaft.node in style.coordinates and not any(e.symbol == "rotation" for e in shaft.on):
        angle = {"angle": style.variables[shaft.node]}
        items += _around(
            shaft, radius, style.coordinates[shaft.node], "coordinate", "", "ink", window.coordinate, angle
        )
    for element in shaft.on:
        part = element.name
        if element.symbol == "torque":
            text, variables = names.signal(element, "tau"), {"force": f"{part}.tau"}
            items += _around(shaft, radius, text, "torque", part, "force", window.torque, variables)
        elif element.symbol == "rotation":
            items += _around(shaft, radius, names.signal(element, "theta"), "rotation", part, "ink", window.torque, {})
        elif element.symbol == "brake":
            items += _brake(part, names.called(element), radius)
        elif element.symbol not in BODIES:
            items.append(_box(part, names.called(element), (-1 if down else 1) * (radius + 34)))
    if title and (text := " + ".join(names.part(e, "J", "m") for e in shaft.on if e.symbol in BODIES)):
        inside = radius > 26 and width(text, 13) < 1.5 * radius
        side = 1 if window is LAST else -1
        x, y, anchor = side * (radius + 6), 0.9 * radius + 5, "start" if side > 0 else "end"
        if inside:
            x, y, anchor = 0, 0.52 * radius, "middle"
        part = next(e.name for e in shaft.on if e.symbol in BODIES)
        items.append(symbols.label(text, CENTRE, x, y, anchor, part))
    items = [i if i.symbol == "label" else replace(i, nodes=(shaft.node,)) for i in items]
    return items, _legs(shaft, style, radius, down, held)


def _around(
    shaft: Turning, radius: float, text: str, symbol: str, part: str, colour: str, angles: tuple[float, float],
    variables: dict[str, str],
) -> list[Item]:  # fmt: skip
    """An arrow about a wheel between two angles (degrees), in the sense of the shaft, with a label outside of it."""
    r, (start, stop) = radius + 9, angles
    a, b = (start, stop) if shaft.sense > 0 else (stop, start)
    arrow = symbols.turning_arrow(symbol, part, CENTRE, r, radians(a), radians(b), colour, variables)
    at = radians((start + stop) / 2)
    anchor = "start" if cos(at) > 0.35 else "end" if cos(at) < -0.35 else "middle"
    x, y = (r + 6) * cos(at), -(r + 11) * sin(at)
    return [arrow, symbols.label(text, CENTRE, x, y, anchor, part, colour=colour)]


def _brake(part: str, name: str, radius: float) -> list[Item]:
    """A shoe at the left of a wheel."""
    x = -radius - 5.0
    shoe = symbols.path((x - 9, -13), (x, -13), (x, 13), (x - 9, 13), closed=True, fill="ground")
    return [Item("brake", part, (CENTRE,), (shoe,)), symbols.label(name, CENTRE, x - 15, 14, "end", part)]


def _box(part: str, name: str, y: float) -> Item:
    """A part without a symbol."""
    half = width(name, 13) / 2 + 7
    made = symbols.box("box", part, CENTRE, (-half, y - 12, half, y + 12), name)
    stem = symbols.path((0, 0), (0, y - 12 if y > 0 else y + 12))
    return replace(made, shapes=(stem, *made.shapes))


def _legs(shaft: Turning, style: Style, radius: float, down: bool, held: bool) -> list[Item]:
    """Return the supports of a wheel: springs and dampers side by side on the ground, or a bearing."""
    way = 1.0 if down else -1.0
    if not shaft.legs:
        if not held:
            return []
        stem = symbols.path((0, 0), (0, way * (radius + 14)), width=2.0)  # a cam leaves its rim
        ground = symbols.wall("", Anchor(0, way * (radius + 14)), (0, way), -15, 15, "bearing")
        return [Item("bearing", "", (Anchor(0, 0),), (stem,)), ground]
    n = len(shaft.legs)
    top = radius + 12
    xs = [(k - (n - 1) / 2) * LEGS for k in range(n)]
    met = (shaft.node,)
    stem = symbols.path((0, way * radius), (0, way * top), width=2.0)
    items = [Item("shaft", "", (CENTRE,), (stem,), nodes=met)]
    if n > 1:
        bar = symbols.path((xs[0], 0.0), (xs[-1], 0.0), width=2.0)
        items.append(Item("joint", "", (Anchor(0.0, way * top),), (bar,), nodes=met))
    for x, element in zip(xs, shaft.legs):
        a, b = Anchor(x, way * top), Anchor(x, way * (top + LEG))
        made = between(element, element.symbol, a, b, True, style.names)
        items.append(replace(made, nodes=(shaft.node, -1)))
        items.append(symbols.wall("", b, (0, way), -18, 18, "fixed-shaft"))
        text = style.names.part(element, "k", "c", "tau")
        items.append(symbols.label(text, Anchor(x, way * (top + 12)), 9, 0, "start", element.name))
    return items


def wheel(shaft: Turning, style: Style, radii: Sequence[float], gear: bool) -> list[Item]:
    """Return the disks of a shaft, the largest behind."""
    parts = [e.name for e in shaft.on if e.symbol in BODIES]
    turn = Turn(0.0, style.variables.get(shaft.node, ""), shaft.sense)
    largest, *smaller = sorted(radii, reverse=True)
    variables = {"angle": turn.variable} if turn.variable else {}
    made = symbols.wheel("wheel", parts[0] if parts else "", Anchor(0, 0), largest, turn, gear, variables)
    inner = tuple(Circle((0.0, 0.0, 0.0), r, "body") for r in smaller)
    met = (shaft.node,)
    others = [Item("wheel", name, made.ends, (), nodes=met) for name in parts[1:]]
    return [replace(made, shapes=(*made.shapes, *inner), nodes=met), *others]


# ------------------------------------------------------------------------------ gears in mesh


@dataclass(frozen=True)
class Drum:
    """A rope on a shaft, and what hangs on it: a block with its top in the middle at (0, 0).

    Attributes
    ----------
    node : of the rope's end
    direction : in which the end goes as its coordinate grows
    radius : of the drum, with its sign
    """

    part: str
    node: int
    content: Block
    direction: Direction
    radius: float

    def side(self, sense: int) -> float:
        """Return 1 where the rope's end moves as the right side of a wheel whose angle counts in some sense."""
        return 1.0 if self.direction[1] * self.radius * sense < 0 else -1.0  # y points downwards


def gears_of(strip: Strip) -> list[tuple[Element, int, int]] | None:
    """Return the gears and belts of a strip that can be drawn as wheels beside each other, None where it cannot.

    It can where they are all that joins its shafts, and they form no loop.
    """
    gears = []
    for element, a, b in strip.links:
        if element.symbol in (*GEARS, *BELTS) and not element.look.drawing:
            gears.append((element, a, b))
        elif not any(strip.held(n) is not None and strip.held(n).symbol == "fixed-shaft" for n in (a, b)):
            return None
    shafts = {n for n in strip.nodes if strip.held(n) is None or strip.held(n).symbol == "rotation"}
    if any(strip.held(n) is not None for _, a, b in gears for n in (a, b) if n not in shafts):
        return None
    if strip.hubs or len(gears) != len(shafts) - 1 or len(gears) > 8:
        return None
    touching: dict[int, int] = {}
    for _, a, b in gears:
        touching[a], touching[b] = touching.get(a, 0) + 1, touching.get(b, 0) + 1
    return gears if all(n <= 2 for n in touching.values()) else None


def turns_back(element: Element, style: Style) -> bool:
    """Return whether two wheels turn in opposite senses: in mesh, or in a crossed belt."""
    return element.symbol in GEARS or bool(style.names.graph.value(element, "crossed", 0.0))


def ratio(element: Element, style: Style) -> float:
    """Return the angle of the first shaft of a gear or a belt by that of the second."""
    graph = style.names.graph
    if element.symbol in BELTS:
        one, other = ("z1", "z2") if element.symbol == "chain" else ("r1", "r2")
        value = graph.value(element, other) / graph.value(element, one)
        value *= -1 if graph.value(element, "crossed", 0.0) else 1
    elif element.symbol == "gear":
        value = graph.value(element, "N", graph.value(element, "ratio"))
    else:
        value = -graph.value(element, "r2") / graph.value(element, "r1")
        value *= -1 if graph.value(element, "internal", 0.0) else 1
    return value if value == value and value else 1.0


def gear_row(
    strip: Strip, gears: Sequence[tuple[Element, int, int]], style: Style, drums: Mapping[int, Sequence[Drum]]
) -> Block:
    """Return gears side by side, their radii in the ratio of the gears.

    Parameters
    ----------
    drums : {shaft: what hangs on ropes there}
    """
    order, meshes = _order(strip, gears)
    size: list[tuple[float, float]] = []  # of the two wheels of each mesh
    sense = {order[0]: 1}
    for element, a, b in meshes:
        n = ratio(element, style)
        forwards = any(element is g and a == first for g, first, _ in gears)
        n = n if forwards else 1 / n
        size.append((1.0, abs(n)))
        sense[b] = -sense[a] if (n > 0) == turns_back(element, style) else sense[a]
    size = [_bounded(pair) for pair in size]
    x, placed = 0.0, {order[0]: 0.0}
    radii: dict[int, list[float]] = {n: [] for n in order}
    largest: dict[int, tuple[float, bool]] = {}  # of each shaft: radius and teeth of its largest wheel
    for (element, a, b), (ra, rb) in zip(meshes, size):
        radii[a].append(ra)
        radii[b].append(rb)
        x += ra + rb + (APART if element.symbol in BELTS else 0.0)
        placed[b] = x
        for node, radius in ((a, ra), (b, rb)):
            largest[node] = max(largest.get(node, (0.0, False)), (radius, element.symbol != "belt"))
    block = Block(())
    for k, node in enumerate(order):
        window = FIRST if k == 0 else LAST if k == len(order) - 1 else BETWEEN
        shaft, teeth = turning(strip, node, sense[node]), largest[node][1]
        own = _gear(shaft, style, radii[node], window, drums.get(node, ()), teeth)
        block = block.beside(own.at(placed[node], 0.0))
    contacts: list[Item] = []
    for (element, a, b), pair in zip(meshes, size):
        met = tuple(p.node for p in element.ports)
        if element.symbol in BELTS:
            contacts += _strands(element, style, (placed[a], placed[b]), pair, met)
            continue
        made = _contact(element, style, placed[a] + pair[0], min(pair), -1 if pair[0] <= pair[1] else 1)
        contacts += [replace(i, nodes=met if i.symbol == "mesh" else ()) for i in made]
    return Block((*block.items, *contacts), block.anchors)


def _gear(
    shaft: Turning, style: Style, radii: list[float], window: Window, drums: Sequence[Drum], teeth: bool
) -> Block:
    """The wheels of one shaft about (0, 0), with what hangs on ropes there."""
    largest = max(radii)
    items, legs = decorated(shaft, style, largest, True, window=window)
    winding = [0.55 * largest] if drums else []
    own = Block((*legs, *wheel(shaft, style, radii + winding, teeth), *items), {shaft.node: (0.0, 0.0)})
    first = drums[0].side(shaft.sense) if drums else 1.0
    for drum, side in zip(drums, (first, -first)):
        x, y = side * winding[0], largest + 30.0
        variable = style.variables.get(drum.node)
        moves = (Move(variable, *drum.direction, None, GROUP),) if variable else ()
        rope = symbols.line("string", drum.part, Anchor(x, 0.0), Anchor(x, y, moves), 1.4, "string")
        rope = replace(rope, nodes=(shaft.node, drum.node))
        own = own.beside(Block((rope,)), drum.content.at(x, y))
    return own


def _contact(element: Element, style: Style, x: float, radius: float, side: int) -> list[Item]:
    """The point where two gears touch; the ratio stands below it, on the side of the smaller wheel."""
    at = Anchor(x, 0.0)
    found = [Item("mesh", element.name, (at,), (Circle((0.0, 0.0, 0.0), 2.0, "ink"),))]
    if element.symbol == "gear":
        text = style.names.part(element, "N", "ratio")
        low = radius + (14 if len(plain(text)) == 1 else 31)
        found.append(symbols.label(text, at, side * 5, low, "start" if side > 0 else "end", element.name))
    return found


def _strands(
    element: Element, style: Style, at: tuple[float, float], radii: tuple[float, float], met: tuple[int, ...]
) -> list[Item]:
    """A belt or a chain around two wheels: the outer tangents, or the inner ones where it is crossed."""
    (x, end), (r, s) = at, radii
    crossed = bool(style.names.graph.value(element, "crossed", 0.0))
    angle = acos((r + s if crossed else r - s) / (end - x))  # of the radius to where the upper strand leaves
    far = angle - pi if crossed else angle
    around = symbols.arc(r, angle, 2 * pi - angle), symbols.arc(s, -far, far, (end - x, 0.0))
    line = {"colour": "string", "width": 2.2, "dash": (5.0, 3.0) if element.symbol == "chain" else ()}
    lower = pi - angle if crossed else -angle
    strands = [
        symbols.path((r * cos(a), -r * sin(a)), (end - x + s * cos(b), -s * sin(b)), **line)
        for a, b in ((angle, far), (-angle, lower))
    ]
    shapes = (*(Path(own, **line) for own in around), *strands)
    made = Item(element.symbol, element.name, (Anchor(x, 0.0),), shapes, nodes=met)
    middle = Anchor((x + r + end - s) / 2, -max(0.75 * (r + s) / 2, 12.0) - 10.0)
    return [made, symbols.label(style.names.called(element), middle, 0, -12.0, "middle", element.name)]


def _bounded(pair: tuple[float, float]) -> tuple[float, float]:
    """Radii in px for two in a ratio: the larger one is of the usual size, the smaller one can still be seen."""
    scale = LARGEST / max(pair)
    if min(pair) * scale >= SMALLEST:
        return pair[0] * scale, pair[1] * scale
    return tuple(max(SMALLEST, r * scale) for r in pair)


def _order(strip: Strip, gears: Sequence[tuple[Element, int, int]]) -> tuple[list[int], list[tuple[Element, int, int]]]:
    """Shafts from one end of a train of gears to the other, and the gears between them."""
    at: dict[int, list[tuple[Element, int]]] = {}
    for element, a, b in gears:
        at.setdefault(a, []).append((element, b))
        at.setdefault(b, []).append((element, a))
    shafts = [n for n in strip.nodes if n in at] or [n for n in strip.nodes if strip.held(n) is None]
    start = next((n for n in shafts if len(at.get(n, ())) <= 1), shafts[0])
    order, meshes, used = [start], [], set()
    while True:
        step = next(((g, n) for g, n in at.get(order[-1], ()) if g.name not in used), None)
        if step is None:
            return order, meshes
        used.add(step[0].name)
        meshes.append((step[0], order[-1], step[1]))
        order.append(step[1])
