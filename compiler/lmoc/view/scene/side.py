"""Shafts seen from the side: disks, the arrows of angles and torques around the shaft."""

from __future__ import annotations

from lmoc.view.scene import symbols
from lmoc.view.scene.elements import Element
from lmoc.view.scene.layout import CENTRED, Layout
from lmoc.view.scene.picture import Anchor, Item, Path, Turn
from lmoc.view.scene.standing import other, rectangle
from lmoc.view.scene.strip import BODIES, HELD
from lmoc.view.scene.text import width

DISK = 8.0  # half of its thickness
REACH = 28.0  # px of a shaft that ends in an arrow around it


def shaft_node(layout: Layout, node: int, low: float, high: float) -> None:
    """Draw a shaft with its disks, and what turns it."""
    held = layout.strip.held(node)
    end = layout.end(node)
    turned = held is not None or any(e.symbol == "torque" for e in layout.strip.on[node])
    arrows = {-1: turned, 1: node in layout.style.coordinates and held is None}
    for side in (-1, 1):
        _stubs(layout, node, side, (low + high) / 2, arrows[side])
    angle = layout.style.variables.get(node, "")
    if layout.strip.bodies(node):
        _disk(layout, node, max(34.0, (high - low) / 2 + 14), angle)
    if held is not None:  # a prescribed rotation
        around(layout, end, -16.0, 15.0, layout.names.signal(held, "theta"), "rotation", held.name, "ink")
    for element in layout.strip.on[node]:
        if element.symbol == "torque":
            around(layout, end, -20.0, 17.0, layout.names.signal(element, "tau"), "torque", element.name, "force")
        elif element.symbol == "brake":
            brake(layout, end, element)
        elif element.symbol not in (*BODIES, *HELD):
            other(layout, node, element, high)
    if node in layout.style.coordinates and held is None:
        around(layout, end, 19.0, 17.0, layout.style.coordinates[node], "coordinate", "", "ink", angle)


def _stubs(layout: Layout, node: int, side: int, middle: float, arrow: bool) -> None:
    """Draw the pieces of shaft that lead from a disk to the elements on one side, in whatever rows they are.

    Where nothing is on that side, a shaft without a disk ends in the arrow that is around it.
    """
    half, end = layout.half[node], layout.end(node)
    rows = [
        layout.rows.row[k] for k, (_, a, b, _) in enumerate(layout.parts)
        if (a if (side > 0) != (k in layout.rows.turned) else b) == node
    ]  # fmt: skip
    if not rows:
        if arrow and not layout.strip.bodies(node):
            free = symbols.path((0, 0), layout.place(side * REACH, 0), width=3.0)
            layout.items.append(Item("shaft", "", (end,), (free,)))
        return
    reached = [0.0, *(r * layout.pitch - middle for r in rows)]
    if min(reached) < max(reached):
        bar = [layout.place(side * half, t) for t in (min(reached), max(reached))]
        layout.items.append(Item("joint", "", (end,), (symbols.path(*bar, width=3.0),)))
    start = layout.place(side * DISK if layout.strip.bodies(node) else 0.0, 0.0)
    layout.items.append(Item("shaft", "", (end,), (symbols.path(start, layout.place(side * half, 0), width=3.0),)))


def _disk(layout: Layout, node: int, tall: float, angle: str) -> None:
    part, end = layout.strip.bodies(node)[0].name, layout.end(node)
    left, top, right, bottom = rectangle(layout, DISK, -tall, tall)
    shape = symbols.path((left, top), (right, top), (right, bottom), (left, bottom), closed=True, fill="body")
    layout.items.append(Item("disk", part, (end,), (shape,), Turn(), {"angle": angle}))
    layout.items += [Item("disk", e.name, (end,), ()) for e in layout.strip.bodies(node)[1:]]
    x, y, anchor = (tall + 8, 0.0, "start") if layout.upright else (0.0, -tall - 10, "middle")
    layout.labels.append(symbols.label(layout.title(node), end, x, y, anchor, part))


def around(
    layout: Layout, end: Anchor, along: float, radius: float, text: str, symbol: str, part: str, colour: str,
    angle: str = "",
) -> None:  # fmt: skip
    """An arrow around the shaft beside a disk."""
    x, y = layout.place(along, 0)
    vertices = [(0.0, x + 0.4 * (px), y + py) for _, px, py in symbols.arc(radius, -2.3, 2.3)]
    if layout.upright:
        vertices = [(0.0, x + px, y + 0.4 * py) for _, px, py in symbols.arc(radius, -2.3 + 1.57, 2.3 + 1.57)]
    tip, before = vertices[-1], vertices[-2]
    length = ((tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2) ** 0.5
    way = (tip[1] - before[1]) / length, (tip[2] - before[2]) / length
    shapes = (Path(tuple(vertices[:-1]), False, "", colour), symbols.head(tip, way, colour))
    variables = {"angle": angle} if angle else {}
    layout.items.append(Item(symbol, part, (end,), shapes, Turn(), variables))
    if text:
        dx, dy = (x + radius + 8, y) if layout.upright else (x, y + radius + 13)
        beyond = "start" if along > 0 else "end"
        anchor = "start" if layout.upright else "middle" if width(text, 13) <= CENTRED else beyond
        layout.labels.append(symbols.label(text, end, dx, dy, anchor, part, colour=colour))


def brake(layout: Layout, end: Anchor, element: Element) -> None:
    """Draw the shoes of a brake on a disk."""
    shapes = []
    for s in (1, -1):
        shapes += [symbols.path((-7, s * 36), (7, s * 36), (7, s * 43), (-7, s * 43), closed=True, fill="ground")]
    layout.items.append(Item("brake", element.name, (end,), tuple(shapes)))
    layout.labels.append(symbols.label(layout.names.called(element), end, 0, 54, "middle", element.name))
