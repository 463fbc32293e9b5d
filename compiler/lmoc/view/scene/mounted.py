"""What joins a shaft and a line in machines: racks, screws, cams, unbalances, each with the line that it moves."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from math import atan2, cos, isfinite, pi, sin

from lmoc.support.records import dataclass
from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block, corners_of
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.picture import Anchor, Circle, Item, Move, Path, Point, Turn
from lmoc.view.scene.ropes import Hanging, rod
from lmoc.view.scene.side import DISK
from lmoc.view.scene.strip import BODIES, DOWN, RIGHT, UP, Direction, Strip
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.wheels import ALL_ROUND, LAST, Turning, Window, decorated, wheel

MOUNTED = ("rack", "screw", "cam", "unbalance")
PINION, TOOTH, RACK, THICK = 28.0, 8.0, 64.0, 5.0  # px: radius, between two teeth, half of a rack and of its height
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
THREAD, FLANK, NUT = 150.0, 3.0, 13.0  # px: length of a screw, half of a thread, half of a nut
LEFT = Window((95, 138), (150, 195))  # of a pinion whose rack is on its right
SIDES = Window((145, 195), (-15, 35))  # of a cam: its follower is in the middle
CAM, LIFT, POINTS = 30.0, 24.0, 120  # px: least radius of a cam, largest lift; points of its outline
ARM, MASS = 15.0, 4.5  # px, of an unbalance
BETWEEN, BELOW, STEM = 94.0, 44.0, 10.0  # px: from one unbalance to the next; from a body to its rim, and to a bar
CLEAR = 12.0  # px


@dataclass(frozen=True)
class Line:
    """The line that a part moves, as drawn, the part's node at (0, 0).

    Attributes
    ----------
    direction : of +q
    block : empty where the line is drawn elsewhere
    edge : half of the body at the node, across the line
    reach : and along it
    first, last : nothing lies before the node, or beyond it
    """

    node: int
    direction: Direction
    block: Block
    edge: float = 0.0
    reach: float = 0.0
    first: bool = True
    last: bool = True

    @property
    def across(self) -> Direction:
        """To the right of one who looks along +q: below a line that lies level."""
        return -self.direction[1], self.direction[0]

    def ahead(self, x: float, y: float = 0.0) -> Point:
        """Return a point so far along the line, and across it."""
        (dx, dy), (ax, ay) = self.direction, self.across
        return x * dx + y * ax, x * dy + y * ay


def line_of(node: int, strip: Strip | None, hanging: Hanging, direction: Direction | None = None) -> Line:
    """Return the line of a node, drawn where nothing else has drawn it; along a direction of its own by default."""
    gravity = hanging.weights(strip) if strip is not None else 0.0
    direction = direction or (RIGHT if not gravity else DOWN if gravity > 0 else UP)
    if strip is None:
        return Line(node, direction, Block(()))
    hanging.used.add(id(strip))
    drawn = draw_strip(strip, hanging.style, direction)
    x, y = drawn.block.anchors[node]
    block = drawn.block.at(-x, -y)
    line = Line(node, direction, block, 0.0, drawn.reach[node], drawn.is_first(node), drawn.is_last(node))
    return replace(line, edge=_edge(strip, node, line))


def moves(line: Line, hanging: Hanging) -> tuple[Move, ...]:
    """Return what moves a point along with a line."""
    end = hanging.style.end(line.node, (0.0, 0.0), line.direction, False)
    return end.moves


def beside(line: Line, at: Point, clear: float, hanging: Hanging) -> Block:
    """Return the line so far to the right of a point of a part that nothing of it lies nearer, with a rod to it."""
    if not line.block.items:
        return Block(())
    ax, ay = line.across
    left, top, right, bottom = line.block.corners
    inner = min(x * ax + y * ay for x in (left, right) for y in (top, bottom))
    away = clear - inner
    moved = moves(line, hanging)
    near = away - line.edge
    stem = rod(line.node, Anchor(*at, moved), Anchor(at[0] + near * ax, at[1] + near * ay, moved))
    return Block((stem,)).beside(line.block.at(at[0] + away * ax, at[1] + away * ay))


def draw_mounted(
    element: Element, shaft: Turning, strip: Strip | None, driver: Strip | None, hanging: Hanging
) -> Block:
    """Return a rack, a screw, or a cam with the line that it moves.

    Parameters
    ----------
    shaft : as far as it is drawn along its axis
    strip : the line; None where it is drawn elsewhere
    driver : the shaft as it is drawn from the side, for a screw; None where it is drawn elsewhere
    """
    if element.symbol == "screw":
        return _screw(element, strip, driver, hanging)
    return (_rack if element.symbol == "rack" else _cam)(element, shaft, strip, hanging)


def _turned(element: Element, shaft: Turning, hanging: Hanging) -> Turning:
    """The shaft, counted such that a positive radius moves what is on its right along +q."""
    ratio = hanging.style.names.graph.value(element, "r", 1.0)
    return replace(shaft, sense=-1 if ratio < 0 else 1)


def _rack(element: Element, shaft: Turning, strip: Strip | None, hanging: Hanging) -> Block:
    """A pinion at (0, 0), and the rack on its right as one looks along +q."""
    line = line_of(element.port("flange").node, strip, hanging)
    shaft = _turned(element, shaft, hanging)
    window = {UP: LEFT, DOWN: LAST}.get(line.direction, ALL_ROUND)
    items, legs = decorated(shaft, hanging.style, PINION, line.direction[0] == 0, held=True, window=window)
    corners = [line.ahead(x * RACK, y * THICK) for x, y in CORNERS]
    count = int(2 * RACK / TOOTH)
    places = [(k + 0.5) * 2 * RACK / count - RACK for k in range(count)]
    teeth = [symbols.path(line.ahead(x, -THICK - 2.5), line.ahead(x, -THICK + 2.5), width=1.0) for x in places]
    shapes = (symbols.path(*corners, closed=True, fill="body"), *teeth)
    at = Anchor(*line.ahead(0.0, PINION + THICK), moves(line, hanging))
    bar = Item("rack", element.name, (at,), shapes, nodes=(line.node,))
    hub = Item("pinion", element.name, (Anchor(0, 0),), (Circle((0.0, 0.0, 0.0), 3.0, "ink"),), nodes=(shaft.node,))
    text = hanging.style.names.part(element, "r")
    side = -1.0 if line.direction == UP else 1.0  # of the pinion, where the rack is not
    below = 6.0 if line.direction == RIGHT else 20.0
    name = symbols.label(text, Anchor(side * (PINION + 5), below), 0, 0, "start" if side > 0 else "end", element.name)
    block = Block((*legs, *wheel(shaft, hanging.style, [PINION], True), hub, bar, *items, name))
    if line.first or line.last:
        end = RACK + line.reach if line.first else -RACK - line.reach
        return block.beside(line.block.at(*line.ahead(end, PINION + THICK)))
    return block.beside(beside(line, line.ahead(0.0, PINION + 2 * THICK), CLEAR, hanging))


def _screw(element: Element, strip: Strip | None, driver: Strip | None, hanging: Hanging) -> Block:
    """A threaded rod from (0, 0) on, its nut in its middle, the shaft that drives it before it."""
    line = line_of(element.port("flange").node, strip, hanging)
    node, style = element.port("shaft").node, hanging.style
    before, clear = Block(()), NUT + CLEAR
    if driver is not None:
        drawn = draw_strip(driver, style, line.direction)
        x, y = drawn.block.anchors[node]
        dx, dy = line.direction
        reach = drawn.reach[node]
        before = drawn.block.at(-x - reach * dx, -y - reach * dy)
        start = line.ahead(-reach + (DISK if driver.bodies(node) else 0.0))
        stub = symbols.path(start, (0, 0), width=3.0)
        before = Block((Item("shaft", "", (Anchor(0, 0),), (stub,), nodes=(node,)),)).beside(before)
        clear = max(clear, before.corners[3] if line.direction == RIGHT else before.corners[2])
    count = int(THREAD / FLANK)
    flanks = [[(FLANK * k, side * (7.0 if k % 2 else 4.5)) for k in range(count + 1)] for side in (-1, 1)]
    outline = [line.ahead(*p) for p in (*flanks[0], *flanks[1][::-1])]
    slants = [symbols.path(line.ahead(*p), line.ahead(*q), width=0.8) for p, q in zip(flanks[0][1::2], flanks[1][3::2])]
    thread = (symbols.path(*outline, closed=True, fill="paper", width=1.2), *slants)
    moved = moves(line, hanging)
    middle = THREAD / 2
    nut = symbols.path(*(line.ahead(x * NUT, y * NUT) for x, y in CORNERS), closed=True, fill="body")
    items = (
        Item("screw", element.name, (Anchor(0, 0),), thread, nodes=(node,)),
        Item("nut", element.name, (Anchor(*line.ahead(middle), moved),), (nut,), nodes=(line.node,)),
        _named(element, line, middle, hanging),
    )
    at = line.ahead(middle, NUT)
    return before.beside(Block(items), beside(line, at, clear - NUT, hanging))


def _named(element: Element, line: Line, along: float, hanging: Hanging) -> Item:
    """The name of a screw, on the side of its nut where the line is not."""
    text = hanging.style.names.part(element, "lead")
    at = Anchor(*line.ahead(along, -NUT - 11.0 if line.direction == RIGHT else -NUT - 6.0))
    anchor = "middle" if line.direction == RIGHT else "end" if line.across[0] > 0 else "start"
    return symbols.label(text, at, 0, 0, anchor, element.name)


# ------------------------------------------------------------------------------------------ cams


def lifts(element: Element, graph: Graph) -> list[float]:
    """Return the lift of a cam at points over a whole turn from the angle 0 on, m; none where it is not known."""
    count = int(graph.value(element, "n", 0.0))
    rows = graph.table(element, "pieces", count + 1, 5)
    begin, period = graph.value(element, "profile[1,1]"), graph.value(element, "period")
    found = []
    for k in range(POINTS if period > 0 else 0):
        at = begin + (2 * pi * k / POINTS - begin) % period
        start, y, *c = rows[max(1, bisect_right([r[0] for r in rows[1:]], at))]
        u = at - start
        found.append(y + u * (c[0] + u * (c[1] + u * c[2])))
    return found if all(isfinite(y) for y in found) else []


def cam_scale(element: Element, graph: Graph) -> tuple[float, float] | None:
    """Return the px per metre at which a cam is drawn, and its lift where its angle is zero, m."""
    found = lifts(element, graph)
    rise = max(found) - min(found) if found else 0.0
    return (LIFT / rise, found[0]) if rise > 0 else None


def _cam(element: Element, shaft: Turning, strip: Strip | None, hanging: Hanging) -> Block:
    """A cam about (0, 0), its follower above it, or below it where +q is downwards."""
    graph, style = hanging.style.names.graph, hanging.style
    scaled, found = cam_scale(element, graph), lifts(element, graph)
    if scaled is not None and strip is not None:  # the whole line is to scale: what lifts off is seen to
        scales = {n: (scaled[0], scaled[1] if n == element.port("flange").node else None) for n in strip.nodes}
        hanging = replace(hanging, style=replace(style, scales=scales))
    gravity = hanging.weights(strip) if strip is not None else 0.0
    line = line_of(element.port("flange").node, strip, hanging, DOWN if gravity > 0 else UP)
    px = scaled[0] if scaled is not None else 0.0
    low = min(found) if found else 0.0
    radii = [CAM + px * (y - low) for y in found] or [CAM] * POINTS
    top = atan2(-line.direction[1], 0.0)  # the angle at which the follower touches
    angles = [top - 2 * pi * k / POINTS for k in range(POINTS)]
    outline = tuple((0.0, r * cos(a), -r * sin(a)) for r, a in zip(radii, angles, strict=True))
    turn = Turn(0.0, style.variables.get(shaft.node, ""), 1.0, 0.0)
    shapes = (Path(outline, True, "body"), Circle((0.0, 0.0, 0.0), 3.0, "ink"))
    names = {"angle": turn.variable} if turn.variable else {}
    disk = Item("cam", element.name, (Anchor(0, 0),), shapes, turn, names, nodes=(shaft.node,))
    items, legs = decorated(shaft, style, max(radii), line.direction == UP, held=True, window=SIDES)
    bodies = [Item("cam", e.name, (Anchor(0, 0),), (), nodes=(shaft.node,)) for e in shaft.on if e.symbol in BODIES]
    touches = radii[0]
    tip = symbols.path(*(line.ahead(*p) for p in ((0.0, 0.0), (9.0, -5.0), (9.0, 5.0))), closed=True, fill="body")
    foot = Anchor(*line.ahead(touches), moves(line, hanging))
    follower = Item("follower", element.name, (foot,), (tip,), nodes=(line.node,))
    corner = 0.75 * max(radii) + 6
    name = symbols.label(style.names.called(element), Anchor(corner, corner), 0, 0, "start", element.name)
    block = Block((*legs, disk, *bodies, follower, *items, name))
    at = line.ahead(touches + 9.0)
    if line.first:
        return block.beside(line.block.at(*line.ahead(touches + 9.0 + line.reach)))
    return block.beside(beside(line, at, max(radii) + 2 * CLEAR, hanging))


# ------------------------------------------------------------------------------------- unbalances


def draw_unbalances(
    elements: Sequence[Element], shafts: Sequence[Turning], strip: Strip | None, hanging: Hanging
) -> Block:
    """Return masses that turn in their housings: below what moves along a level line, else to its right.

    Parameters
    ----------
    elements : all on one line
    shafts : of each element, as far as it is drawn along its axis
    """
    line = line_of(elements[0].port("flange").node, strip, hanging)
    block, count = line.block, [e.port("flange").node for e in elements]
    for k, (element, shaft) in enumerate(zip(elements, shafts, strict=True)):
        node = count[k]
        along = (count[:k].count(node) - (count.count(node) - 1) / 2) * BETWEEN
        x, y = line.block.anchors.get(node, (0.0, 0.0))
        edge = _edge(strip, node, line)
        ax, ay = line.ahead(along, edge + ARM + 6.0 + BELOW if line.block.items else 0.0)
        own = replace(line, node=node)
        block = block.beside(_unbalance(element, shaft, (x + ax, y + ay), own, hanging))
        if line.block.items:
            ways = [line.ahead(*p) for p in ((0.0, edge), (0.0, edge + STEM), (along, edge + STEM))]
            points = [*((x + px, y + py) for px, py in ways), (x + ax, y + ay)]
            ends = [Anchor(*p, moves(own, hanging)) for p in points]
            block = Block(tuple(rod(node, a, b) for a, b in zip(ends, ends[1:]))).beside(block)
    return block


def _edge(strip: Strip | None, node: int, line: Line) -> float:
    """Half of a body across its line."""
    names = [e.name for e in strip.bodies(node)] if strip is not None else []
    boxes = [i for i in line.block.items if i.symbol == "mass" and i.part in names and i.shapes]
    if not boxes:
        return 0.0
    left, top, right, bottom = corners_of(boxes)
    return (bottom - top) / 2 if line.direction == RIGHT else (right - left) / 2


def _unbalance(element: Element, shaft: Turning, centre: Point, line: Line, hanging: Hanging) -> Block:
    """A mass on an arm about a centre, with what drives it; everything moves along with its housing.

    At the angle 0 the mass is across the line, and moves along +q as it turns.
    """
    style, (dx, dy) = hanging.style, line.direction
    angle = atan2(-dy, dx) - pi / 2
    turn = Turn(angle, style.variables.get(shaft.node, ""), 1.0, 0.0)
    names = {"angle": turn.variable} if turn.variable else {}
    rim = Circle((0.0, 0.0, 0.0), ARM + 6.0, "paper")
    arm = symbols.path((0, 0), (ARM, 0), width=2.0)
    mass = Circle((0.0, ARM, 0.0), MASS, "ink")
    met = (shaft.node, line.node)
    disk = Item("unbalance", element.name, (Anchor(0, 0),), (rim, arm, mass), turn, names, nodes=met)
    items, _ = decorated(shaft, style, ARM + 6.0, False, title=False)
    bodies = [e for e in shaft.on if e.symbol in BODIES]
    others = [Item("unbalance", e.name, (Anchor(0, 0),), (), nodes=(shaft.node,)) for e in bodies]
    text = ", ".join([style.names.part(element, "m"), *(style.names.part(e, "J", "m") for e in bodies)])
    name = symbols.label(text, Anchor(0, 0), ARM + 12.0, 14.0, "start", element.name)
    moved = moves(line, hanging)
    made = Block((disk, *others, *items, name)).at(*centre)
    along = [replace(i, ends=tuple(replace(e, moves=(*e.moves, *moved)) for e in i.ends)) for i in made.items]
    return Block(tuple(along))
