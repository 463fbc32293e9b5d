"""A differential seen from above: the pinion on the drive, the crown wheel and its cage, the bevel gears."""

from __future__ import annotations

from collections.abc import Mapping

from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Item, Path, Point
from lmoc.view.scene.side import DISK
from lmoc.view.scene.strip import DOWN, RIGHT, UP, Direction, DrawnStrip, Strip, Style
from lmoc.view.scene.strips import draw_strip

CROWN, PINION = 58.0, 19.0  # px, radii; their cones meet where the axes cross
FACE = 0.76  # of a radius, where the teeth begin
THICK = 7.0  # of the crown wheel, along its axis
BEVEL = (7.0, 17.0)  # from the crossing of the axes to the small and the large end of a bevel gear
CAGE = 24.0  # half of its width
ENDS = {"drive": -74.0, "left": 42.0, "right": 48.0}  # along the directions below, where the shafts go on
WAYS: dict[str, Direction] = {"drive": RIGHT, "left": UP, "right": DOWN}  # of what is connected there


def shaft_beside(strip: Strip, node: int, port: str, style: Style) -> DrawnStrip | None:
    """Return a shaft from the side as it lies at a port, None where it does not end there or something crosses."""
    drawn = draw_strip(strip, style, WAYS[port])
    ends = drawn.is_last(node) if port == "drive" else drawn.is_first(node)
    return drawn if ends and not drawn.conflicts else None


def draw_differential(
    element: Element, shafts: Mapping[str, DrawnStrip], held: Mapping[int, Element], style: Style
) -> Block:
    """Return a differential about (0, 0), with the shafts that belong to it.

    Parameters
    ----------
    shafts : {port: what is connected there}, as far as it is drawn with it
    held : {node that does not turn: what holds it}
    """
    nodes = {p.name: p.node for p in element.ports}
    shapes = (*_crown(), *_planet(-1.0), *_planet(1.0), _pinion(), _bevel(UP), _bevel(DOWN))
    block = Block((Item("differential", element.name, (Anchor(0, 0),), shapes),))
    for port, (dx, dy) in WAYS.items():
        node, end = nodes[port], ENDS[port]
        start = -CROWN if port == "drive" else BEVEL[1]
        drawn = shafts.get(port)
        sign = -1.0 if port == "drive" else 1.0
        far = end
        if drawn is not None:
            far += sign * (drawn.reach[node] - (DISK if drawn.strip.bodies(node) else 0.0))
            centre = end + sign * drawn.reach[node]
            x, y = drawn.block.anchors[node]
            block = block.beside(drawn.block.at(centre * dx - x, centre * dy - y))
        axle = symbols.path((start * dx, start * dy), (far * dx, far * dy), width=3.0)
        block = block.beside(Block((Item("shaft", element.name, (Anchor(0, 0),), (axle,), nodes=(node,)),)))
        if node in held:
            at, outwards = Anchor(end * dx, end * dy), (sign * dx, sign * dy)
            block = block.beside(Block((symbols.wall(held[node].name, at, outwards, -16, 16, "fixed-shaft"),)))
    text = style.names.part(element, "N")
    return block.beside(Block((symbols.label(text, Anchor(0, 0), CAGE + 9, -8, "start", element.name),)))


def _pinion() -> Path:
    near = FACE * CROWN, FACE * PINION
    return _filled((-CROWN, -PINION), (-near[0], -near[1]), (-near[0], near[1]), (-CROWN, PINION))


def _bevel(way: Direction) -> Path:
    """A bevel gear whose axis goes away from the crossing, its teeth at 45 degrees."""
    (dx, dy), (small, large) = way, BEVEL
    corners = ((small, -small), (large, -large), (large, large), (small, small))
    return _filled(*((a * dx - b * dy, a * dy + b * dx) for a, b in corners))


def _planet(side: float) -> tuple[Path, Path]:
    return _bevel((side, 0.0)), symbols.path((side * BEVEL[1], 0), (side * CAGE, 0), width=2.0)


def _crown() -> tuple[Path, Path]:
    """The crown wheel below the pinion, and the cage that turns with it."""
    inner, low = FACE * CROWN, PINION + 1.0
    rim = [(CROWN, low), (inner, FACE * PINION + 1.0), (inner - 5.0, low)]
    top = [(-x, y) for x, y in rim] + rim[::-1]
    wheel = _filled(*top, (CROWN, low + THICK), (-CROWN, low + THICK))
    cage = symbols.path((-CAGE, low), (-CAGE, -CAGE), (CAGE, -CAGE), (CAGE, low), width=2.0)
    return cage, wheel


def _filled(*points: Point) -> Path:
    return symbols.path(*points, closed=True, fill="body", width=1.2)
