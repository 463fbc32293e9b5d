"""A table in place of a picture of too many parts: the number of each kind, with its symbol."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from lmoc.ir.flat import FlatDAE, Part
from lmoc.support.quoted import last
from lmoc.view.scene import symbols
from lmoc.view.scene.between import between
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element, size
from lmoc.view.scene.names import Names, shortened
from lmoc.view.scene.picture import Anchor, Item
from lmoc.view.scene.strip import BODIES, IN_LINE

MOST_KINDS = 16
LINE = 44.0


def summary(flat: FlatDAE, parts: Sequence[Part], names: Names) -> Block:
    """Return a table of the kinds of parts."""
    number: Counter[str] = Counter()
    example: dict[str, Part] = {}
    for part in parts:
        number[part.class_name] += size(part)
        example.setdefault(part.class_name, part)
    block = Block((symbols.label(f"{sum(number.values())} parts", Anchor(0, 0), 0, -30, "start"),))
    for k, (kind, n) in enumerate(number.most_common(MOST_KINDS)):
        part, y = example[kind], k * LINE
        block = block.beside(Block(tuple(_row(flat, part, kind, n, y, names))))
    if len(number) > MOST_KINDS:
        more = f"and {len(number) - MOST_KINDS} further kinds"
        block = block.beside(Block((symbols.label(more, Anchor(0, MOST_KINDS * LINE), 90, 0, "start"),)))
    return block


def _row(flat: FlatDAE, part: Part, kind: str, n: int, y: float, names: Names) -> Iterator[Item]:
    a, b = Anchor(0, y), Anchor(70, y)
    symbol = part.look.symbol
    shaft = any(flat.blocks[p].unit == "rad" for p, _ in part.ports)
    name = last(kind)
    sample = Element(name, name, part.look, ())
    if symbol in BODIES:
        yield symbols.box("mass", name, Anchor(35, y), (-20, -14, 20, 14), "")
    elif symbol in IN_LINE or part.look.drawing:
        kind_drawn = "spring" if symbol == "spring-damper" else symbol
        yield between(sample, kind_drawn, a, b, shaft, names)
    elif symbol in ("wall", "ground", "anchor", "fixed-shaft"):
        yield symbols.wall(name, Anchor(35, y - 6), (0, 1), -24, 24)
    else:
        yield symbols.box("box", name, Anchor(35, y), (-20, -14, 20, 14), "")
    yield symbols.label(f"{n} × {shortened(name)}", Anchor(90, y), 0, 0, "start", name)
    yield symbols.label(shortened(part.pattern), Anchor(280, y), 0, 0, "start", name, "muted")

