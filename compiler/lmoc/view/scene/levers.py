"""Levers: a bar on a pivot whose ends move strips, arms, and beams on a pivot that moves itself."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from lmoc.support.records import dataclass
from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.picture import Anchor, Item, Label, Move, Path, Turn
from lmoc.view.scene.ropes import Hanging
from lmoc.view.scene.strip import BODIES, DOWN, GROUP, RIGHT, UP, Direction, Strip, Style
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.wheels import Turning, decorated

LONGEST = 130.0  # px, the longer arm, where nothing asks for more
APART = 54.0
HANGING = 84.0  # px, length of a pendulum


@dataclass(frozen=True)
class Tip:
    """The end of an arm: its signed length, and the node it moves."""

    length: float
    node: int


def tips(element: Element, graph: Graph) -> list[Tip]:
    """Return the ends of a lever, an arm or a beam."""
    found = []
    for port, name in (("a", "l1"), ("b", "l2"), ("flange", "l")):
        own = element.port(port)
        if own is not None:
            value = graph.value(element, name)
            found.append(Tip(value if isfinite(value) and value else 1.0, own.node))
    return found


def draw_pendulum(shaft: Turning, style: Style) -> Block:
    """Return what swings about a shaft under its weight, hanging from its pivot."""
    bodies = [e for e in shaft.on if e.symbol in BODIES]
    turn = Turn(0.0, style.variables.get(shaft.node, ""), shaft.sense, 0.0)
    shapes = (symbols.path((0, 0), (0, HANGING), width=5.0), symbols.Circle((0, 0, HANGING), 11.0, "body"))
    first, *others = (e.name for e in bodies)
    variables = {"angle": turn.variable} if turn.variable else {}
    bar = Item("pendulum", first, (Anchor(0, 0),), shapes, turn, variables, nodes=(shaft.node,))
    more = [Item("pendulum", name, (Anchor(0, 0),), (), nodes=(shaft.node,)) for name in others]
    items, legs = decorated(shaft, style, 18.0, False, title=False)
    title = " + ".join(style.names.part(e, "m", "J") for e in bodies)
    name = symbols.label(title, Anchor(0, 0), 16.0, HANGING, "start", first)
    stem = symbols.path((0, 0), (0, -18.0), width=2.0)
    hinge = (stem, symbols.Circle((0, 0, 0), 3.0, "paper"))
    held = Item("pivot", "", (Anchor(0, 0),), hinge, nodes=(shaft.node,))
    pivot = [held if shaft.legs else symbols.pivot("", Anchor(0, 0), (0.0, -1.0))]
    return Block((*pivot, bar, *more, *legs, *items, name))


def draw_lever(element: Element, shaft: Turning | None, hanging: Hanging) -> Block:
    """Return a lever with everything at its ends; upright, unless something there has weight."""
    ends = tips(element, hanging.style.names.graph)
    strips = [hanging.strips.get(t.node) for t in ends]
    level = element.symbol == "beam" or any(s is not None and hanging.weights(s) for s in strips)
    return _level(element, shaft, ends, hanging) if level else _upright(element, shaft, ends, hanging)


def _bar(element: Element, points: Sequence[tuple[float, float]], shaft: Turning | None, hanging: Hanging) -> Item:
    """The lever itself, turning about (0, 0)."""
    vertices = tuple((0.0, x, y) for x, y in sorted((*points, (0.0, 0.0))))
    turn = Turn(0.0, hanging.style.variables.get(shaft.node, "") if shaft else "")
    met = tuple(p.node for p in element.ports)
    shape = Path(vertices, width=5.0)
    return Item("lever", element.name, (Anchor(0, 0),), (shape,), turn, {"angle": turn.variable}, nodes=met)


def _pivot(element: Element, shaft: Turning | None, hanging: Hanging, down: bool) -> list[Item]:
    items = [symbols.pivot("", Anchor(0, 0), (0.0, 1.0 if down else -1.0))]
    if shaft is not None:
        more, legs = decorated(shaft, hanging.style, 18.0, down, title=False)
        names = [hanging.style.names.part(e, "J", "m") for e in shaft.on if e.symbol in BODIES]
        if names:
            bodies = [e.name for e in shaft.on if e.symbol in BODIES]
            part = bodies[0]
            more += [Item("body", name, (Anchor(0, 0),), (), nodes=(shaft.node,)) for name in bodies]
            more.append(symbols.label(" + ".join(names), Anchor(0, 0), 22, 10 if down else 4, "start", part))
        items += [*legs, *more]
    return items


def _upright(element: Element, shaft: Turning | None, ends: Sequence[Tip], hanging: Hanging) -> Block:
    """Ends move to the right where the lever, which hangs from its pivot, turns counter-clockwise."""
    placed: list[tuple[Tip, Block, bool]] = []
    for tip in ends:
        strip = hanging.strips.get(tip.node)
        if strip is None or id(strip) in hanging.used or not hanging.shown(strip):
            placed.append((tip, Block(()), False))
            continue
        hanging.used.add(id(strip))
        drawn = draw_strip(strip, hanging.style, RIGHT)
        x, y = drawn.block.anchors[tip.node]
        beyond = drawn.is_first(tip.node) and not drawn.is_last(tip.node)
        side = -1.0 if beyond else 1.0
        placed.append((tip, drawn.block.at(-x - side * (drawn.reach[tip.node] + 2.0), -y), True))
    scale = _scale(placed)
    items = [_bar(element, [(0.0, t.length * scale) for t in ends], shaft, hanging)]
    block = Block(())
    for tip, content, _ in placed:
        y = tip.length * scale
        items.append(_joint_dot(tip, (0.0, y), RIGHT, hanging))
        block = block.beside(content.at(0.0, y))
    return block.beside(Block((*_pivot(element, shaft, hanging, False), *items)))


def _joint_dot(tip: Tip, at: tuple[float, float], direction: Direction, hanging: Hanging) -> Item:
    variable = hanging.style.variables.get(tip.node)
    moves = (Move(variable, direction[0], direction[1], None, GROUP),) if variable else ()
    return Item("joint", "", (Anchor(*at, moves),), (symbols.Circle((0, 0, 0), 3.0, "paper"),), nodes=(tip.node,))


def _scale(placed: Sequence[tuple[Tip, Block, bool]]) -> float:
    """Pixels per metre, such that what is at the ends does not overlap."""
    longest = max(abs(t.length) for t, _, _ in placed)
    scale = LONGEST / longest
    tops = sorted((t.length, b.corners) for t, b, shown in placed if shown)
    for (l1, c1), (l2, c2) in zip(tops, tops[1:]):
        if l2 > l1:
            scale = max(scale, (c1[3] - c2[1] + 12) / (l2 - l1))
    nearest = min((t.length, -b.corners[1]) for t, b, shown in placed if shown) if tops else (longest, 0.0)
    if nearest[0] > 0:
        scale = max(scale, (nearest[1] + 24) / nearest[0])
    return min(scale, 420.0 / longest)


def _level(element: Element, shaft: Turning | None, ends: Sequence[Tip], hanging: Hanging) -> Block:
    """Ends that count upwards are to the right of the pivot for positive arms: there they rise with the angle."""
    beam = element.symbol == "beam"
    placed = []
    for tip in ends:
        strip = hanging.strips.get(tip.node)
        gravity = hanging.weights(strip) if strip is not None else 0.0
        up = beam or gravity <= 0
        placed.append((tip, strip, up))
    pivot = element.port("pivot") if beam else None
    contents: list[tuple[Tip, float, Block]] = []
    for tip, strip, up in placed:
        side = 1.0 if up else -1.0
        contents.append((tip, tip.length * side, _at_end(tip.node, strip, up, hanging)))
    own = _at_end(pivot.node, hanging.strips.get(pivot.node), True, hanging) if pivot is not None else Block(())
    scale = _level_scale(contents, own)
    points = [(length * scale, 0.0) for _, length, _ in contents]
    block = Block(())
    items: list[Item] = []
    for (tip, length, content), (_, _, up) in zip(contents, placed):
        items.append(_joint_dot(tip, (length * scale, 0.0), UP if up else DOWN, hanging))
        block = block.beside(content.at(length * scale, 0.0))
    if beam:
        bar = _beam(element, contents, scale, hanging)
        return block.beside(own, Block((bar, *items, *_beam_names(element, pivot.node, hanging))))
    return block.beside(Block((*_pivot(element, shaft, hanging, True), _bar(element, points, shaft, hanging), *items)))


def _at_end(node: int, strip: Strip | None, up: bool, hanging: Hanging) -> Block:
    """Return the element at an end: below it where it supports the end, else above."""
    if strip is None or id(strip) in hanging.used or not hanging.shown(strip):
        return Block(())
    hanging.used.add(id(strip))
    drawn = draw_strip(strip, hanging.style, UP if up else DOWN)
    x, y = drawn.block.anchors[node]
    alone = drawn.is_first(node) and drawn.is_last(node)
    below = (drawn.is_last(node) if up else drawn.is_first(node)) and not alone
    reach = drawn.reach[node] + 2.5
    return drawn.block.at(-x, -y + reach if below else -y - reach)


def _level_scale(contents: Sequence[tuple[Tip, float, Block]], own: Block) -> float:
    longest = max(abs(length) for _, length, _ in contents)
    scale = LONGEST / longest
    across = [(length, b.corners) for _, length, b in contents if b.items]
    across = sorted(across + ([(0.0, own.corners)] if own.items else []))
    for (l1, c1), (l2, c2) in zip(across, across[1:]):
        if l2 > l1:
            scale = max(scale, (c1[2] - c2[0] + 14) / (l2 - l1))
    return min(scale, 420.0 / longest)


def _beam(element: Element, contents: Sequence[tuple[Tip, float, Block]], scale: float, hanging: Hanging) -> Item:
    """A rigid bar between two ends that move."""
    ends = []
    for tip, length, _ in sorted(contents, key=lambda c: c[1])[:: len(contents) - 1 or 1]:
        variable = hanging.style.variables.get(tip.node)
        moves = (Move(variable, *UP, None, GROUP),) if variable else ()
        ends.append(Anchor(length * scale, 0.0, moves))
    corners = ((0, -8, -5), (1, 8, -5), (1, 8, 5), (0, -8, 5))
    met = tuple(tip.node for tip, _, _ in sorted(contents, key=lambda c: c[1])[:: len(contents) - 1 or 1])
    return Item("beam", element.name, tuple(ends), (Path(corners, True, "body"),), Turn(), {}, nodes=met)


def _beam_names(element: Element, pivot: int, hanging: Hanging) -> list[Item]:
    names, style = hanging.style.names, hanging.style
    text = names.part(element, "m", "J")
    hinge = symbols.Circle((0, 0, 0), 3.5, "paper")
    moves = (Move(variable, *UP, None, GROUP),) if (variable := style.variables.get(pivot)) else ()
    at = Anchor(0, 0, moves)
    items = [Item("pivot", element.name, (at,), (hinge,), nodes=(pivot,))]
    items.append(Item("label", element.name, (at,), (Label(text, (0, 0, -20)),)))
    if pivot in style.coordinates:
        shapes = (Label(style.coordinates[pivot], (0, -10, -40), "end"),)
        items.append(symbols.arrow("coordinate", "", Anchor(0, -8), (-4, -22), (-4, -50), "ink", 1.2, shapes))
    return items
