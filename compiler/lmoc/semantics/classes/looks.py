"""The looks of parts: ``annotation(__lmoc(symbol = "spring"))`` and ``annotation(Icon(graphics = {…}))``.

Both are inherited. A drawing is painted over those of the bases (Modelica specification, 18.6), a symbol replaces what
the bases say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from lmoc.ir.look import PLAIN, SYMBOLS, Condition, Drawn, Look
from lmoc.messages.diagnostics import Report, Subject, nearest
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.classes.vendor import entry_of, vendor_entry
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.syntax import tree

Corner = tuple[float, float]


class Looks:
    """The look of each class, read once."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._found: dict[int, Look] = {}

    def of(self, cls: Scope) -> Look:
        """Return the look of a class; mistakes in its annotations are warnings."""
        if id(cls) not in self._found:
            look = PLAIN
            for scope in cls.lineage():
                own = self._own(scope)
                if own is not None:
                    look = Look(own.symbol, look.drawing + own.drawing if own.drawing else ())
            self._found[id(cls)] = look
        return self._found[id(cls)]

    def _own(self, scope: Scope) -> Look | None:
        """Return what a class says itself, None where it says nothing."""
        annotation = scope.definition.annotation
        if annotation is None:
            return None
        symbol = vendor_entry(annotation, "symbol")
        try:
            drawing = tuple(_drawing(annotation))
            if drawing:
                return Look("", drawing)
            if symbol is None:
                return None
            if isinstance(symbol, tree.String) and symbol.value in SYMBOLS:
                return Look(symbol.value)
            name = symbol.value if isinstance(symbol, tree.String) else symbol.span.text.strip()
            raise Wrong("W0247", f"there is no symbol '{name}'", symbol.span, hint=nearest(name, SYMBOLS))
        except Wrong as wrong:
            if wrong.diagnostic is not None:  # who uses a package cannot mend its pictures
                wrong.diagnostic = replace(wrong.diagnostic, subject=Subject.WRITING)
            wrong.put_into(self._report)
            return None


def _drawing(annotation: tree.Modification) -> Iterator[Drawn]:
    icon = entry_of(annotation, "Icon")
    if icon is None or icon.modification is None:
        return
    system = entry_of(icon.modification, "coordinateSystem")
    extent = entry_of(system.modification, "extent") if system is not None and system.modification else None
    (x0, y0), (x1, y1) = _points(extent.modification.value) if extent is not None else ((-100, -100), (100, 100))
    if x0 == x1 or y0 == y1:
        raise Wrong("W0247", "the coordinates of the icon have no extent", extent.span)

    def scaled(points: tuple[Corner, ...]) -> tuple[Corner, ...]:
        return tuple((2 * (x - x0) / (x1 - x0) - 1, 2 * (y - y0) / (y1 - y0) - 1) for x, y in points)

    graphics = entry_of(icon.modification, "graphics")
    value = graphics.modification.value if graphics is not None and graphics.modification else None
    if value is None:
        return
    if not isinstance(value, tree.Array):
        raise Wrong("W0247", "the graphics of an icon are a list {…}", value.span)
    for item in value.items:
        if not (isinstance(item, tree.Call) and str(item.function) == "Bitmap"):  # a file, which a picture does without
            yield _drawn(item, scaled)


def _drawn(item: tree.Expression, scaled) -> Drawn:
    kind = str(item.function) if isinstance(item, tree.Call) else item.span.text.strip()[:20]
    if not isinstance(item, tree.Call) or kind not in ("Line", "Polygon", "Rectangle", "Ellipse", "Text"):
        known = ("Line", "Polygon", "Rectangle", "Ellipse", "Text")
        hint = nearest(kind, known) or f"there are {', '.join(known)}"
        raise Wrong("W0247", f"an icon cannot hold '{kind}'", item.span, hint=hint)
    given = {name: _static(value) for name, value in item.named}
    wanted = "points" if kind in ("Line", "Polygon") else "extent"
    if wanted not in given:
        raise Wrong("W0247", f"'{kind}' needs '{wanted}'", item.span)
    points = _points(given[wanted])
    text = given.get("textString")
    pattern = str(given["fillPattern"]) if isinstance(given.get("fillPattern"), tree.Ref) else "FillPattern.None"
    filled = not pattern.endswith(".None")
    if kind != "Line" and kind != "Polygon" and len(points) != 2:
        raise Wrong("W0247", f"the extent of '{kind}' has two corners", given[wanted].span)
    if kind == "Rectangle":
        (a, b), (c, d) = points
        kind, points = "Polygon", ((a, b), (c, b), (c, d), (a, d))
    words = text.value if isinstance(text, tree.String) else ""
    colours = _line(kind, given), _colour(given, "fillColor")
    visible = _condition(given["visible"]) if "visible" in given else None
    return Drawn(kind.lower(), scaled(points), words, filled, *colours, _dashed(given), visible)


def _condition(value: tree.Expression) -> Condition | None:
    """``visible = not useSupport`` in parameters of the part; nothing, which is always, for what says it otherwise."""
    if isinstance(value, tree.Ref):
        return Condition(str(value))
    if isinstance(value, tree.Unary) and value.op == "not":
        inner = _condition(value.operand)
        return Condition("not", (inner,)) if inner else None
    if isinstance(value, tree.Binary) and value.op in ("and", "or"):
        left, right = _condition(value.left), _condition(value.right)
        return Condition(value.op, (left, right)) if left and right else None
    return None


def _static(value: tree.Expression) -> tree.Expression:
    """``DynamicSelect(x, y)`` is x in a picture (18.6.6)."""
    selects = isinstance(value, tree.Call) and str(value.function) == "DynamicSelect" and value.arguments
    return value.arguments[0] if selects else value


def _line(kind: str, given: dict[str, tree.Expression]) -> str:
    """The colour of a line or a text."""
    if kind == "Text":
        return _colour(given, "textColor") or _colour(given, "lineColor")
    if str(given.get("pattern", "")).endswith("LinePattern.None"):
        return "none"
    return _colour(given, "color" if kind == "Line" else "lineColor")


def _dashed(given: dict[str, tree.Expression]) -> bool:
    return str(given.get("pattern", "")).rpartition(".")[2] in ("Dash", "Dot", "DashDot", "DashDotDot")


def _colour(given: dict[str, tree.Expression], name: str) -> str:
    """``{red, green, blue}`` as ``#rrggbb``."""
    value = given.get(name)
    if value is None:
        return ""
    parts = [_number(n) for n in value.items] if isinstance(value, tree.Array) else []
    if len(parts) != 3 or not all(0 <= p <= 255 for p in parts):
        raise Wrong("W0247", "expected a colour {red, green, blue}, each from 0 to 255", value.span)
    return "#" + "".join(f"{round(p):02x}" for p in parts)


def _points(value: tree.Expression) -> tuple[Corner, ...]:
    """``{{x, y}, …}`` as numbers."""
    if isinstance(value, tree.Array) and len(value.items) >= 2:
        pairs = [tuple(_number(n) for n in p.items) if isinstance(p, tree.Array) else () for p in value.items]
        if all(len(p) == 2 for p in pairs):
            return tuple(pairs)
    raise Wrong("W0247", "expected points {{x, y}, {x, y}, …}", value.span)


def _number(value: tree.Expression) -> float:
    if isinstance(value, tree.Number):
        return value.value
    if isinstance(value, tree.Unary) and value.op in "+-":
        return _number(value.operand) * (-1 if value.op == "-" else 1)
    raise Wrong("W0247", "expected a number", value.span)
