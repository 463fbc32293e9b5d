"""Elements on one node of a strip: bodies, walls, parts that have no symbol."""

from __future__ import annotations

from dataclasses import replace

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Corners
from lmoc.view.scene.elements import Element
from lmoc.view.scene.layout import MARK, Layout
from lmoc.view.scene.picture import Anchor, Circle, Item, Label
from lmoc.view.scene.strip import THICK
from lmoc.view.scene.text import width

WALL = 22.0  # px that a wall reaches beyond the last row


def rectangle(layout: Layout, half: float, low: float, high: float) -> Corners:
    """Return the corners of a box: `half` to both sides along the line, from `low` to `high` across."""
    corners = [layout.place(s * half, t) for s in (-1, 1) for t in (low, high)]
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return min(xs), min(ys), max(xs), max(ys)


def body(layout: Layout, node: int, low: float, high: float) -> None:
    """Draw the bodies of a node as one box with their names."""
    title, tall = layout.title(node), (high - low) / 2
    thick = max(THICK, width(title, 13) / 2 + 9 - tall) if layout.upright else THICK
    corners = rectangle(layout, layout.half[node], -tall - thick, tall + thick)
    variables = {"coordinate": layout.style.variables[node]}
    part, *others = (e.name for e in layout.strip.bodies(node))
    layout.items.append(symbols.box("mass", part, layout.end(node), corners, title, variables))
    layout.items += [Item("mass", name, (layout.end(node),), ()) for name in others]


def goes_on(node: int, end: Anchor) -> Item:
    """Return the mark at which a line breaks off that goes on at a node; its number is given later (`joined`)."""
    label = Label("", (0.0, 0.0, 0.0), size=11.0, colour="muted")
    return Item(
        "continuation", "", (end,), (Circle((0.0, 0.0, 0.0), MARK, "paper", "muted"), label), nodes=(node,)
    )


def hub(layout: Layout, node: int, low: float, high: float) -> None:
    """Draw a part with three ports or more as a box with its name, a planetary gear with its wheels in the box."""
    element, tall = layout.strip.hubs[node], (high - low) / 2 + 16
    corners = rectangle(layout, layout.half[node], -tall, tall)
    made = symbols.box("box", element.name, layout.end(node), corners, layout.names.called(element))
    if element.symbol == "planetary-gear":
        made = replace(made, shapes=symbols.planetary(corners, made.shapes))
        _name_ports(layout, node, element)
    layout.items.append(made)


def _name_ports(layout: Layout, node: int, element: Element) -> None:
    """Write the first letters of ports beside the box where they leave it."""
    lines = [(b if a == node else a, k) for k, (_, a, b, _) in enumerate(layout.parts) if node in (a, b)]
    left = list(element.ports)
    for other, k in sorted(lines, key=lambda line: all(p.node != line[0] for p in left)):  # a wall's piece has no port
        port = next((p for p in left if p.node == other), left[0])
        left.remove(port)
        side = 1 if layout.rows.along[other] > layout.rows.along[node] else -1
        at = layout.end(node, side * (layout.half[node] + 8.0), layout.rows.row[k] * layout.pitch)
        layout.labels.append(symbols.label(port.name[0], at, 0.0, -10.0, "middle", element.name, "muted"))


def wall(layout: Layout, node: int, held: Element, low: float, high: float) -> None:
    """Draw a wall on the side where nothing is connected, or the bar of a prescribed motion."""
    sign = -1.0 if layout.leaves(node) or not layout.parts else 1.0
    outwards = layout.direction[0] * sign, layout.direction[1] * sign
    middle = (low + high) / 2
    reach = 24.0 if layout.strip.shaft else 20.0 if high == low else 16.0
    at = layout.end(node, -sign * layout.half[node]) if layout.strip.shaft else layout.end(node)
    if held.symbol in ("wall", "fixed-shaft"):
        ends = low - reach - middle, high + reach - middle
        layout.items.append(symbols.wall(held.name, at, outwards, *ends, held.symbol))
    else:
        a, b = layout.end(node, 0, low - reach), layout.end(node, 0, high + reach)
        layout.items.append(symbols.line("motion", held.name, a, b, 5.0))


def other(layout: Layout, node: int, element: Element, high: float) -> None:
    """Draw a part that has no symbol and one port here: a box, or its own drawing, on a stem."""
    text = layout.names.called(element)
    half = width(text, 13) / 2 + 8
    held = layout.strip.held(node)
    beyond = THICK if layout.strip.bodies(node) else WALL if held is not None and held.symbol == "wall" else 0.0
    at = layout.end(node, 0, high + beyond)
    made = symbols.box("box", element.name, at, (-half, 14, half, 38), text)
    shapes = made.shapes
    if element.look.drawing:
        shapes = tuple(symbols.lowered(s, 36.0) for s in symbols.icon(element.look.drawing, 22, 22, text))
    layout.items.append(replace(made, shapes=(symbols.path((0, 0), (0, 14)), *shapes)))
