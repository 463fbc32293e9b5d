"""What a picture joins, compared with what its model joins: found from the picture's geometry, not from its layout."""

from __future__ import annotations

from itertools import combinations
from math import hypot

from lmoc.ir.flat import FlatDAE
from lmoc.view.scene.abbreviate import shown
from lmoc.view.scene.block import shape_corners
from lmoc.view.scene.picture import Circle, Item, Label, Picture
from lmoc.view.scene.picture import Path as Outline
from lmoc.view.scene.placing import points_of
from lmoc.view.scene.text import plain

GROUNDS = ("wall", "fixed-shaft", "ground", "anchor")
LOOSE = ("coordinate", "force", "torque", "contact")  # arrows beside a body, and the wall that a point may meet
NEAR, BESIDE = 6.0, 80.0  # px


def region(item: Item, node: int) -> tuple[list, list]:
    """The points and the areas where an item meets a connection set."""
    if len(item.ends) == 2 and len(set(item.nodes)) == 2:
        return [(e.x, e.y) for e, n in zip(item.ends, item.nodes, strict=True) if n == node], []
    closed = [s for s in item.drawn if isinstance(s, Circle) or isinstance(s, Outline) and s.closed]
    areas = [shape_corners(s, item.frame()) for s in closed]
    return [*points_of(item), *((e.x, e.y) for e in item.ends)], areas


def distance(a: tuple[list, list], b: tuple[list, list]) -> float:
    found = [hypot(p[0] - q[0], p[1] - q[1]) for p in a[0] for q in b[0]]
    for points, areas in ((a[0], b[1]), (b[0], a[1])):
        found += [hypot(max(l - x, x - r, 0), max(t - y, y - b_, 0)) for x, y in points for l, t, r, b_ in areas]
    return min(found)


def number_of(item: Item) -> str:
    texts = [s.text for s in item.shapes if isinstance(s, Label)]
    return texts[0] if item.symbol == "continuation" and len(item.ends) == 1 else ""


def pieces(items: list[Item], node: int) -> list[set[int]]:
    """Groups of items at a connection set that touch, or show the same number."""
    regions = [region(i, node) for i in items]
    groups = [{k} for k in range(len(items))]
    for j, k in combinations(range(len(items)), 2):
        near = BESIDE if {items[j].symbol, items[k].symbol} & set(LOOSE) else NEAR
        told = number_of(items[j]) and number_of(items[j]) == number_of(items[k])
        slides = items[j].part == items[k].part != "" and {items[j].symbol, items[k].symbol} == {"rail", "slider"}
        if told or slides or distance(regions[j], regions[k]) < near:
            one, other = (next(g for g in groups if n in g) for n in (j, k))
            if one is not other:
                groups.remove(other)
                one |= other
    return groups


def lost(flat: FlatDAE, picture: Picture) -> list[str]:
    """What the model joins and the picture does not."""
    elements = shown(flat, flat.parameter_values()).graph.elements
    grounds = {p.node for e in elements if e.symbol in GROUNDS for p in e.ports}
    found, nodes = [], {}
    for element in elements:
        for port in element.ports:
            if port.domain == "other" or port.node in grounds:
                continue
            nodes.setdefault(port.node, []).append(f"{element.name}.{port.name}")
            if not any(i.part == element.name and port.node in i.nodes for i in picture.items):
                found.append(f"{element.name}.{port.name} is not drawn")
    for node, ports in nodes.items():
        items = [i for i in picture.items if node in i.nodes and i.symbol != "label"]
        if len(pieces(items, node)) > 1:
            found.append(f"{' - '.join(ports)} falls apart")
    return found


def overlapping(picture: Picture) -> list[tuple[str, str]]:
    labels = [(plain(s.text), shape_corners(s, f)) for _, s, f in picture.placed() if isinstance(s, Label) and s.text]
    return [
        (a, b)
        for (a, x), (b, y) in combinations(labels, 2)
        if min(min(x[2], y[2]) - max(x[0], y[0]), min(x[3], y[3]) - max(x[1], y[1])) > 0.5
    ]


def numbers_mean_one_thing(picture: Picture) -> bool:
    """A number stands for one connection set."""
    told = {(number_of(i), i.nodes[0]) for i in picture.items if number_of(i)}
    return len({n for n, _ in told}) == len(told) == len({node for _, node in told})
