"""Dimension lines, on request: the lengths of bars, rods, links and lever arms."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, isfinite

import numpy as np

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Anchor, Item, Label, Path, Point
from lmoc.view.scene.placing import Ink, cleared

ASIDE = (22.0, -22.0, 34.0, -34.0, 48.0, -48.0, 66.0, -66.0)  # px from what is measured
SHORTEST = 24.0  # px that a dimension line takes
LENGTHS = {"bar": ("l",), "rod": ("L",), "link": ("rx", "ry"), "lever": ("l1", "l2", "l"), "beam": ("l1", "l2")}


def dimensioned(block: Block, graph: Graph, names: Names) -> Block:
    """Return a picture with the lengths of its parts."""
    items = list(block.items)
    ink = Ink(items)
    elements = {e.name: e for e in graph.elements}
    for item in block.items:
        element = elements.get(item.part)
        if element is None or element.symbol not in (*LENGTHS, "arm") or item.symbol not in LENGTHS:
            continue
        for a, b, text in _measured(item, element, graph, names):
            if hypot(b.x - a.x, b.y - a.y) >= SHORTEST:
                made = _line(a, b, text, element.name, ink)
                ink.add([made])
                items.append(made)
    return Block(tuple(cleared(items)), block.anchors)


def _measured(item: Item, element: Element, graph: Graph, names: Names) -> Iterator[tuple[Anchor, Anchor, str]]:
    """Yield what is measured of a part: from where, to where, and what it says."""
    known = [(n, graph.value(element, n)) for n in LENGTHS[item.symbol]]
    known = [(n, v) for n, v in known if isfinite(v) and v]
    if len(item.ends) == 2 and item.symbol != "beam":
        if len(known) == 1:
            yield item.ends[0], item.ends[1], _text(element, *known[0], names)
        elif known:  # a link across: its length
            yield item.ends[0], item.ends[1], _number(hypot(*(v for _, v in known)))
        return
    if len(item.ends) == 2:
        a, b = item.ends
        whole = sum(abs(v) for _, v in known)
        if len(known) == 2 and known[0][1] * known[1][1] < 0:
            low, high = sorted(known, key=lambda k: k[1])
            part = abs(low[1]) / whole
            middle = Anchor(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.moves)
            yield a, middle, _text(element, *low, names)
            yield middle, b, _text(element, *high, names)
        return
    frame, shape = item.frame(), item.shapes[0]
    if not isinstance(shape, Path):
        return
    tips = sorted((v for v in shape.vertices if hypot(v[1], v[2]) > 1), key=lambda v: hypot(v[1], v[2]))
    for vertex, (name, value) in zip(tips, sorted(known, key=lambda k: abs(k[1])), strict=False):
        yield item.ends[0], Anchor(*frame.place(vertex)), _text(element, name, value, names)


def _text(element: Element, name: str, value: float, names: Names) -> str:
    own = names.parameter(element, name)
    return f"{own} = {_number(abs(value))}" if own else _number(abs(value))


def _number(value: float) -> str:
    return f"{value:.4g} m"


def _line(a: Anchor, b: Anchor, text: str, part: str, ink: Ink) -> Item:
    """A dimension line beside two points, on the side and as far away as covers least."""
    length = hypot(b.x - a.x, b.y - a.y)
    nx, ny = -(b.y - a.y) / length, (b.x - a.x) / length
    middle: Point = (a.x + b.x) / 2, (a.y + b.y) / 2
    half = 0.5 * symbols.widest([text]) + 2.0

    def box_at(off: float) -> tuple[float, float, float, float]:
        x, y = middle[0] + nx * _beyond(off, nx, half), middle[1] + ny * _beyond(off, ny, half)
        return x - half, y - 9.0, x + half, y + 9.0

    def line_at(off: float) -> list[tuple[float, float, float, float]]:
        x, y, dx, dy = a.x + nx * off, a.y + ny * off, b.x - a.x, b.y - a.y
        places = [(x + t * dx, y + t * dy) for t in np.linspace(0.1, 0.9, 9)]
        return [(x - 2.5, y - 2.5, x + 2.5, y + 2.5) for x, y in places]

    costs = ink.costs([box_at(off) for off in ASIDE], 10.0) + np.abs(ASIDE)
    costs += [0.5 * ink.costs(line_at(off), 10.0).sum() for off in ASIDE]
    off = ASIDE[int(costs.argmin())]
    along = symbols.head((1, 0, off), (1, 0), "muted"), symbols.head((0, 0, off), (-1, 0), "muted")
    over = off + (5.0 if off > 0 else -5.0)
    lines = [Path(((0, 0, off), (1, 0, off)), False, "", "muted", 1.0)]
    lines += [Path(((f, 0, 0), (f, 0, over)), False, "", "muted", 0.8) for f in (0, 1)]
    x0, y0, x1, y1 = box_at(off)
    x, y = (x0 + x1) / 2 - a.x, (y0 + y1) / 2 - a.y
    cos, sin = ny, -nx
    label = Label(text, (0.0, x * cos + y * sin, y * cos - x * sin), size=12.0, colour="muted")
    return Item("dimension", part, (Anchor(a.x, a.y, a.moves), Anchor(b.x, b.y, b.moves)), (*lines, *along, label))


def _beyond(off: float, component: float, half: float) -> float:
    """How far the middle of a text stands from what is measured: clear of its dimension line, however that lies."""
    away = abs(off) + 10.0 + abs(component) * (half - 7.0)
    return away if off > 0 else -away
