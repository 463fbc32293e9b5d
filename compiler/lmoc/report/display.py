"""Units in which a person wants to read results; everything is computed and saved in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterable

from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.support.records import dataclass

# unit: the SI unit that it stands for, and its size in it
UNITS = {
    "nm": ("m", 1e-9), "um": ("m", 1e-6), "mm": ("m", 1e-3), "cm": ("m", 1e-2), "km": ("m", 1e3),
    "mm/s": ("m/s", 1e-3), "km/h": ("m/s", 1 / 3.6), "mm/s2": ("m/s2", 1e-3),
    "deg": ("rad", math.pi / 180), "rev": ("rad", 2 * math.pi),
    "deg/s": ("rad/s", math.pi / 180), "rpm": ("rad/s", math.pi / 30),
    "deg/s2": ("rad/s2", math.pi / 180),
    "mN": ("N", 1e-3), "kN": ("N", 1e3), "N.mm": ("N.m", 1e-3), "kN.m": ("N.m", 1e3),
    "mJ": ("J", 1e-3), "kJ": ("J", 1e3), "mW": ("W", 1e-3), "kW": ("W", 1e3), "g": ("kg", 1e-3),
    "mA": ("A", 1e-3), "mV": ("V", 1e-3), "kPa": ("Pa", 1e3), "MPa": ("Pa", 1e6), "bar": ("Pa", 1e5),
    "N/mm": ("N/m", 1e3),
}  # fmt: skip


@dataclass(frozen=True)
class Display:
    """Units to be shown instead of others.

    Attributes
    ----------
    by_unit : {SI unit: (unit shown, its size)}
    """

    by_unit: dict[str, tuple[str, float]]

    def unit(self, unit: str) -> str:
        """Return the unit in which a quantity is shown."""
        return self.by_unit.get(unit, (unit, 1.0))[0]

    def value(self, value, unit: str):
        """Return a value, or an array of values, as it is shown."""
        return value / self.by_unit[unit][1] if unit in self.by_unit else value


def display(units: str | Iterable[str] | None) -> Display:
    """Return how to show quantities.

    Parameters
    ----------
    units : such as ``["mm", "deg", "rpm"]`` or ``"mm,deg,rpm"``; each replaces the SI unit of its quantity

    Raises
    ------
    ModelError
        E0629: an unknown unit, or two for one quantity.
    """
    names = units.split(",") if isinstance(units, str) else list(units or ())
    found: dict[str, tuple[str, float]] = {}
    for name in (n.strip() for n in names):
        if name not in UNITS:
            expected = ", ".join(UNITS)
            message = f"'{name}' is no unit that can be shown"
            raise ModelError([Diagnostic("E0629", message, expected=expected, hint=nearest(name, UNITS))])
        unit, size = UNITS[name]
        if unit in found:
            raise ModelError([Diagnostic("E0629", f"{found[unit][0]} and {name} are units of the same quantity")])
        found[unit] = name, size
    return Display(found)
