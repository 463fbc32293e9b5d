"""Places for labels beside what they name: where they cover as little as possible."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import ceil, cos, hypot, pi, sin

import numpy as np

from lmoc.support.records import dataclass
from lmoc.view.scene.block import Corners, shape_corners
from lmoc.view.scene.picture import Anchor, Circle, Frame, Item, Label, Path, Point
from lmoc.view.scene.text import box

NEAR = 2.5  # px between a label and a line
STEP = 6.0  # px between the points of a line that are looked at
RINGS = (6.0, 10.0, 14.0, 18.0, 24.0, 32.0, 42.0, 56.0)  # px that a label may move
OFFSETS = ((0, -1), (1, -1), (1, 0), (-1, -1), (-1, 0), (1, 1), (-1, 1), (0, 1))


@dataclass(frozen=True)
class Wish:
    """A label that is to stand near a point: at least `clear` px from it."""

    text: str
    at: Anchor
    part: str = ""
    clear: float = 10.0
    colour: str = "ink"


def placed_labels(items: Sequence[Item], wishes: Iterable[Wish]) -> list[Item]:
    """Return the labels, each where it covers the fewest other labels and lines."""
    lines = [p for item in items for p in points_of(item)]
    taken = [shape_corners(s, item.frame()) for item in items for s in item.shapes if isinstance(s, Label)]
    made = []
    for wish in wishes:
        best: tuple[float, Label, Corners] | None = None
        for distance in (1.0, 1.6, 2.4, 3.4):
            for dx, dy in OFFSETS:
                label = _label(wish, dx, dy, distance)
                corners = box(label, Frame(wish.at.x, wish.at.y))
                cost = 1000 * sum(_overlap(corners, c) for c in taken) + 10 * sum(_inside(p, corners) for p in lines)
                cost += distance
                if best is None or cost < best[0]:
                    best = cost, label, corners
        taken.append(best[2])
        made.append(Item("label", wish.part, (wish.at,), (best[1],)))
    return made


def _label(wish: Wish, dx: float, dy: float, distance: float) -> Label:
    clear = wish.clear * distance
    anchor = "middle" if dx == 0 else "start" if dx > 0 else "end"
    x = dx * clear * (0.75 if dy else 1.0)
    y = dy * (clear * (0.75 if dx else 1.0) + 7)
    return Label(wish.text, (0.0, x, y), anchor, colour=wish.colour)


def points_of(item: Item) -> Iterable[Point]:
    """Return points of the lines of an item, close to each other."""
    frame = item.frame()
    for shape in item.drawn:
        if isinstance(shape, Circle):
            x, y = frame.place(shape.centre)
            yield x, y
            yield from ((x + shape.radius * cos(k * pi / 4), y + shape.radius * sin(k * pi / 4)) for k in range(8))
        elif isinstance(shape, Path):
            places = [frame.place(v) for v in shape.vertices]
            places += places[:1] if shape.closed else []
            for (x0, y0), (x1, y1) in zip(places, places[1:]):
                n = max(1, ceil(hypot(x1 - x0, y1 - y0) / STEP))
                for k in range(n + 1):
                    yield x0 + (x1 - x0) * k / n, y0 + (y1 - y0) * k / n


def _overlap(a: Corners, b: Corners) -> bool:
    return min(a[2], b[2]) - max(a[0], b[0]) > -2 and min(a[3], b[3]) - max(a[1], b[1]) > -1


def _inside(p: Point, c: Corners) -> bool:
    return c[0] - NEAR < p[0] < c[2] + NEAR and c[1] - NEAR < p[1] < c[3] + NEAR


class Ink:
    """What a picture covers: the points of its lines, and its labels."""

    def __init__(self, items: Iterable[Item]) -> None:
        self.points = np.zeros((0, 2))
        self.labels = np.zeros((0, 4))
        self.add(items)

    def add(self, items: Iterable[Item]) -> None:
        """Cover more."""
        items = list(items)
        points = [p for item in items for p in points_of(item)]
        labels = [box(s, i.frame()) for i in items for s in i.drawn if isinstance(s, Label) and s.text]
        self.points = np.concatenate([self.points, np.array(points).reshape(-1, 2)])
        self.labels = np.concatenate([self.labels, np.array(labels).reshape(-1, 4)])

    def costs(self, boxes: Sequence[Corners], line: float) -> np.ndarray:
        """Return for some rectangles what they would cover: a label costs 1000, a point of a line `line`."""
        b = np.array(boxes)[:, None]
        x, y = self.points[:, 0], self.points[:, 1]
        inside = (b[..., 0] < x) & (x < b[..., 2]) & (b[..., 1] < y) & (y < b[..., 3])
        over = overlap(b, self.labels) > 0
        return 1000.0 * over.sum(axis=1) + line * inside.sum(axis=1)


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the breadth of the overlap of rectangles, px; negative where they are apart."""
    wide = np.minimum(a[..., 2], b[..., 2]) - np.maximum(a[..., 0], b[..., 0])
    high = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    return np.minimum(wide, high)


def cleared(items: Sequence[Item]) -> list[Item]:
    """Return a picture in which no label stands on another: those that do move to the nearest free place."""
    made = list(items)
    where = [
        (k, n) for k, i in enumerate(made) for n, s in enumerate(i.drawn) if isinstance(s, Label) and s.text
    ]
    boxes = np.array([box(made[k].drawn[n], made[k].frame()) for k, n in where]).reshape(-1, 4)
    points = np.array([p for item in made for p in points_of(item)]).reshape(-1, 2)
    for i, (k, n) in enumerate(where):
        others = np.arange(len(boxes)) != i
        if made[k].symbol == "continuation" or not (overlap(boxes[i], boxes[others]) > 0.5).any():
            continue
        shifts = [(r * dx, r * dy) for r in RINGS for dx, dy in OFFSETS]
        candidates = np.array([boxes[i] + (dx, dy, dx, dy) for dx, dy in shifts])
        ink = Ink(())
        ink.points, ink.labels = points, boxes[others]
        costs = ink.costs(candidates, 10.0) + np.array([hypot(*s) for s in shifts])
        best = int(costs.argmin())
        boxes[i] = candidates[best]
        made[k] = _with_label_at(made[k], n, shifts[best])
    return made


def _with_label_at(item: Item, n: int, shift: Point) -> Item:
    """An item with one of its labels moved, px in the picture."""
    frame, label = item.frame(), item.shapes[n]
    f, x, y = label.at
    along, across = shift[0] * frame.cos + shift[1] * frame.sin, shift[1] * frame.cos - shift[0] * frame.sin
    moved = replace(label, at=(f, x + along, y + across))
    return replace(item, shapes=(*item.shapes[:n], moved, *item.shapes[n + 1 :]))
