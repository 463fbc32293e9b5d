"""Wheels on a road: a line with its bodies, and below it the wheels that carry them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Circle, Item, Move
from lmoc.view.scene.ropes import Hanging, rod
from lmoc.view.scene.strip import BODIES, GROUP, RIGHT, THICK, Strip
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.wheels import Turning, decorated, wheel

LARGEST, SMALLEST = 34.0, 16.0  # px, radii
ARROWS = 44.0  # beside and above a wheel, where arrows and names are
BEYOND = 26.0  # of the road, at both ends


def draw_road(
    wheels: Sequence[Element], strip: Strip | None, shafts: Mapping[str, Turning], hanging: Hanging
) -> Block:
    """Return the wheels of one line of bodies, which lies level; +q is to the right, so that they turn clockwise.

    Parameters
    ----------
    strip : None where it is drawn elsewhere
    shafts : {wheel: its shaft, as far as it is drawn at the wheel}
    """
    nodes = {w.name: w.port("flange").node for w in wheels}
    line = Block((), {n: (0.0, 0.0) for n in nodes.values()})
    if strip is not None:
        hanging.used.add(id(strip))
        line = draw_strip(strip, hanging.style, RIGHT).block
    radii = _radii(wheels, hanging)
    places = _places(wheels, line, radii, nodes)
    low = line.corners[3] if line.items else 0.0
    arrows = any(s.on or s.node in hanging.style.coordinates for s in shafts.values())
    ground = low + 8.0 + (ARROWS if arrows else 8.0) + 2 * max(radii.values())
    axles: list[Item] = []
    block = Block(())
    for w in wheels:
        x, r, node = places[w.name], radii[w.name], nodes[w.name]
        left, top = line.anchors[node]
        above = left, top + (THICK if strip is not None and strip.bodies(node) else 0.0)
        axles += _axle(w, above, Anchor(x, ground - r), low + 8.0, hanging)
        block = block.beside(_wheel(w, shafts[w.name], r, hanging).at(x, ground - r))
    begin = min(places[w.name] - radii[w.name] for w in wheels) - BEYOND
    end = max(places[w.name] + radii[w.name] for w in wheels) + BEYOND
    road = symbols.wall("", Anchor(0.0, ground), (0.0, 1.0), begin, end, "road")
    return Block(tuple(axles)).beside(line, block, Block((road,)))


def _radii(wheels: Sequence[Element], hanging: Hanging) -> dict[str, float]:
    """Return radii in px, as far as they can be seen in their ratio."""
    values = {w.name: hanging.style.names.graph.value(w, "r", 1.0) for w in wheels}
    values = {name: r if isfinite(r) and r > 0 else 0.0 for name, r in values.items()}
    largest = max(values.values()) or 1.0
    return {name: max(SMALLEST, LARGEST * r / largest) for name, r in values.items()}


def _places(
    wheels: Sequence[Element], line: Block, radii: Mapping[str, float], nodes: Mapping[str, int]
) -> dict[str, float]:
    """Return where the wheels are along the road: below their bodies, side by side."""
    order = sorted(wheels, key=lambda w: line.anchors[nodes[w.name]][0])
    found: dict[str, float] = {}
    free = float("-inf")
    for w in order:
        own = [o for o in order if nodes[o.name] == nodes[w.name]]
        room = 2 * (max(radii[o.name] for o in own) + ARROWS)
        at = line.anchors[nodes[w.name]][0] + (own.index(w) - (len(own) - 1) / 2) * room
        found[w.name] = max(at, free + radii[w.name] + ARROWS)
        free = found[w.name] + radii[w.name] + ARROWS
    return found


def _moves(node: int, hanging: Hanging) -> tuple[Move, ...]:
    variable = hanging.style.variables.get(node)
    return (Move(variable, *RIGHT, None, GROUP),) if variable else ()


def _axle(w: Element, above: tuple[float, float], centre: Anchor, level: float, hanging: Hanging) -> list[Item]:
    """What joins a body and the axle of its wheel: straight pieces, down, aside and down again."""
    node = w.port("flange").node
    moves = _moves(node, hanging)
    begin, end = (centre.x, centre.y), above
    points = [begin, (begin[0], level), (end[0], level), end] if begin[0] != end[0] else [begin, end]
    ends = [Anchor(*point, moves) for point in points]
    return [rod(node, a, b) for a, b in zip(ends, ends[1:])]


def _wheel(w: Element, shaft: Turning, radius: float, hanging: Hanging) -> Block:
    """A wheel about (0, 0), with what drives it; everything moves along with its axle."""
    node = w.port("flange").node
    moves = _moves(node, hanging)
    shaft = replace(shaft, sense=-1)
    items, _ = decorated(shaft, hanging.style, radius, False, title=False)
    names = hanging.style.names
    bodies = [names.part(e, "J", "m") for e in shaft.on if e.symbol in BODIES]
    place = (0.0, 0.52 * radius, "middle") if bodies and radius > 26 else (radius + 6, -2.0, "start")
    items.append(symbols.label(" + ".join(bodies) or names.part(w, "r"), Anchor(0, 0), *place, w.name))
    disk = wheel(shaft, hanging.style, [radius], False)
    met = node, w.port("shaft").node
    axle = Item("wheel", w.name, (Anchor(0, 0),), (Circle((0.0, 0.0, 0.0), 3.5, "paper"),), nodes=met)
    made = [*disk, axle, *items]
    moved = [replace(i, ends=tuple(replace(e, moves=(*e.moves, *moves)) for e in i.ends)) for i in made]
    return Block(tuple(moved), {w.port("shaft").node: (0.0, 0.0)})
