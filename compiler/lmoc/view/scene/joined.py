"""What is joined in the model and stands apart in the picture: numbered circles say where a line goes on.

Every item says which connection sets it meets (`Item.nodes`). The items that meet one of them and touch each other are
a piece of it; a connection set in several pieces gets the same number at each.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import cos, hypot, pi, sin

import numpy as np

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block, Corners, shape_corners, united
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.picture import Anchor, Item, Label, Point
from lmoc.view.scene.placing import Ink, cleared
from lmoc.view.scene.standing import MARK, goes_on

GROUNDS = ("wall", "fixed-shaft", "ground", "anchor")  # hatching says it all
BESIDE = ("coordinate", "force", "torque", "contact")  # beside what they belong to, without touching it
ROUND = ("wheel", "pulley", "string", "unbalance", "pinion")
TOUCHING = 5.0  # px
NEAR = 60.0  # px, from an arrow to what it belongs to
LEADER = 9.0  # px, the shortest line from a piece to its number


def joined(block: Block, graph: Graph) -> Block:
    """Return the picture with numbers where a connection is not drawn as a line, and with every part in it."""
    block = _with_the_rest(block, graph)
    items = list(block.items)
    numbers: dict[int, str] = {}
    ink = Ink(items)
    for node, pieces in _pieces(items, graph).items():
        marked = [any(items[k].symbol == "continuation" for k in piece) for piece in pieces]
        if len(pieces) < 2 and not any(marked):
            continue
        numbers[node] = str(len(numbers) + 1)
        if len(pieces) > 1:
            for piece, has in zip(pieces, marked, strict=True):
                items += [] if has else _mark(items, piece, node, ink)
    return Block(tuple(cleared([_numbered(item, numbers) for item in items])), block.anchors)


def lost(block: Block, graph: Graph) -> list[tuple[str, str]]:
    """Return the ports (part, port) of a scene that no item of a picture meets."""
    met = {(item.part, node) for item in block.items for node in item.nodes}
    grounds = _grounds(graph)
    return [
        (e.name, p.name)
        for e in graph.elements
        for p in e.ports
        if p.domain != "other" and p.node not in grounds and (e.name, p.node) not in met
    ]


def _grounds(graph: Graph) -> set[int]:
    return {p.node for e in graph.elements if e.symbol in GROUNDS for p in e.ports}


def _with_the_rest(block: Block, graph: Graph) -> Block:
    """Return the picture with a box for each part without a place in it, and lines to the ports that were left out."""
    missing: dict[str, list[int]] = {}
    for name, port in lost(block, graph):
        element = next(e for e in graph.elements if e.name == name)
        missing.setdefault(name, []).append(next(p.node for p in element.ports if p.name == port))
    drawn = {item.part: item for item in block.items if item.symbol != "label" and item.part}
    boxes: list[Block] = []
    more: list[Item] = []
    for name, nodes in missing.items():
        own = drawn.get(name)
        if own is None:
            element = next(e for e in graph.elements if e.name == name)
            boxes.append(Block((_box(element, nodes),)))
        else:
            more += [_stub(own, node, k) for k, node in enumerate(dict.fromkeys(nodes))]
    block = Block((*block.items, *more), block.anchors)
    _, _, right, bottom = block.corners if block.items else (0.0, 0.0, 0.0, 0.0)
    x = 0.0
    for made in boxes:
        left, top, right, _ = made.corners
        block = block.beside(made.at(x - left, bottom + 40.0 - top))
        x += right - left + 60.0
    return block


def _box(element: Element, nodes: Sequence[int]) -> Item:
    from lmoc.view.scene.names import shortened
    from lmoc.view.scene.text import width

    text = shortened(element.name)
    half = width(text, 13) / 2 + 9
    return replace(symbols.box("box", element.name, Anchor(0, 0), (-half, -14, half, 14), text), nodes=tuple(nodes))


def _stub(item: Item, node: int, k: int) -> Item:
    """A line from an item to a port of it that is elsewhere."""
    x, y = _middle(_corners(item))
    at = Anchor(x, y, item.ends[0].moves)
    return replace(symbols.line("joint", item.part, at, at.shifted(10.0 + 8.0 * k, 16.0), 1.2), nodes=(-1, node))


def _corners(item: Item) -> Corners:
    frame = item.frame()
    found = united(shape_corners(s, frame) for s in item.drawn if not isinstance(s, Label))
    x, y = item.ends[0].x, item.ends[0].y
    return united([found, (x, y, x, y)]) if len(item.ends) == 1 else found


def _middle(c: Corners) -> Point:
    return (c[0] + c[2]) / 2, (c[1] + c[3]) / 2


def places(item: Item, node: int) -> list[Corners]:
    """Return where an item meets a connection set: an end of it, or all of an item with one end."""
    return [_corners(item)] if len(item.ends) == 1 or set(item.nodes) == {node} else _ends(item, node)


def _ends(item: Item, node: int) -> list[Corners]:
    return [(e.x, e.y, e.x, e.y) for e, n in zip(item.ends, item.nodes, strict=True) if n == node]


def _touch(a: Item, b: Item, node: int) -> bool:
    return _apart(a, b, node) < (NEAR if a.symbol in BESIDE or b.symbol in BESIDE else TOUCHING)


def _apart(a: Item, b: Item, node: int) -> float:
    return min(_distance(p, q) for p in places(a, node) for q in places(b, node))


def _distance(a: Corners, b: Corners) -> float:
    return hypot(max(a[0] - b[2], b[0] - a[2], 0.0), max(a[1] - b[3], b[1] - a[3], 0.0))


def _pieces(items: Sequence[Item], graph: Graph) -> dict[int, list[list[int]]]:
    """Return for each connection set the groups of items that touch each other."""
    grounds = _grounds(graph)
    at: dict[int, list[int]] = {}
    for k, item in enumerate(items):
        for node in dict.fromkeys(item.nodes):
            if node >= 0 and node not in grounds and item.symbol != "label":
                at.setdefault(node, []).append(k)
    return {node: _groups(items, members, node) for node, members in at.items()}


def _groups(items: Sequence[Item], members: Sequence[int], node: int) -> list[list[int]]:
    """Return items in groups of those that touch, also by way of others."""
    groups: list[list[int]] = []
    for k in sorted(members, key=lambda k: items[k].symbol in BESIDE):
        near = [g for g in groups if any(_touch(items[k], items[j], node) for j in g)]
        if items[k].symbol in BESIDE and near:  # an arrow belongs to one thing, and joins nothing
            near = [min(near, key=lambda g: min(_apart(items[k], items[j], node) for j in g))]
        groups = [g for g in groups if g not in near] + [sorted([*sum(near, []), k])]
    return sorted(groups)


def _mark(items: Sequence[Item], piece: Sequence[int], node: int, ink: Ink) -> list[Item]:
    """Return a circle beside a piece, where it covers least, and the line that leads to it."""
    found: list[tuple[Anchor, Point]] = []
    plain = [k for k in piece if items[k].symbol not in (*BESIDE, "string")]  # a rope over a wheel fills no rectangle
    # what meets other sets as well, as a belt around two wheels, tells by its ends alone where it meets this one
    exact = [k for k in plain if len(items[k].ends) > 1 or set(items[k].nodes) == {node}]
    for item in [items[k] for k in exact or plain or piece][:4]:
        # of what joins a set to itself, the coils of a spring reach beyond the line that its number belongs to
        for corners in places(item, node) if len(item.ends) == 1 else _ends(item, node):
            end = next((e for e, n in zip(item.ends, item.nodes) if n == node), item.ends[0])
            rim = item.symbol in ROUND
            found += [(Anchor(*start, end.moves), centre) for start, centre in _candidates(corners, rim)]
    room = MARK + 3.0
    boxes = [(x - room, y - room, x + room, y + room) for _, (x, y) in found]
    costs = ink.costs(boxes, 40.0) + np.array([hypot(x - start.x, y - start.y) for start, (x, y) in found])
    start, centre = found[int(costs.argmin())]
    leader = replace(symbols.line("joint", "", start, Anchor(*centre, start.moves), 1.2, "muted"), nodes=(node, node))
    made = [leader, goes_on(node, Anchor(*centre, start.moves))]
    ink.add(made)
    return made


def _candidates(corners: Corners, rim: bool) -> Iterable[tuple[Point, Point]]:
    """Yield points at the rim of a rectangle or of the wheel in it, each with a place for a circle beyond it."""
    x, y = _middle(corners)
    wide, high = (corners[2] - corners[0]) / 2, (corners[3] - corners[1]) / 2
    for away in (LEADER, 2 * LEADER, 4 * LEADER, 7 * LEADER):
        for k in range(8):
            dx, dy = cos(k * pi / 4), sin(k * pi / 4)
            far = 1.0 if rim else 2.0  # the rim of a wheel, or that of the rectangle
            start = x + max(-wide, min(wide, far * wide * dx)), y + max(-high, min(high, far * high * dy))
            yield start, (start[0] + (away + MARK) * dx, start[1] + (away + MARK) * dy)


def _numbered(item: Item, numbers: dict[int, str]) -> Item:
    if item.symbol != "continuation":
        return item
    text = numbers.get(item.nodes[0], "")
    return replace(item, shapes=tuple(replace(s, text=text) if isinstance(s, Label) else s for s in item.shapes))
