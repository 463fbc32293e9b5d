"""Springs and dampers of the plane between the same two points: they stand beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Circle, Path, Shape

PARALLEL = ("spring", "damper", "spring-damper")
NARROW, WIDE = 26.0, 44.0  # px across, of an element beside another


def place_across(element: Element, elements: Sequence[Element]) -> float:
    """Return where an element stands between two points that others join as well, px across their line."""
    own = [p.node for p in element.ports]
    if element.symbol not in PARALLEL or len(set(own)) < 2:
        return 0.0
    among = [e for e in elements if e.symbol in PARALLEL and {p.node for p in e.ports} == set(own)]
    room = [WIDE if e.symbol == "spring-damper" else NARROW for e in among]
    k = among.index(element)
    across = sum(room[:k]) + room[k] / 2 - sum(room) / 2
    return across if own[0] < own[1] else -across


def moved_across(shapes: Sequence[Shape], across: float) -> tuple[Shape, ...]:
    """Return shapes between two ends beside the line that joins them, and what leads to them from the ends."""
    moved: list[Shape] = [Path(((f, 0.0, 0.0), (f, 0.0, across))) for f in (0.0, 1.0)]
    for shape in shapes:
        if isinstance(shape, Path):
            moved.append(replace(shape, vertices=tuple((f, x, y + across) for f, x, y in shape.vertices)))
        elif isinstance(shape, Circle):
            moved.append(replace(shape, centre=(*shape.centre[:2], shape.centre[2] + across)))
        else:
            moved.append(replace(shape, at=(*shape.at[:2], shape.at[2] + across)))
    return tuple(moved)
