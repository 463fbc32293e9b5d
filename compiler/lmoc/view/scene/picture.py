"""The description of a picture: items made of plain shapes, each with the part it shows and what moves it.

One description serves the file that `lmoc draw` writes, the page that moves, and the free-body diagrams. Lengths are
pixels, x to the right, y downwards; angles are radians, counter-clockwise as one looks at the picture.

An item has one or two ends, points of the picture that may follow variables. Its shapes are given in its own frame:

* one end: the frame's origin is the end, its axes are those of the picture, turned by `turn`;
* two ends: the origin is the first end, the frame's x axis points to the second, y to the right of it (downwards where
  x points to the right). The frame is not stretched: a vertex says itself what part of the distance it takes along.

To move a picture: find the ends (`Anchor.at`) and the angle (`Turn.at`) for the variables' values, place the shapes
(`Frame.place`). Nothing else depends on time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field, replace
from math import atan2, cos, hypot, sin

from lmoc.support.records import dataclass

Point = tuple[float, float]
LEAST_SLACK = 0.3  # px of slack that can be seen
PIECES = 24  # of a curve

Vertex = tuple[float, float, float]  # (f, x, y): in the item's frame at (f·distance of the ends + x, y)


@dataclass(frozen=True)
class Move:
    """The motion of a point: ``(dx, dy)·(value of the variable − reference)`` is added to it.

    Attributes
    ----------
    variable : dotted name, as `run[…]` takes it
    dx, dy : pixels per unit of the variable; where there is a `group`, a direction of length 1 or less
    reference : the value at which the point is drawn where it is; None: that at the start of a run
    group : "" where the picture is to scale. Otherwise moves of the same group have one scale, in pixels per unit, to
        be chosen by who moves the picture: so that none goes further than `Picture.room[group]` pixels
    """

    variable: str
    dx: float
    dy: float
    reference: float | None = None
    group: str = ""


@dataclass(frozen=True)
class Anchor:
    """A point of the picture: where it is drawn, and what moves it."""

    x: float
    y: float
    moves: tuple[Move, ...] = ()

    def at(self, change: Callable[[Move], float] | None = None) -> Point:
        """Return where it is.

        Parameters
        ----------
        change : from a move to the pixels along its direction, ``scale·(value − reference)``; None: nothing has moved
        """
        if change is None or not self.moves:
            return self.x, self.y
        shifts = [(move, change(move)) for move in self.moves]
        return self.x + sum(m.dx * s for m, s in shifts), self.y + sum(m.dy * s for m, s in shifts)

    def shifted(self, dx: float, dy: float) -> Anchor:
        """Return a point beside it that moves alike."""
        return Anchor(self.x + dx, self.y + dy, self.moves)


def middle(a: Anchor, b: Anchor) -> Anchor:
    """Return the point between two ends, which moves with both."""
    moves = tuple(Move(m.variable, m.dx / 2, m.dy / 2, m.reference, m.group) for m in (*a.moves, *b.moves))
    return Anchor((a.x + b.x) / 2, (a.y + b.y) / 2, moves)


@dataclass(frozen=True)
class Turn:
    """The angle of an item with one end: ``angle + factor·(value of the variable − reference)``, counter-clockwise."""

    angle: float = 0.0
    variable: str = ""
    factor: float = 1.0
    reference: float | None = None  # None: the value at the start of a run

    def at(self, change: float = 0.0) -> float:
        """Return the angle, `change` being the value minus the reference."""
        return self.angle + self.factor * change


@dataclass(frozen=True)
class Path:
    """A line through points, or the area within.

    Attributes
    ----------
    fill : "" none, "body", "ground", "paper" (hides what is behind), the colour of the line: "ink", or "#rrggbb"
    colour : "ink", "muted", "force", "string", "accent", "#rrggbb" or "none"
    """

    vertices: tuple[Vertex, ...]
    closed: bool = False
    fill: str = ""
    colour: str = "ink"
    width: float = 1.5
    dash: tuple[float, ...] = ()


@dataclass(frozen=True)
class Circle:
    """A circle; attributes as of `Path`."""

    centre: Vertex
    radius: float
    fill: str = ""
    colour: str = "ink"
    width: float = 1.5
    dash: tuple[float, ...] = ()


@dataclass(frozen=True)
class Label:
    """A text, never turned with its item.

    Attributes
    ----------
    text : may hold ``_{…}`` and ``^{…}``: below and above the line (`lmoc.view.scene.text`)
    at : the middle of its height; horizontally its beginning, middle or end, as `anchor` says
    """

    text: str
    at: Vertex
    anchor: str = "middle"  # start, middle, end
    size: float = 13.0
    colour: str = "ink"


Shape = Path | Circle | Label


@dataclass(frozen=True)
class Frame:
    """An item's frame at some instant."""

    x: float
    y: float
    length: float = 0.0
    cos: float = 1.0
    sin: float = 0.0  # of the angle, clockwise as y points downwards

    def place(self, vertex: Vertex) -> Point:
        """Return where a vertex is in the picture."""
        f, x, y = vertex
        along = f * self.length + x
        return self.x + along * self.cos - y * self.sin, self.y + along * self.sin + y * self.cos


@dataclass(frozen=True)
class Item:
    """Something in the picture.

    Attributes
    ----------
    symbol : what it is: "spring", "damper", "mass", "wall", "string", "force", "coordinate", "label", …
    part : dotted name of the part that it shows; "" for none
    ends : one or two points
    shapes : in the item's frame
    turn : for items with one end
    variables : names a reader may ask for: the coordinate of a body, the force in a spring
    slack : px by which a string is longer than the way between its ends as drawn: then it hangs in a curve (`drawn`)
    nodes : connection sets that are met: at the first end and at the second (-1: none), or by an item with one end
    """

    symbol: str
    part: str
    ends: tuple[Anchor, ...]
    shapes: tuple[Shape, ...]
    turn: Turn = Turn()
    variables: Mapping[str, str] = field(default_factory=dict)
    slack: float = 0.0
    nodes: tuple[int, ...] = ()

    @property
    def drawn(self) -> tuple[Shape, ...]:
        """Return the shapes as they are drawn where nothing has moved: a slack string hangs."""
        if not self.slack > LEAST_SLACK or len(self.ends) != 2:
            return self.shapes
        frame = self.frame()
        return tuple(_hung(s, frame, self.slack) if isinstance(s, Path) else s for s in self.shapes)

    @property
    def halfway(self) -> Anchor:
        """Return the point between its two ends, on the string where one hangs."""
        end = middle(*self.ends)
        if not self.slack > LEAST_SLACK:
            return end
        shape, frame = self.drawn[0], self.frame()
        if not isinstance(shape, Path):
            return end
        x, y = frame.place(shape.vertices[len(shape.vertices) // 2])
        return Anchor(x, y, end.moves)

    def frame(self, change: Callable[[Move], float] | None = None, turned: float = 0.0) -> Frame:
        """Return the frame for the moves of its ends, and the change of the variable of its turn."""
        x, y = self.ends[0].at(change)
        if len(self.ends) == 1:
            angle = self.turn.at(turned)
            return Frame(x, y, 0.0, cos(angle), -sin(angle))
        x2, y2 = self.ends[1].at(change)
        length = hypot(x2 - x, y2 - y)
        angle = atan2(y2 - y, x2 - x)
        return Frame(x, y, length, cos(angle), sin(angle))


def _hung(path: Path, frame: Frame, slack: float) -> Path:
    """Return a string between the ends of a frame that is `slack` px longer than their distance.

    It is a parabola that sags by the root of 3/8 of both lengths' product; hung upright, it bulges to the side. The
    page that moves draws the same (`assets/sag.js`).
    """
    depth = min((0.375 * frame.length * slack) ** 0.5, 0.45 * frame.length + 6.0)
    size = hypot(frame.sin**2, frame.cos) or 1.0
    dx, dy = -depth * frame.sin**2 / size, depth * abs(frame.cos) / size
    along, across = dx * frame.cos + dy * frame.sin, dy * frame.cos - dx * frame.sin
    steps = [k / PIECES for k in range(PIECES + 1)]
    vertices = tuple((t, 4 * t * (1 - t) * along, 4 * t * (1 - t) * across) for t in steps)
    return replace(path, vertices=vertices)


@dataclass(frozen=True)
class Picture:
    """A picture, complete.

    Attributes
    ----------
    title : the scene's description, or its name
    width, height : px; everything lies within
    items : in the order in which they are painted
    room : {group of moves: most pixels that one may go}
    notes : what is not shown, in words
    """

    title: str
    width: float
    height: float
    items: tuple[Item, ...]
    room: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def placed(self) -> Iterator[tuple[Item, Shape, Frame]]:
        """All shapes with their items, and the frames they stand in as drawn."""
        for item in self.items:
            frame = item.frame()
            for shape in item.drawn:
                yield item, shape, frame
