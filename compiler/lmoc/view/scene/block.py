"""A piece of a picture that can be put anywhere: its items, and the rectangle they need."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from itertools import combinations
from math import inf

from lmoc.support.records import dataclass
from lmoc.view.scene.picture import Circle, Frame, Item, Label, Point, Shape
from lmoc.view.scene.text import box

Corners = tuple[float, float, float, float]  # left, top, right, bottom
NOTHING: Corners = (inf, inf, -inf, -inf)
TANGLED = 1.0  # px by which things overlap that stand on each other


def shape_corners(shape: Shape, frame: Frame) -> Corners:
    """Return the rectangle of a shape as drawn."""
    if isinstance(shape, Label):
        return box(shape, frame)
    if isinstance(shape, Circle):
        x, y = frame.place(shape.centre)
        return x - shape.radius, y - shape.radius, x + shape.radius, y + shape.radius
    points = [frame.place(v) for v in shape.vertices]
    return min(x for x, _ in points), min(y for _, y in points), max(x for x, _ in points), max(y for _, y in points)


def united(corners: Iterable[Corners]) -> Corners:
    """Return the rectangle around some."""
    left, top, right, bottom = NOTHING
    for a, b, c, d in corners:
        left, top, right, bottom = min(left, a), min(top, b), max(right, c), max(bottom, d)
    return left, top, right, bottom


def corners_of(items: Iterable[Item]) -> Corners:
    """Return the rectangle around some items."""
    return united(shape_corners(shape, item.frame()) for item in items for shape in item.drawn)


def shifted(item: Item, dx: float, dy: float) -> Item:
    """Return an item at another place."""
    return replace(item, ends=tuple(end.shifted(dx, dy) for end in item.ends))


@dataclass(frozen=True)
class Block:
    """Items, and points at which other blocks attach.

    Attributes
    ----------
    anchors : {node: where it is}
    """

    items: tuple[Item, ...]
    anchors: dict[int, Point] = field(default_factory=dict)

    @property
    def corners(self) -> Corners:
        return corners_of(self.items)

    def at(self, dx: float, dy: float) -> Block:
        """Return the block at another place."""
        anchors = {n: (x + dx, y + dy) for n, (x, y) in self.anchors.items()}
        return Block(tuple(shifted(i, dx, dy) for i in self.items), anchors)

    def beside(self, *others: Block) -> Block:
        """Return one block of several."""
        items = sum((o.items for o in others), self.items)
        anchors: dict[int, Point] = {}
        for block in (self, *others):
            anchors |= block.anchors
        return Block(items, anchors)


def packed(blocks: Sequence[Block], width: float, gap: float) -> Block:
    """Return blocks in lines from left to right, a new line where the width is used up; middles level."""
    lines: list[list[Block]] = [[]]
    used = 0.0
    for block in blocks:
        left, _, right, _ = block.corners
        if lines[-1] and used + right - left > width:
            lines.append([])
            used = 0.0
        lines[-1].append(block)
        used += right - left + gap
    placed: list[Block] = []
    y = 0.0
    for line in filter(None, lines):
        high = max(b.corners[3] - b.corners[1] for b in line)
        x = 0.0
        for block in line:
            left, top, right, bottom = block.corners
            placed.append(block.at(x - left, y + (high - (bottom - top)) / 2 - top))
            x += right - left + gap
        y += high + gap
    return Block(()).beside(*placed)


def tangled(block: Block) -> bool:
    """Return whether bodies or labels of a block stand on each other."""
    boxes = [corners_of([i]) for i in block.items if i.symbol in ("mass", "box", "lever", "beam") and i.shapes]
    labels = [box(s, i.frame()) for i in block.items for s in i.drawn if isinstance(s, Label) and s.text]
    return any(
        min(min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])) > TANGLED
        for found in (boxes, labels)
        for a, b in combinations(found, 2)
    )
