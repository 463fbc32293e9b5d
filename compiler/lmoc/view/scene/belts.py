"""Belts: drums on shafts of their own that strands join, one beside the other, as a belt drive is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import atan2, hypot, pi, sqrt

from lmoc.support.records import dataclass
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.picture import Item, Path, Point
from lmoc.view.scene.ropes import Hanging
from lmoc.view.scene.strip import RIGHT, DrawnStrip, Strip, Style
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.symbols import arc
from lmoc.view.scene.wheels import BETWEEN, CENTRE, FIRST, LAST, Turning, Window, decorated, wheel

LARGEST, SMALLEST = 58.0, 18.0  # px, radii of wheels
APART = 70.0  # px between two wheels, at least
LEAD = 16.0  # px of rope between a wheel and what is in a strand


@dataclass(frozen=True)
class Strand:
    """A line from one drum to another.

    Attributes
    ----------
    drums : the drum where it begins, and the one where it ends, as its coordinate counts
    strip : what is in it; None where the drums are connected directly
    """

    drums: tuple[Element, Element]
    strip: Strip | None

    @property
    def flanges(self) -> tuple[int, int]:
        return tuple(d.port("flange").node for d in self.drums)

    @property
    def shafts(self) -> tuple[int, int]:
        return tuple(d.port("shaft").node for d in self.drums)


@dataclass(frozen=True)
class Belt:
    """Wheels in a row, and the strands between neighbours: `strands[k]` joins the wheels k and k + 1."""

    shafts: tuple[int, ...]
    strands: tuple[tuple[Strand, ...], ...]


def belts_of(drums: Sequence[Element], joints: Sequence[Element], strips: Mapping[int, Strip]) -> list[Belt]:
    """Return the belts of a scene.

    Parameters
    ----------
    joints : whatever else is joined to lines: pulleys, levers
    strips : {node of a line: the strip it is in}
    """
    taken = {p.node for e in joints for p in e.ports}
    at: dict[int, list[Element]] = {}
    for drum in drums:
        at.setdefault(drum.port("flange").node, []).append(drum)
    strands: dict[frozenset[int], list[Strand]] = {}
    seen: set[int] = set()
    for node in at:
        strip = strips.get(node)
        if id(strip) in seen and strip is not None:
            continue
        seen.add(id(strip))
        strand = _strand(node, strip, at, taken)
        if strand is not None:
            strands.setdefault(frozenset(strand.shafts), []).append(strand)
    return [belt for group in _connected(strands) if (belt := _in_a_row(group)) is not None]


def _strand(node: int, strip: Strip | None, at: Mapping[int, list[Element]], taken: set[int]) -> Strand | None:
    """Return the strand through a node; None where it is no line between two drums on different shafts."""
    nodes = [node] if strip is None else strip.nodes
    ends = [(n, drum) for n in nodes for drum in at.get(n, ())]
    held = strip is not None and any(strip.held(n) is not None for n in strip.nodes)
    if len(ends) != 2 or held or taken & set(nodes) or (strip is not None and (strip.hubs or strip.frames)):
        return None
    (first, one), (last, other) = ends
    if one.port("shaft").node == other.port("shaft").node:
        return None
    if first == last:
        bare = strip is None or not strip.links and not any(strip.on[n] for n in strip.nodes)
        return Strand((one, other), None) if bare else None
    return Strand((one, other), strip)


def _connected(strands: Mapping[frozenset[int], list[Strand]]) -> list[dict[frozenset[int], list[Strand]]]:
    groups: list[dict[frozenset[int], list[Strand]]] = []
    for pair, found in strands.items():
        near = [g for g in groups if any(pair & other for other in g)]
        merged = {pair: found}
        for g in near:
            merged |= g
        groups = [g for g in groups if g not in near] + [merged]
    return groups


def _in_a_row(group: Mapping[frozenset[int], list[Strand]]) -> Belt | None:
    """Return belts one after the other; None where a shaft has three neighbours, or they form a ring."""
    beside: dict[int, list[int]] = {}
    for pair in group:
        a, b = sorted(pair)
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    ends = [n for n, others in beside.items() if len(others) == 1]
    if any(len(others) > 2 for others in beside.values()) or len(ends) != 2 or any(len(s) > 2 for s in group.values()):
        return None
    begins = [s.shafts[0] for found in group.values() for s in found]
    row = [max(ends, key=begins.count)]
    while more := [n for n in beside[row[-1]] if n not in row]:
        row.append(more[0])
    return Belt(tuple(row), tuple(tuple(group[frozenset(pair)]) for pair in zip(row, row[1:])))


def draw_belt(belt: Belt, shafts: Mapping[int, Turning], graph: Graph, hanging: Hanging) -> Block:
    """Return the wheels with their belts; radii are in the ratio of the drums that are joined."""
    radii = _radii(belt, graph)
    still = {n for strands in belt.strands for s in strands for n in s.flanges}  # the belt runs, its ends do not
    moving = {n: v for n, v in hanging.style.variables.items() if n not in still}
    style = replace(hanging.style, variables=moving)
    x, block = 0.0, Block(())
    for k, node in enumerate(belt.shafts):
        if k:
            own = [_drawn(s, belt.shafts[k - 1], style) for s in belt.strands[k - 1]]
            radius = radii[k - 1][1], radii[k][0]
            sides = [_side(s, belt.shafts[k - 1], graph, n) for n, s in enumerate(belt.strands[k - 1])]
            outer = max(radii[k - 1]), max(radii[k])
            apart = _apart(own, sides, radius, outer)
            for n, (strand, drawn, side) in enumerate(zip(belt.strands[k - 1], own, sides, strict=True)):
                shift = 0.0 if side[0] == side[1] else -1.0 if n == 0 else 1.0
                made = _strand_block(strand, drawn, belt.shafts[k - 1], side, radius, apart, shift, hanging)
                block = block.beside(made.at(x, 0.0))
            x += apart
        window = FIRST if k == 0 else LAST if k == len(belt.shafts) - 1 else BETWEEN
        block = _wheel(shafts[node], hanging.style, radii[k], window).at(x, 0.0).beside(block)
    return block


def _wheel(shaft: Turning, style: Style, radii: tuple[float, float], window: Window) -> Block:
    items, legs = decorated(shaft, style, max(radii), True, held=True, window=window)
    return Block((*legs, *wheel(shaft, style, sorted(set(radii)), False), *items))


def _radii(belt: Belt, graph: Graph) -> list[tuple[float, float]]:
    """Radii in px of each wheel: of the belt on its left, and of that on its right."""
    found = []
    for (a, b), strands in zip(zip(belt.shafts, belt.shafts[1:]), belt.strands, strict=True):
        size = {d.port("shaft").node: abs(graph.value(d, "r")) for d in strands[0].drums}
        one, other = (r if r == r and r else 1.0 for r in (size[a], size[b]))
        scale = LARGEST / max(one, other)
        found.append((max(SMALLEST, one * scale), max(SMALLEST, other * scale)))
    last = len(found)
    return [(found[k - 1][1] if k else found[0][0], found[k][0] if k < last else found[-1][1]) for k in range(last + 1)]


def _drawn(strand: Strand, left: int, style: Style) -> tuple[DrawnStrip, float] | None:
    """What is in a strand, drawn to the right, and 1 or -1: whether its coordinate counts to the right."""
    if strand.strip is None:
        return None
    begin = strand.flanges[strand.shafts.index(left)]
    end = strand.flanges[1 - strand.shafts.index(left)]
    drawn = draw_strip(strand.strip, style, RIGHT)
    if drawn.along[begin] <= drawn.along[end]:
        return drawn, 1.0
    return draw_strip(strand.strip, style, (-1.0, 0.0)), -1.0


def _side(strand: Strand, left: int, graph: Graph, n: int) -> tuple[float, float]:
    """Return where a strand touches the wheel on its left and that on its right: 1 below, -1 above.

    What counts to the right runs below a wheel that turns counter-clockwise by as much.
    """
    signs = {d.port("shaft").node: 1.0 if not graph.value(d, "r") < 0 else -1.0 for d in strand.drums}
    one, other = signs[left], next(s for node, s in signs.items() if node != left)
    if n and one == other and strand.strip is None:
        return -1.0, -1.0
    return one, other


def _apart(
    own: Sequence[tuple[DrawnStrip, float] | None],
    sides: Sequence[tuple[float, float]],
    radius: tuple[float, float],
    outer: tuple[float, float],
) -> float:
    """Return the distance of two wheels, px: that of the longest strand; what is in one stands beside a crossing."""
    longest, (r, s) = 0.0, radius
    for found, (one, other) in zip(own, sides, strict=True):
        if found is not None:
            along = found[0].along.values()
            length = max(along) - min(along) + 2 * LEAD
            longest = max(longest, length if one == other else 2 * length)
    hidden = sum(sqrt(max(0.0, o * o - i * i)) for o, i in zip(outer, radius, strict=True))
    return max(sum(outer) + APART, hypot(longest + hidden, r + s))


def _strand_block(
    strand: Strand,
    drawn: tuple[DrawnStrip, float] | None,
    left: int,
    side: tuple[float, float],
    radius: tuple[float, float],
    apart: float,
    shift: float,
    hanging: Hanging,
) -> Block:
    """One strand between two wheels at (0, 0) and (apart, 0).

    Parameters
    ----------
    shift : of what is in it, from the middle: 0, or -1 and 1 for towards the wheels
    """
    (r, s), (up, down) = radius, side
    crossed = up != down
    nx = (r + s if crossed else r - s) / apart
    ny = sqrt(1.0 - nx * nx)
    p = r * nx, up * r * ny
    q = (apart - s * nx, down * s * ny) if crossed else (apart + s * nx, down * s * ny)
    one, other = strand.drums if strand.shafts[0] == left else strand.drums[::-1]
    items = [_wound(one, r, (0.0, 0.0), p, pi), _wound(other, s, (apart, 0.0), q, 0.0)]
    begin, end = one.port("flange").node, other.port("flange").node
    if drawn is None:
        return Block((*items, hanging.string(one.name, begin, p, q, -1)))
    length = hypot(q[0] - p[0], q[1] - p[1])
    way = (q[0] - p[0]) / length, (q[1] - p[1]) / length
    strip = draw_strip(strand.strip, hanging.style, (way[0] * drawn[1], way[1] * drawn[1]))
    a, b = strip.block.anchors[begin], strip.block.anchors[end]
    rest = (length - hypot(b[0] - a[0], b[1] - a[1])) / 2
    aside = shift * (length / 4 - LEAD / 2)
    lead, tail = rest + aside, rest - aside
    at = p[0] + lead * way[0], p[1] + lead * way[1]
    to = q[0] - tail * way[0], q[1] - tail * way[1]
    items += [hanging.string(one.name, begin, p, at, -1), hanging.string(other.name, end, to, q, -1)]
    return Block(tuple(items)).beside(strip.block.at(at[0] - a[0], at[1] - a[1]))


def _wound(drum: Element, radius: float, centre: Point, leaves: Point, outside: float) -> Item:
    """A belt on its wheel: from the side away from the other wheel to where it leaves."""
    angle = atan2(-(leaves[1] - centre[1]), leaves[0] - centre[0])
    angle = angle if abs(angle - outside) <= pi else angle + 2 * pi
    rope = Path(arc(radius + 1.0, outside, angle), colour="string", width=1.8)
    met = tuple(p.node for p in drum.ports)
    return Item("string", drum.name, (CENTRE.shifted(*centre),), (rope,), nodes=met)
