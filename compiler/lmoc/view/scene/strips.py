"""A strip, drawn: its elements in rows, and what stands on its nodes."""

from __future__ import annotations

from dataclasses import replace

from lmoc.view.scene import symbols
from lmoc.view.scene.between import beside, between, breadth
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.layout import Layout
from lmoc.view.scene.marks import coordinate, force, frame
from lmoc.view.scene.picture import Item
from lmoc.view.scene.side import shaft_node
from lmoc.view.scene.standing import body, goes_on, hub, other, wall
from lmoc.view.scene.strip import BODIES, HELD, PUSHED, RIGHT, Direction, DrawnStrip, Strip, Style

MOST_BROKEN = 6  # rounds in which links are broken off that cannot be drawn without a crossing


def draw_strip(
    strip: Strip, style: Style, direction: Direction = RIGHT, backwards: bool = False
) -> DrawnStrip:
    """Return a strip, drawn.

    Parameters
    ----------
    direction : of +q in the picture
    backwards : elements run against +q, from their ports `b` to `a`
    """
    loops = [link for link in strip.links if link[1] == link[2]]  # both ends at one place
    strip = strip.broken(loops) if loops else strip
    layout = Layout(strip, style, direction, backwards)
    if layout.rows.conflicts:  # a wall that everything leads to may be what is in the way
        apart = Layout(strip.apart(), style, direction, backwards)
        layout = apart if apart.rows.conflicts < layout.rows.conflicts else layout
    for _ in range(MOST_BROKEN):
        if not layout.rows.conflicts:
            break
        links = [layout.parts[k][:3] for k in layout.rows.crossing if k < len(layout.parts)]
        layout = Layout(layout.strip.broken(links), style, direction, backwards)
    for k, (element, a, b, kind) in enumerate(layout.parts):
        _element(layout, k, element, a, b, kind)
    for node in layout.strip.nodes:
        items, labels = len(layout.items), len(layout.labels)
        _node(layout, node)
        _meeting(layout.items, items, layout.strip.meets(node))
        _meeting(layout.labels, labels, layout.strip.meets(node))
    for element, base, flange in layout.strip.frames:
        frame(layout, element, base, flange)
    ends = {node: layout.end(node) for node in layout.strip.nodes}
    anchors = {node: (end.x, end.y) for node, end in ends.items()}
    reach = {node: layout.edge(node) for node in layout.strip.nodes}
    block = Block((*layout.items, *layout.labels), anchors)
    return DrawnStrip(layout.strip, block, reach, layout.rows.along, layout.rows.conflicts)


def _meeting(items: list[Item], first: int, node: int) -> None:
    """Note of the items from the first on that they are at a node."""
    for k, item in enumerate(items[first:], first):
        if not item.nodes and item.symbol != "label":
            items[k] = replace(item, nodes=(node,) * len(item.ends))


def _element(layout: Layout, k: int, element: Element, a: int, b: int, kind: str) -> None:
    """Draw an element between two nodes."""
    sign = -1.0 if k in layout.rows.turned else 1.0
    across = layout.rows.row[k] * layout.pitch
    first, second = layout.end(a, sign * layout.edge(a), across), layout.end(b, -sign * layout.edge(b), across)
    flow = "tau" if layout.strip.shaft else "f"
    known = layout.names.graph.variable(element, flow) is not None
    made = between(element, kind, first, second, layout.strip.shaft, layout.names)
    variables = {"force" if sign > 0 else "push": f"{element.name}.{flow}"} if known else {}
    if made.symbol in ("string", "elastic-string"):
        variables |= layout.names.slack(element.name)
    met = layout.strip.meets(a), layout.strip.meets(b)
    layout.items.append(replace(made, variables=variables, nodes=met))
    text = layout.text(element, kind)
    if text and made.symbol != "box":
        room = 28.0 if element.look.drawing else breadth(kind)
        layout.labels.append(beside(element, first, second, text, room, layout.upright))


def _node(layout: Layout, node: int) -> None:
    """Draw what stands on a node."""
    low, high = (r * layout.pitch for r in layout.rows.span[node])
    strip, held = layout.strip, layout.strip.held(node)
    if node in strip.marks:
        layout.items.append(goes_on(strip.marks[node], layout.end(node)))
        return
    if node in strip.hubs:
        hub(layout, node, low, high)
    elif strip.shaft and (held is None or held.symbol != "fixed-shaft"):
        shaft_node(layout, node, low, high)
    elif strip.bodies(node):
        body(layout, node, low, high)
    elif high > low and held is None:
        a, b = layout.end(node, 0, low), layout.end(node, 0, high)
        layout.items.append(symbols.line("joint", "", a, b, 3.0))
    if held is not None and held.symbol != "rotation":
        wall(layout, node, held, low, high)
    if strip.shaft:
        return
    for element in strip.on[node]:
        if element.symbol == "force":
            force(layout, node, element, high)
        elif element.symbol not in (*BODIES, *HELD, *PUSHED):
            other(layout, node, element, high)
    if node in layout.style.coordinates and (held is None or held.symbol == "motion"):
        coordinate(layout, node, low, high)
