"""Arrows beside a strip: the coordinates with their reference lines, and given forces."""

from __future__ import annotations

from lmoc.view.scene import symbols
from lmoc.view.scene.elements import Element
from lmoc.view.scene.layout import Layout
from lmoc.view.scene.picture import Anchor, Item, Label, Path, Point, Turn, middle
from lmoc.view.scene.strip import ARROW, THICK
from lmoc.view.scene.text import width

WITHIN = 12.0  # px, an arrow inside of a body


def force(layout: Layout, node: int, element: Element, high: float) -> None:
    """An arrow along +q: from the free side of the body, or below it."""
    text = layout.names.signal(element, "f")
    dx, dy = layout.direction
    half = layout.half[node] if layout.strip.bodies(node) else 3.0
    variables = {"force": f"{element.name}.f"}
    if not layout.leaves(node):
        at = layout.end(node, half)
        tip = (dx * ARROW, dy * ARROW)
        layout.items.append(symbols.arrow("force", element.name, at, (0, 0), tip, "force", 2.0, (), variables))
        if layout.upright:
            layout.labels.append(symbols.label(text, at, 12, dy * (ARROW - 6), "start", element.name, colour="force"))
        else:
            layout.labels.append(symbols.label(text, at, ARROW + 6, 0, "start", element.name, colour="force"))
        return
    thick = THICK + 11 if layout.strip.bodies(node) else 16
    at = layout.end(node, 0, high + thick)
    if layout.upright:
        tail, tip = (0, -dy * ARROW / 2), (0, dy * ARROW / 2)
        layout.labels.append(symbols.label(text, at, 8, 0, "start", element.name, colour="force"))
    else:
        tail, tip = (-4, 0), (ARROW - 4, 0)
        layout.labels.append(symbols.label(text, at, ARROW + 2, 0, "start", element.name, colour="force"))
    layout.items.append(symbols.arrow("force", element.name, at, tail, tip, "force", 2.0, (), variables))


def crowded(layout: Layout, node: int, row: float) -> bool:
    """Return whether an element or another body is where a coordinate's arrow beside a row would be."""
    rows, x = layout.rows, layout.rows.along[node]
    end = x + ARROW + 5 + width(layout.style.coordinates[node], 13)
    for k, (_, a, b, _) in enumerate(layout.parts):
        start, stop = sorted((rows.along[a], rows.along[b]))
        if abs(rows.row[k] - row) < 0.8 and start < end and stop > x:
            return True
    for other in (n for n in layout.strip.nodes if n != node and layout.strip.bodies(n)):
        low, high = rows.span[other]
        if low - 0.8 < row < high + 0.8 and abs(rows.along[other] - (x + end) / 2) < layout.half[other] + (end - x) / 2:
            return True
    return False


def _free_side(layout: Layout, node: int, low: float, high: float, thick: float) -> int:
    """Return 1 where something stands to the left of a body and nothing to its right, otherwise -1."""
    rows, pitch, x = layout.rows, layout.pitch, layout.rows.along[node]
    room = thick + 28.0 + width(layout.style.coordinates[node], 13)

    def taken(left: float, right: float) -> bool:
        bodies = [n for n in layout.strip.nodes if n != node and layout.strip.bodies(n)]
        others = [(rows.span[n][0] * pitch - THICK, rows.span[n][1] * pitch + THICK,
                   rows.along[n] - layout.half[n], rows.along[n] + layout.half[n]) for n in bodies]  # fmt: skip
        for k, (_, a, b, _) in enumerate(layout.parts):
            start, stop = sorted((rows.along[a], rows.along[b]))
            others.append((rows.row[k] * pitch - 12.0, rows.row[k] * pitch + 12.0, start + 1.0, stop - 1.0))
        return any(a < right and left < b and c < x + 30.0 and x - 4.0 < d for a, b, c, d in others)

    return 1 if taken(low - room, low - thick) and not taken(high + thick, high + room) else -1


def coordinate(layout: Layout, node: int, low: float, high: float) -> None:
    """A reference line and an arrow along +q, above the body or to its left; on its other side where that has room."""
    text = layout.style.coordinates[node]
    dx, dy = layout.direction
    thick = THICK if layout.strip.bodies(node) else 18.0
    if layout.upright and layout.strip.bodies(node):
        thick = max(thick, width(layout.title(node), 13) / 2 + 9)
    at = layout.place(layout.rows.along[node], low)
    end = Anchor(*at)
    if not layout.upright and crowded(layout, node, low / layout.pitch - 1):
        pushed = any(e.symbol == "force" for e in layout.strip.on[node])
        foot = Anchor(at[0], layout.place(0.0, high)[1])
        if not pushed and not crowded(layout, node, high / layout.pitch + 1):
            coordinate_below(layout, node, foot, thick)
            return
        if layout.strip.bodies(node) and WITHIN + width(text, 13) + 10 < 2 * layout.half[node]:
            coordinate_within(layout, node, foot)
            return
    if not layout.upright and is_loose(layout, node):
        shapes = (Label(text, (0, ARROW + 10, 0), "start"),)
        variables = {"coordinate": layout.style.variables[node]}
        tip = (ARROW + 5, 0.0)
        made = symbols.arrow("coordinate", "", layout.end(node), (6, 0), tip, "ink", 1.2, shapes, variables)
        layout.labels.append(made)
        return
    if layout.upright:
        side = _free_side(layout, node, low, high, thick)
        if side > 0:
            end = Anchor(layout.place(0.0, high)[0], at[1])
        ref = _reference((side * (thick + 3), 0), (side * (thick + 28), 0))
        x = side * (thick + 19)
        shapes = (ref, Label(text, (0, x + side * 6, dy * 19), "start" if side > 0 else "end"))
        tail, tip = (x, 0), (x, dy * 28)
    else:
        ref = _reference((0, -thick - 3), (0, -thick - 26))
        shapes = (ref, Label(text, (0, ARROW + 5, -thick - 19), "start"))
        tail, tip = (0, -thick - 19), (ARROW, -thick - 19)
    variables = {"coordinate": layout.style.variables[node]}
    layout.labels.append(symbols.arrow("coordinate", "", end, tail, tip, "ink", 1.2, shapes, variables))


def is_loose(layout: Layout, node: int) -> bool:
    """Return whether a node is the right end of something, with nothing there."""
    return not layout.leaves(node) and not layout.strip.on[node]


def coordinate_below(layout: Layout, node: int, end: Anchor, thick: float) -> None:
    """A reference line and an arrow below a body."""
    ref = _reference((0, thick + 3), (0, thick + 26))
    shapes = (ref, Label(layout.style.coordinates[node], (0, ARROW + 5, thick + 19), "start"))
    variables = {"coordinate": layout.style.variables[node]}
    tail, tip = (0.0, thick + 19), (ARROW, thick + 19)
    layout.labels.append(symbols.arrow("coordinate", "", end, tail, tip, "ink", 1.2, shapes, variables))


def coordinate_within(layout: Layout, node: int, end: Anchor) -> None:
    """A short arrow at the foot of a body, around which nothing is free."""
    text, y = layout.style.coordinates[node], THICK - 10.0
    left = -(WITHIN + 4 + width(text, 13)) / 2
    label = Label(text, (0, left + WITHIN + 4, y), "start")
    variables, tail, tip = {"coordinate": layout.style.variables[node]}, (left, y), (left + WITHIN, y)
    layout.labels.append(symbols.arrow("coordinate", "", end, tail, tip, "ink", 1.2, (label,), variables))


def frame(layout: Layout, element: Element, base: int, flange: int) -> None:
    """A coordinate counted from another body: from its middle to that of the moving frame's point."""
    text = layout.style.coordinates.get(-flange - 1, layout.names.called(element))
    lift = min(layout.rows.span[base][0], layout.rows.span[flange][0]) * layout.pitch - THICK - 46
    if layout.upright:
        lift -= 24
    a, b = layout.end(base, 0, lift), layout.end(flange, 0, lift)
    shapes = [Path(((0, 0, 0), (1, 0, 0)), width=1.2), symbols.head((1, 0, 0), (1, 0))]
    shapes += [Path(((f, 0, -5), (f, 0, 20)), False, "", "muted", 1.0, (4, 3)) for f in (0, 1)]
    variables = {"coordinate": f"{element.name}.q"}
    met = layout.strip.meets(base), layout.strip.meets(flange)
    layout.labels.append(Item("coordinate", element.name, (a, b), tuple(shapes), Turn(), variables, nodes=met))
    centre = middle(a, b)
    dx, dy = (-8, 0) if layout.upright else (0, -11)
    layout.labels.append(symbols.label(text, centre, dx, dy, "end" if layout.upright else "middle", element.name))


def _reference(a: Point, b: Point) -> Path:
    """A reference line, from which a coordinate counts."""
    return symbols.path(a, b, colour="muted", width=1.0, dash=(4, 3))
