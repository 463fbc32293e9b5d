"""The symbols of a textbook, each as an item made of plain shapes.

Elements with two ends take the two `Anchor`s; everything else stands at one. Sizes are in px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil, cos, hypot, pi, sin

from lmoc.ir.look import Drawn
from lmoc.view.scene.picture import Anchor, Circle, Item, Label, Path, Shape, Turn, Vertex
from lmoc.view.scene.text import width as text_width

LEAD = 12.0  # least straight end of a spring or damper
COIL = 8.0  # half the width of a spring
CUP = 8.0  # half the width of a damper
ARROW = 8.0  # length of an arrow's head
FONT = 13.0


def path(*points: tuple[float, float], closed: bool = False, **style: object) -> Path:
    """A path through points that keep their distance from the first end."""
    return Path(tuple((0.0, float(x), float(y)) for x, y in points), closed, **style)


def head(tip: Vertex, direction: tuple[float, float], colour: str = "ink", size: float = ARROW) -> Path:
    """The head of an arrow."""
    f, x, y = tip
    dx, dy = direction
    back = [(x - size * dx + s * 0.38 * size * dy, y - size * dy - s * 0.38 * size * dx) for s in (1, -1)]
    return Path((tip, *((f, *b) for b in back)), True, "ink", colour, 1.0)


def arc(radius: float, start: float, stop: float, centre: tuple[float, float] = (0.0, 0.0)) -> tuple[Vertex, ...]:
    """Points of a circle from one angle to another, counter-clockwise where `stop` is the larger."""
    n = max(3, ceil(abs(stop - start) / 0.2))
    angles = [start + (stop - start) * i / n for i in range(n + 1)]
    return tuple((0.0, centre[0] + radius * cos(a), centre[1] - radius * sin(a)) for a in angles)


# ------------------------------------------------------------------------------- between two ends


def line(symbol: str, part: str, a: Anchor, b: Anchor, width: float = 1.5, colour: str = "ink", **style) -> Item:
    """A straight line: a rod, a string, a piece of shaft."""
    return Item(symbol, part, (a, b), (Path(((0, 0, 0), (1, 0, 0)), False, "", colour, width, **style),))


def spring(part: str, a: Anchor, b: Anchor, symbol: str = "spring", variables: dict | None = None) -> Item:
    """A zigzag between two straight ends."""
    length = _length(a, b)
    lead = min(LEAD, length / 5)
    turns = max(3, min(7, round((length - 2 * lead) / 9)), round((length - 2 * lead) / 16))
    n = 4 * turns
    middle = []
    for k in range(1, n, 2):
        f = k / n
        middle.append((f, lead * (1 - 2 * f), -COIL if k % 4 == 1 else COIL))
    vertices = ((0, 0, 0), (0, lead, 0), *middle, (1, -lead, 0), (1, 0, 0))
    return Item(symbol, part, (a, b), (Path(vertices),), Turn(), variables or {})


def damper(part: str, a: Anchor, b: Anchor, symbol: str = "damper", variables: dict | None = None) -> Item:
    """A piston in a cylinder that is open towards the second end."""
    length = _length(a, b)
    lead = min(LEAD, length / 5)
    cup = max(10.0, min(26.0, length - 2 * lead - 6))
    # the cylinder keeps to the middle at rest, and so does the piston
    base = (length - cup) / 2
    rear = length / 2 - 2 - length  # from the second end to the piston
    shapes = (
        path((0, 0), (base, 0)),
        path((base + cup, -CUP), (base, -CUP), (base, CUP), (base + cup, CUP)),
        Path(((1, rear, -CUP + 2.5), (1, rear, CUP - 2.5)), width=2.5),
        Path(((1, rear, 0), (1, 0, 0))),
    )
    return Item(symbol, part, (a, b), shapes, Turn(), variables or {})


def spring_damper(part: str, a: Anchor, b: Anchor) -> Item:
    """A spring and a damper side by side."""
    sides = []
    for made, y in ((spring(part, a, b), -10.0), (damper(part, a, b), 11.0)):
        sides += [lowered(s, y) for s in made.shapes]
    bars = (path((0, -10), (0, 11)), Path(((1, 0, -10), (1, 0, 11))))
    return Item("spring-damper", part, (a, b), (*sides, *bars))


def lowered(shape: Shape, dy: float) -> Shape:
    """Return a shape moved in its frame, to the right of the x axis."""
    if isinstance(shape, Path):
        return replace(shape, vertices=tuple((f, x, y + dy) for f, x, y in shape.vertices))
    if isinstance(shape, Label):
        return replace(shape, at=(*shape.at[:2], shape.at[2] + dy))
    return replace(shape, centre=(*shape.centre[:2], shape.centre[2] + dy))


def friction(part: str, a: Anchor, b: Anchor, symbol: str = "friction", variables: dict | None = None) -> Item:
    """Two plates pressed together."""
    half = _length(a, b) / 2
    long = min(30.0, half * 1.2)
    near, far = half - long / 2, half - long / 2 - 2 * half
    shapes = (
        path((0, 0), (near, 0), (near, 2), (near + long, 2)),
        Path(((1, far, -2), (1, far + long, -2), (1, far + long, 0), (1, 0, 0))),
        *(path((near + t * long, 2), (near + t * long - 5, 8), width=0.8) for t in (0.25, 0.5, 0.75, 1.0)),
    )
    return Item(symbol, part, (a, b), shapes, Turn(), variables or {})


def stop(part: str, a: Anchor, b: Anchor, symbol: str = "stop", variables: dict | None = None) -> Item:
    """A bumper fixed to each end, with the gap between them."""
    length = _length(a, b)
    gap = min(14.0, length / 3)
    reach = (length - gap) / 2
    shapes = (
        path((0, 0), (reach, 0)),
        path((reach, -9), (reach, 9), width=3.0),
        Path(((1, -reach, -9), (1, -reach, 9)), width=3.0),
        Path(((1, -reach, 0), (1, 0, 0))),
    )
    return Item(symbol, part, (a, b), shapes, Turn(), variables or {})


def string(part: str, a: Anchor, b: Anchor, symbol: str = "string", variables: dict | None = None) -> Item:
    """A string, as a thin line; an elastic one has some windings in its middle."""
    if symbol == "elastic-string":
        waves = tuple((0.5, 3.0 * (k - 6), 4 * sin(k * pi / 2)) for k in range(13))
        vertices = ((0, 0, 0), *waves, (1, 0, 0))
    else:
        vertices = ((0, 0, 0), (1, 0, 0))
    return Item(symbol, part, (a, b), (Path(vertices, colour="string", width=1.3),), Turn(), variables or {})


def torsion_spring(
    part: str, a: Anchor, b: Anchor, symbol: str = "torsion-spring", variables: dict | None = None
) -> Item:
    """A long slender cylinder with windings on a shaft, as the lecture notes print it."""
    length = _length(a, b)
    lead = min(8.0, length / 6)
    n = 6
    slants = []
    for k in range(n):
        f0, f1 = (k + 0.2) / n, (k + 0.8) / n
        slants.append(Path(((f0, lead * (1 - 2 * f0), 6), (f1, lead * (1 - 2 * f1), -6)), width=1.0))
    body = ((0, lead, -6), (1, -lead, -6), (1, -lead, 6), (0, lead, 6))
    shapes = (
        path((0, 0), (lead, 0), width=3.0),
        Path(body, True, "body", width=1.2),
        *slants,
        Path(((1, -lead, 0), (1, 0, 0)), width=3.0),
    )
    return Item(symbol, part, (a, b), shapes, Turn(), variables or {})


def plates(part: str, a: Anchor, b: Anchor, symbol: str, variables: dict | None = None) -> Item:
    """Two discs facing each other on a shaft: a clutch, friction, a damper (with oil between), a freewheel."""
    half = _length(a, b) / 2
    gap = 3.0
    shapes: list[Shape] = [
        path((0, 0), (half - gap, 0), width=3.0),
        path((half - gap, -14), (half - gap, 14), width=3.0),
        Path(((1, gap - half, -14), (1, gap - half, 14)), width=3.0),
        Path(((1, gap - half, 0), (1, 0, 0)), width=3.0),
    ]
    if symbol in ("torsion-damper", "damper"):
        edge = half + gap + 5
        shapes += [path((half - gap, s * 14), (half - gap, s * 18), (edge, s * 18), (edge, s * 9)) for s in (1, -1)]
    if symbol == "ratchet":
        shapes += [path((half - gap, y), (half + gap - 1, y + 4), (half - gap, y + 4), width=1.0) for y in (-12, -4, 4)]
    if symbol in ("bearing-friction", "friction"):
        shapes += [path((half - gap, y), (half + gap, y + 3), width=0.8) for y in (-11, -4, 3, 10)]
    return Item(symbol, part, (a, b), tuple(shapes), Turn(), variables or {})


def gearbox(part: str, a: Anchor, b: Anchor, symbol: str, variables: dict | None = None) -> Item:
    """A transmission on a shaft: a box with two wheels in mesh, or apart where they have play."""
    half = _length(a, b) / 2
    radius = 6.0 if symbol == "backlash" else 8.0
    shapes = (
        path((0, 0), (half - 20, 0), width=3.0),
        path((half - 20, -20), (half + 20, -20), (half + 20, 20), (half - 20, 20), closed=True, fill="body"),
        Circle((0, half - 7, 4), radius, "paper"),
        Circle((0, half + 7, -4), radius, "paper"),
        Path(((0.5, 20, 0), (1, 0, 0)), width=3.0),
    )
    return Item(symbol, part, (a, b), shapes, Turn(), variables or {})


def planetary(corners: tuple[float, float, float, float], boxed: Sequence[Shape]) -> tuple[Shape, ...]:
    """A ring, three planets and a sun seen along their axis, in a box above its name."""
    left, top, right, bottom = corners
    radius = min((right - left) / 2 - 4, (bottom - top) / 2 - 14)
    x, y = (left + right) / 2, (top + bottom) / 2 - 8
    wheel = radius / 3.0
    places = [(x + 2 * wheel * cos(a), y + 2 * wheel * sin(a)) for a in (-pi / 2, pi / 6, 5 * pi / 6)]
    box, name = boxed
    return (
        box,
        Circle((0, x, y), radius, "paper"),
        *(Circle((0, *place), wheel, "paper") for place in places),
        Circle((0, x, y), wheel, "body"),
        replace(name, at=(0, x, y + radius + 10)),
    )


def belt(part: str, a: Anchor, b: Anchor, symbol: str, crossed: bool) -> Item:
    """A belt or a chain over two wheels, between the shafts that end in their middles."""
    half = _length(a, b) / 2
    x, r, y, s = half - 22.0, 10.0, half + 18.0, 16.0
    sign = -1 if crossed else 1
    dash = (4.0, 2.5) if symbol == "chain" else ()
    shapes = (
        path((0, 0), (x, 0), width=3.0),
        Circle((0, x, 0), r, "paper"),
        Circle((0, y, 0), s, "paper"),
        *(path((x + 2, k * (r - 0.5)), (y - 3, sign * k * (s - 0.5)), colour="string", dash=dash) for k in (-1, 1)),
        Circle((0, x, 0), 2.5, "ink"),
        Path(((0, y, 0), (1, 0, 0)), width=3.0),
    )
    return Item(symbol, part, (a, b), shapes)


def box_between(part: str, a: Anchor, b: Anchor, name: str, variables: dict | None = None) -> Item:
    """A box with a name between two ends."""
    wide = text_width(name, FONT) + 14
    shapes = (
        Path(((0, 0, 0), (0.5, -wide / 2, 0))),
        Path(((0.5, -wide / 2, -13), (0.5, wide / 2, -13), (0.5, wide / 2, 13), (0.5, -wide / 2, 13)), True, "body"),
        Path(((0.5, wide / 2, 0), (1, 0, 0))),
        Label(name, (0.5, 0, 0)),
    )
    return Item("box", part, (a, b), shapes, Turn(), variables or {})


def ellipsis(part: str, a: Anchor, b: Anchor, words: str) -> Item:
    """Dots for parts that are left out, and how many they are."""
    dots = tuple(Circle((0.5, x, 0), 2.0, "ink") for x in (-9, 0, 9))
    leads = (Path(((0, 0, 0), (0.5, -18, 0))), Path(((0.5, 18, 0), (1, 0, 0))))
    return Item("ellipsis", part, (a, b), (*leads, *dots))


def drawing_between(part: str, a: Anchor, b: Anchor, drawing: Sequence[Drawn], name: str) -> Item:
    """A user's own drawing between two ends, as long as their distance."""
    length = _length(a, b)
    half = min(28.0, length / 2)
    shapes: list[Shape] = [Path(((0, 0, 0), (0.5, -half, 0))), Path(((0.5, half, 0), (1, 0, 0)))]
    shapes += icon(drawing, half, half, name, 0.5)
    return Item("icon", part, (a, b), tuple(shapes))


def icon(drawing: Sequence[Drawn], half_width: float, half_height: float, name: str, f: float = 0.0) -> list[Shape]:
    """The shapes of a user's own drawing in a box."""
    found: list[Shape] = []
    for d in drawing:
        points = tuple((f, x * half_width, -y * half_height) for x, y in d.points)
        colour, fill = _colours(d)
        dash = (4.0, 3.0) if d.dashed else ()
        if d.kind == "text":
            (_, x0, y0), (_, x1, y1) = points
            text = d.text.replace("%name", name)
            size = max(8.0, min(FONT, abs(y1 - y0), FONT * abs(x1 - x0) / max(text_width(text, FONT), 1.0)))
            found.append(Label(text, (f, (x0 + x1) / 2, (y0 + y1) / 2), size=size, colour=colour))
        elif d.kind == "ellipse":
            (_, x0, y0), (_, x1, y1) = points
            rx, ry, cx, cy = (x1 - x0) / 2, (y1 - y0) / 2, (x0 + x1) / 2, (y0 + y1) / 2
            angles = [2 * pi * k / 36 for k in range(36)]
            round_ = tuple((f, cx + rx * cos(t), cy + ry * sin(t)) for t in angles)
            found.append(Path(round_, True, fill, colour, dash=dash))
        else:
            found.append(Path(points, d.kind == "polygon", fill, colour, dash=dash))
    return found


def _colours(d: Drawn) -> tuple[str, str]:
    """The colours of line and area. Black lines and white areas are those of the picture, which follow a dark theme."""
    colour = "ink" if d.colour in ("", "#000000") else d.colour
    if not d.filled:
        return colour, ""
    plain = {"": "body", "#ffffff": "paper", "#000000": "ink" if colour == "ink" else d.paint}
    return colour, plain.get(d.paint, d.paint)


def _length(a: Anchor, b: Anchor) -> float:
    return hypot(b.x - a.x, b.y - a.y)


# --------------------------------------------------------------------------------- at one end


def hatching(a: tuple[float, float], b: tuple[float, float], side: int, step: float = 7.0) -> list[Path]:
    """Return a firm line, `hatched` on one side."""
    return hatched((a, b), side, step)


def hatched(points: Sequence[tuple[float, float]], side: int, step: float) -> list[Path]:
    """Return a firm line through points, with hatching on its right as one goes along it where `side` is 1."""
    shapes, lengths = [path(*points, width=2.2)], [hypot(q[0] - p[0], q[1] - p[1]) for p, q in pairwise(points)]
    n = max(2, int(sum(lengths) // step))
    begin, k = 0.0, 0
    for (x0, y0), (x1, y1), length in zip(points, points[1:], lengths):
        while k < n and (s := (k + 0.5) * sum(lengths) / n - begin) <= length:
            ux, uy = (x1 - x0) / length, (y1 - y0) / length
            nx, ny = -uy * side, ux * side
            foot = (x0 + ux * s, y0 + uy * s)
            shapes.append(path(foot, (foot[0] + nx * 7 - ux * 6, foot[1] + ny * 7 - uy * 6), width=0.9))
            k += 1
        begin += length
    return shapes


def wall(part: str, at: Anchor, outwards: tuple[float, float], low: float, high: float, symbol: str = "wall") -> Item:
    """A hatched wall through a point, at a right angle to `outwards`, where the hatching is.

    Parameters
    ----------
    low, high : how far it reaches to both sides, across
    """
    dx, dy = outwards
    cx, cy = (0.0, 1.0) if dx else (1.0, 0.0)
    a, b = (cx * low, cy * low), (cx * high, cy * high)
    ux, uy = cx * (1 if high > low else -1), cy * (1 if high > low else -1)
    side = 1 if (-uy * dx + ux * dy) > 0 else -1
    return Item(symbol, part, (at,), tuple(hatching(a, b, side)))


def box(
    symbol: str,
    part: str,
    at: Anchor,
    corners: tuple[float, float, float, float],
    name: str,
    variables: dict | None = None,
) -> Item:
    """A box (left, top, right, bottom from its end) with a name."""
    left, top, right, bottom = corners
    shapes = (
        path((left, top), (right, top), (right, bottom), (left, bottom), closed=True, fill="body"),
        Label(name, (0, (left + right) / 2, (top + bottom) / 2)),
    )
    return Item(symbol, part, (at,), shapes, Turn(), variables or {})


def arrow(
    symbol: str, part: str, at: Anchor, tail: tuple[float, float], tip: tuple[float, float], colour: str = "ink",
    width: float = 1.5, shapes: Sequence[Shape] = (), variables: dict | None = None,
) -> Item:  # fmt: skip
    """An arrow between two points beside its end."""
    length = hypot(tip[0] - tail[0], tip[1] - tail[1]) or 1.0
    ux, uy = (tip[0] - tail[0]) / length, (tip[1] - tail[1]) / length
    neck = tip[0] - ux * ARROW * 0.8, tip[1] - uy * ARROW * 0.8
    own = (path(tail, neck, colour=colour, width=width), head((0, *tip), (ux, uy), colour))
    return Item(symbol, part, (at,), (*own, *shapes), Turn(), variables or {})


def turning_arrow(
    symbol: str, part: str, at: Anchor, radius: float, start: float, stop: float, colour: str = "ink",
    variables: dict | None = None,
) -> Item:  # fmt: skip
    """An arrow along a circle about its end, from one angle to another."""
    vertices = arc(radius, start, stop)
    sense = 1 if stop > start else -1
    tip = vertices[-1]
    direction = -sin(stop) * sense, -cos(stop) * sense
    shapes = (Path(vertices[:-1], False, "", colour), head(tip, direction, colour))
    return Item(symbol, part, (at,), shapes, Turn(), variables or {})


def label(
    text: str, at: Anchor, dx: float = 0.0, dy: float = 0.0, anchor: str = "middle", part: str = "", colour: str = "ink"
) -> Item:
    """A text beside a point."""
    return Item("label", part, (at,), (Label(text, (0, dx, dy), anchor, colour=colour),))


def wheel(
    symbol: str, part: str, at: Anchor, radius: float, turn: Turn, teeth: bool = False, variables: dict | None = None
) -> Item:
    """A disk seen along its axis, with a mark that shows how it turns."""
    shapes: list[Shape] = [Circle((0, 0, 0), radius, "body")]
    if teeth:
        n = max(12, round(2 * pi * radius / 9))
        for k in range(n):
            t = 2 * pi * k / n
            shapes.append(path(*(((radius + d) * cos(t), -(radius + d) * sin(t)) for d in (-2.5, 2.5)), width=1.0))
    shapes += [path((0, 0), (radius, 0), width=1.0, colour="muted"), Circle((0, 0, 0), 3.0, "ink")]
    return Item(symbol, part, (at,), tuple(shapes), turn, variables or {})


def pulley(part: str, at: Anchor, radius: float) -> Item:
    """A pulley: a wheel without mass."""
    return Item("pulley", part, (at,), (Circle((0, 0, 0), radius, "paper"), Circle((0, 0, 0), 3.0, "ink")))


def pivot(part: str, at: Anchor, direction: tuple[float, float] = (0.0, 1.0), symbol: str = "pivot") -> Item:
    """A bearing on hatched ground that lies in the given direction."""
    dx, dy = direction
    px, py = -dy, dx
    base = [(14 * dx + s * 9 * px, 14 * dy + s * 9 * py) for s in (1, -1)]
    rim = [(14 * dx + s * 15 * px, 14 * dy + s * 15 * py) for s in (1, -1)]
    side = 1 if (-(rim[1][1] - rim[0][1]) * dx + (rim[1][0] - rim[0][0]) * dy) > 0 else -1
    shapes = (
        path((0, 0), *base, closed=True, fill="paper"),
        *hatching(rim[0], rim[1], side, 6.0),
        Circle((0, 0, 0), 3.0, "paper"),
    )
    return Item(symbol, part, (at,), shapes)


def convex_hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull of points, in order (Andrew, Information Processing Letters 9, 1979)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered

    def half(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        found: list[tuple[float, float]] = []
        for p in ordered:
            while len(found) > 1 and _turn(found[-2], found[-1], p) <= 1e-9:
                found.pop()
            found.append(p)
        return found[:-1]

    return half(ordered) + half(ordered[::-1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def rounded(corners: Sequence[tuple[float, float]], radius: float) -> list[tuple[float, float]]:
    """Return the outline of everything within a distance of a convex polygon."""
    around = [(radius * cos(2 * pi * k / 24), radius * sin(2 * pi * k / 24)) for k in range(24)]
    return convex_hull([(x + dx, y + dy) for x, y in corners for dx, dy in around])


def widest(texts: Sequence[str], size: float = FONT) -> float:
    """Return the width of the widest of some texts."""
    return max((text_width(t, size) for t in texts), default=0.0)
