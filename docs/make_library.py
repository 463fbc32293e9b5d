"""Writes the page of the library from its source: ``python docs/make_library.py`` renews ``docs/library.md``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from lmoc.sources import library
from lmoc.syntax import tree

PAGE = Path(__file__).with_name("library.md")

INTRODUCTION = """\
# The library

These parts need no import, but for those of [the plane](#the-plane): `import Planar.*;` inside a model brings them, and
hides the global names of the same parts, which stay reachable as `.Spring`. A name of your own in a file hides the
library's.

*This page is made from `stdlib/*.lmo` by `python docs/make_library.py`.*

## Conventions

- **Coordinates.** A `Flange` has a position `q` along a line, a `Shaft` an angle `theta` about a fixed axis. Each
  position is counted from its own reference line, in a sense that you choose; connected flanges share both.
- **Forces.** `f` and `tau` are flows: positive into the part, and a positive force on a flange pushes along `+q`. At a
  connection they add up to zero; a port that is connected to nothing has none.
- **Tension.** Elements with two ends carry a tension: `a.f = -f`, `b.f = +f`, so a positive `f` pulls the ends together
  (and `tau` turns `b` back towards `a`). It grows with the length `b.q - a.q`. This holds for rods too.
- **Gravity** along a line is a parameter of a mass, and acts along `+q`: `g = 9.81` where positions count downwards,
  `g = -9.81` where they count upwards.
- **The plane.** A `Point` has a position `x`, `y` (upwards), a `Frame` a direction `theta` as well (counter-clockwise);
  all are counted from one frame of reference. A point `(rx, ry)` of a body, seen from its frame, is at
  `x + rx*cos(theta) - ry*sin(theta)`, `y + rx*sin(theta) + ry*cos(theta)`. The tension of an element between two
  points acts along the line between them. Gravity belongs to the `World` that all bodies share, and acts along `-y`.
- **Signs of ratios.** Ratios, radii and arms may be negative: the opposite sense of rotation or motion.
- **Energy.** What a part stores is its `energy`, what it dissipates its `loss`, what it supplies its `power`. Ideal
  transmissions neither store nor lose. A run adds them up: `run.energy`.
- **Parameters without a default** must be given.
- **Inputs of parts** (`Force.f`, `Motion.q`, …) are bound where the part is declared: `Force push(f = u)` or
  `Force push(f = 3*sin(2*time))`. A prescribed motion needs a signal with as many derivatives as the scene asks for.
"""

TITLES = {
    "translational.lmo": "Motion along a line",
    "rotational.lmo": "Rotation",
    "couplings.lmo": "Couplings",
    "laws.lmo": "Strings, stops, friction, play",
    "machines.lmo": "Machines",
    "planar.lmo": "The plane",
}


def page() -> str:
    """The whole page as Markdown."""
    files = {file.span.source.name.rpartition("/")[2]: file for file in library.load()}
    top = {c.name: c for file in files.values() for c in file.classes}
    units = {c.name: _unit(c) for c in top["Units"].elements if isinstance(c, tree.Class)}
    text = [INTRODUCTION]
    for name, title in TITLES.items():
        text.append(f"## {title}\n\n`stdlib/{name}`\n")
        own = [c for c in files[name].classes if c.kind != "package"]
        packages = [c.elements for c in files[name].classes if c.kind == "package"]
        for group in (own, *packages):
            inside = [e for e in group if isinstance(e, tree.Class) and e.kind != "function"]
            classes = top | {c.name: c for c in inside}
            text += [_part(c, classes, units) for c in inside if not c.partial]
    return "\n".join(text)


def _unit(short: tree.Class) -> str:
    arguments = short.short.modification.arguments if short.short.modification else ()
    return next((a.modification.value.value for a in arguments if a.name == ("unit",)), "")


def _part(part: tree.Class, classes: Mapping[str, tree.Class], units: Mapping[str, str]) -> str:
    declared = list(_members(part, classes))
    ports = [c for c in declared if _kind(c, classes) == "connector"]
    parameters = [c for c in declared if c.variability == "parameter"]
    inputs = [c for c in declared if c.causality == "input"]
    variables = [c for c in declared if c not in (*ports, *parameters, *inputs) and c.variability != "constant"]
    lines = [f"### {part.name}\n", f"{part.description}.\n"]
    if ports:
        lines.append("Ports: " + ", ".join(_port(c) for c in ports) + "\n")
    derived = _derived(part)
    rows = [_row(c, "parameter", units, derived) for c in parameters] + [_row(c, "input", units, {}) for c in inputs]
    rows += [_row(c, "flow variable" if c.flow else "variable", units, {}) for c in variables]
    if rows:
        lines += ["| name | | unit | default | meaning |", "| --- | --- | --- | --- | --- |", *rows, ""]
    if laws := list(_laws(part, classes)):
        lines += ["```modelica", *laws, "```", ""]
    return "\n".join(lines)


def _members(part: tree.Class, classes: Mapping[str, tree.Class]) -> Iterator[tree.Component]:
    """Declarations, inherited ones first."""
    for element in part.elements:
        if isinstance(element, tree.Extends):
            yield from _members(classes[str(element.base)], classes)
    for element in part.elements:
        if isinstance(element, tree.Component) and not element.outer:
            yield element


def _kind(component: tree.Component, classes: Mapping[str, tree.Class]) -> str:
    found = classes.get(str(component.type))
    return found.kind if found else ""


def _port(component: tree.Component) -> str:
    meaning = f" ({component.description})" if component.description else ""
    return f"`{component.type} {component.name}`{meaning}"


def _derived(part: tree.Class) -> dict[str, str]:
    """Parameters that an ``extends`` fixes: {name: expression}."""
    modifications = [e.modification for e in part.elements if isinstance(e, tree.Extends) and e.modification]
    return {
        ".".join(a.name): a.modification.value.span.text
        for m in modifications
        for a in m.arguments
        if isinstance(a, tree.ElementModification) and a.final
    }


def _row(c: tree.Component, kind: str, units: Mapping[str, str], derived: Mapping[str, str]) -> str:
    unit = units.get(str(c.type).removeprefix("Units."), str(c.type))
    value = c.modification.value.span.text if c.modification and c.modification.value else ""
    if c.name in derived:
        kind, value = "derived", derived[c.name]
    return f"| `{c.name}` | {kind} | {unit} | {f'`{value}`' if value else ''} | {c.description} |"


def _laws(part: tree.Class, classes: Mapping[str, tree.Class]) -> Iterator[str]:
    for element in part.elements:
        if isinstance(element, tree.Extends):
            yield from _laws(classes[str(element.base)], classes)
    for equation in part.equations:
        first, *rest = equation.span.text.rstrip(";").splitlines()
        yield "\n".join([first, *(line.removeprefix("  ") for line in rest)]) + ";"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
