"""Suggestions for unknown names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lmoc.messages.diagnostics import nearest
from lmoc.semantics.classes.place import Member, Place
from lmoc.semantics.classes.predefined import BUILTINS, FOREIGN_TYPES, Builtin
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.sources import library
from lmoc.syntax import tree

# Units of the quantities of the Modelica Standard Library that mechanical models use.
_SI_UNITS = {
    **dict.fromkeys(("Length", "Position", "Distance", "Radius", "Diameter", "Height", "Breadth", "Thickness"), "m"),
    **dict.fromkeys(("Angle", "Angle_deg", "Phase"), "rad"),
    **dict.fromkeys(("Torque", "MomentOfForce"), "N.m"),
    **dict.fromkeys(("Inertia", "MomentOfInertia"), "kg.m2"),
    **dict.fromkeys(("Energy", "Work", "Heat"), "J"),
    **dict.fromkeys(("Voltage", "ElectricPotential"), "V"),
    **{"Area": "m2", "Volume": "m3", "Time": "s", "Duration": "s", "Mass": "kg", "Density": "kg/m3"},
    **{"Velocity": "m/s", "Acceleration": "m/s2", "Jerk": "m/s3"},
    **{"AngularVelocity": "rad/s", "AngularAcceleration": "rad/s2", "Frequency": "Hz", "AngularFrequency": "rad/s"},
    **{"Force": "N", "Momentum": "kg.m/s", "Impulse": "N.s", "AngularMomentum": "kg.m2/s", "Power": "W"},
    **{"Pressure": "Pa", "Stress": "Pa", "TranslationalSpringConstant": "N/m"},
    **{"TranslationalDampingConstant": "N.s/m", "RotationalSpringConstant": "N.m/rad"},
    **{"RotationalDampingConstant": "N.m.s/rad", "Temperature": "K", "Current": "A", "ElectricCurrent": "A"},
    **{"Resistance": "Ohm", "Inductance": "H", "Capacitance": "F", "ElectricCharge": "C"},
}
_CONSTANTS = {"pi": "3.141592653589793", "e": "2.718281828459045", "g_n": "9.80665"}


def either(words: Sequence[str]) -> str:
    """Return the words in a row, the last two joined by 'or'."""
    return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else words[0]


def classes_hint(scope: Place) -> str:
    """Return a hint with the classes in a class."""
    names = [name for name, found in scope.table.items() if not isinstance(found, Member)]
    names += [name for name in scope.names() if name not in names]
    return f"it has {', '.join(names[:8])}" if names else ""


def modelica_hint(path: Sequence[str]) -> str:
    """Return what to write instead of a name from the Modelica Standard Library, empty for other names."""
    if path[0] not in ("Modelica", "SI", "SIunits", "Units"):
        return ""
    name = path[-1]
    if {"SI", "SIunits", "Units"} & set(path[:-1]):
        unit = _SI_UNITS.get(name)
        return f"write 'Real' with its unit: 'Real x(unit = \"{unit or '…'}\")'"
    if "Constants" in path and name in _CONSTANTS:
        return f"write 'constant Real {name} = {_CONSTANTS[name]};'"
    if path[0] == "Modelica":
        return "the Modelica Standard Library is not available; lmo's own parts need no import"
    return ""


def import_hint(scope: Place, path: Sequence[str]) -> str:
    """Return a hint for an import that finds nothing."""
    first = scope.root.find(path[0])
    if first is None and (hint := modelica_hint(path)):
        return hint
    if first is not None and not isinstance(first, Member | Builtin) and len(path) == 2:
        return nearest(path[1], first.table) or classes_hint(first)
    around = scope.root.parent or scope.root
    names = (*scope.root.names(), *around.names())
    return nearest(path[0], names) if first is None else ""


def visible(scope: Place) -> Iterator[str]:
    """Yield all names that can be seen from a class."""
    place: Place | None = scope
    while place is not None:
        yield from place.table if place.complete else place.local
        yield from place.names()
        for element in place.imports:
            yield from element.names or (element.alias or element.path[-1],)
            if element.wildcard:
                yield from _imported(place, element)
        place = place.parent
    yield from BUILTINS


def _components(scope: Place) -> Iterator[str]:
    """Yield the names of the components that can be seen from a class."""
    place: Place | None = scope
    while place is not None:
        own = place.table if place.complete else {}
        yield from (name for name, element in own.items() if isinstance(element, Member))
        place = place.parent


def _imported(scope: Place, element: tree.Import) -> Iterator[str]:
    found = scope.root.find(element.path[0])
    try:
        for name in element.path[1:]:
            found = found.table.get(name) if found is not None and not isinstance(found, Member | Builtin) else None
    except Wrong:
        return  # reported where a name is looked up
    if found is not None and not isinstance(found, Member | Builtin):
        yield from found.table


def suggest(scope: Place, name: str) -> str:
    """Return a hint with the visible name most like this one, which is no component."""
    if name in FOREIGN_TYPES:
        return f"write '{FOREIGN_TYPES[name]}'"
    packages = library.packages_with(name)
    if packages:
        return f"'import {packages[0]}.*;' in the model brings the library's {packages[0]}.{name}"
    names = set(visible(scope)) - set(_components(scope))
    return f"did you mean '{name}'?" if name in names else nearest(name, sorted(names))
