"""Elements between two ends of a strip, and their labels."""

from __future__ import annotations

from lmoc.view.scene import symbols
from lmoc.view.scene.elements import Element
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Anchor, Item, middle


def between(element: Element, kind: str, a: Anchor, b: Anchor, shaft: bool, names: Names) -> Item:
    """Return the symbol of an element between two ends."""
    name = element.name
    if element.hidden:
        return symbols.ellipsis(name, a, b, "")
    if element.look.drawing:
        return symbols.drawing_between(name, a, b, element.look.drawing, name)
    if kind == "spring":
        return symbols.spring(name, a, b)
    if kind == "damper":
        return symbols.damper(name, a, b)
    if kind == "rod":
        return symbols.line("rod", name, a, b, 3.0)
    if kind in ("string", "elastic-string"):
        return symbols.string(name, a, b, kind)
    if kind == "stop":
        return symbols.stop(name, a, b)
    if kind == "friction":
        return symbols.friction(name, a, b)
    if kind == "torsion-spring":
        return symbols.torsion_spring(name, a, b)
    if kind in ("torsion-damper", "bearing-friction", "clutch", "ratchet"):
        return symbols.plates(name, a, b, kind)
    if kind in ("gear", "gear-pair", "backlash"):
        return symbols.gearbox(name, a, b, kind)
    if kind in ("belt", "chain"):
        return symbols.belt(name, a, b, kind, bool(names.graph.value(element, "crossed", 0.0)))
    if kind == "continuation":
        return symbols.line(kind, "", a, b, 3.0 if shaft else 1.5)
    if kind == "hub":
        return symbols.line("shaft" if shaft else "rod", name, a, b, 3.0)
    return symbols.box_between(name, a, b, names.called(element))


def breadth(kind: str) -> float:
    """Return the breadth of a symbol."""
    return {"rod": 2.0, "string": 2.0, "torsion-damper": 19.0, "gear": 21.0, "gear-pair": 21.0, "backlash": 21.0,
            "belt": 18.0, "chain": 18.0,
            "clutch": 15.0, "ratchet": 15.0, "bearing-friction": 15.0}.get(kind, 9.0)  # fmt: skip


def beside(element: Element, a: Anchor, b: Anchor, text: str, room: float, upright: bool) -> Item:
    """A label at the middle of an element, above it or to its right."""
    centre = middle(a, b)
    if upright:
        return symbols.label(text, centre, room + 5, 0, "start", element.name)
    return symbols.label(text, centre, 0, -room - 10, "middle", element.name)
