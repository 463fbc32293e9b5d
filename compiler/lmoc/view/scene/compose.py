"""From a compiled scene to its picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.view.scene import symbols
from lmoc.view.scene.abbreviate import shown
from lmoc.view.scene.attached import attach
from lmoc.view.scene.block import Block, packed
from lmoc.view.scene.dimensions import dimensioned
from lmoc.view.scene.elements import Graph
from lmoc.view.scene.joined import joined
from lmoc.view.scene.names import Names, shortened, symbol
from lmoc.view.scene.picture import Anchor, Picture
from lmoc.view.scene.planar import draw_plane, finish, is_planar
from lmoc.view.scene.schematic import GAP, WIDTH, Schematic, gravity_arrow, style_of
from lmoc.view.scene.strip import BODIES
from lmoc.view.scene.summary import summary

Values = Callable[[str], float]  # from a dotted name

MARGIN = 14.0
MOST_NAMED = 6  # parts that are not drawn
ROOM = 24.0  # px that a node may go


def picture_of(
    flat: FlatDAE,
    values: np.ndarray,
    start: Callable[[], Values] | None = None,
    dimensions: bool = False,
    numbers: bool = True,
) -> Picture:
    """Return the picture of a scene.

    Parameters
    ----------
    values : (flat.count,) of the parameters
    start : returns what gives the value of a variable at the start of a run; called for mechanisms of the plane only
    dimensions : with the lengths of bars, rods, links and lever arms
    numbers : with parameters' values where the icons of parts ask for them; a page, which changes them, has them beside
    """
    found = shown(flat, values)
    if found.graph is None:
        names = Names(Graph(flat, values, ()))
        return finished(summary(flat, found.parts, names), flat.description or flat.name, found.notes)
    graph = found.graph.worded(numbers)
    names = Names(graph)
    if not graph.elements:
        return without_parts(flat)
    style = style_of(graph, names)
    rest = [e for e in graph.elements if not is_planar(e)]
    blocks = []
    if len(rest) < len(graph.elements):
        if start is None:
            raise ValueError("a planar mechanism is drawn where it starts: `start` is needed")
        plane = draw_plane(graph, names, start())
        rest = attach(plane, rest)
        blocks.append(finish(plane))
    if rest:
        blocks.append(Schematic(graph, rest, style).block())
    block = joined(packed([b for b in blocks if b.items], WIDTH, GAP), graph)
    if not block.items:
        return without_parts(flat)
    if dimensions:
        block = dimensioned(block, graph, names)
    if gravity := gravity_name(graph, names):
        block = gravity_arrow(block, gravity)
    return finished(block, flat.description or flat.name, (*found.notes, *not_drawn(graph)))


def without_parts(flat: FlatDAE) -> Picture:
    """Return what stands in the place of a picture where there is nothing to draw."""
    note = f"{flat.name} has no parts that move or turn, only its {flat.equation_count} equations"
    return finished(Block((symbols.label(shortened(note, 90), Anchor(0, 0)),)), flat.description or flat.name, (note,))


def not_drawn(graph: Graph) -> tuple[str, ...]:
    """Return a note that names the parts whose ports belong to no mechanics: those of a circuit, say."""
    names = [e.name for e in graph.elements if all(p.domain == "other" for p in e.ports)]
    if not names:
        return ()
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return (f"not drawn, for their ports neither move nor turn: {', '.join(names[:MOST_NAMED])}{more}",)


def gravity_name(graph: Graph, names: Names) -> str:
    """Return the symbol of gravity where it acts on a body of a line, else nothing."""
    for element in graph.elements:
        if element.symbol in BODIES and graph.value(element, "g", 0.0):
            return names.parameter(element, "g") or symbol("g")
    planar = any(e.symbol in ("particle", "body", "bar") and is_planar(e) for e in graph.elements)
    return symbol("g") if planar and world_gravity(graph) else ""


def world_gravity(graph: Graph) -> float:
    """Return the gravity that acts on bodies of the plane, m/s² downwards."""
    for block in graph.flat.blocks:
        if block.path[-1][0] == "g" and graph.flat.parts[block.part].class_name.endswith("Planar.World"):
            return float(graph.values[block.offset])
    return 0.0


def finished(block: Block, title: str, notes: tuple[str, ...] = ()) -> Picture:
    """Return a block as a picture with a margin around it."""
    left, top, right, bottom = block.corners
    block = block.at(MARGIN - left, MARGIN - top)
    width, height = right - left + 2 * MARGIN, bottom - top + 2 * MARGIN
    return Picture(title, width, height, block.items, {"line": ROOM}, notes)
