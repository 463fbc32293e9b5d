"""Units of what is shown: as declared, or those of a variable with the same value."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Apply, Total
from lmoc.ir.reduced import Reduced
from lmoc.symbolic.styles import unit_text


def unit_of(reduced: Reduced, name: str) -> str:
    """Unit of a variable or a state's derivative as written, or of a variable with the same value; else empty."""
    order = name.count("der(")
    found = reduced.flat.find(name.replace("der(", "").rstrip(")") if order else name)
    if found is None:
        return ""
    unit = reduced.flat.block_at(int(found[0])).unit or _unit_of_equals(reduced, int(found[0]))
    for _ in range(order if unit else 0):
        unit = _per_second(unit)
    return unit


def _unit_of_equals(reduced: Reduced, variable: int) -> str:
    """The unit of the first variable that shares its register: what an output without unit was bound to."""
    register = reduced.register_of[variable]
    if register < 0 or _is_number(reduced, int(register)):
        return ""  # several variables are zero: that says nothing about their units
    equals = np.flatnonzero(reduced.register_of == register)
    return next((b.unit for v in equals if (b := reduced.flat.block_at(int(v))).unit), "")


def _is_number(reduced: Reduced, register: int) -> bool:
    """Return whether a register holds a number that stands in the equations."""
    for step in (*reduced.parameter_program, *reduced.rhs, *reduced.observe):
        if isinstance(step, Apply) and step.shape.op == "const" and register in step.out:
            return True
        if isinstance(step, Total) and register in step.out:
            k = int(np.flatnonzero(step.out == register)[0])
            return bool(step.start[k] == step.start[k + 1])
    return False


def _per_second(unit: str) -> str:
    """The unit of a derivative: m → m/s → m/s2."""
    if unit == "1":
        return "1/s"
    head, slash, tail = unit.rpartition("/s")
    if slash and (not tail or tail.isdigit()):
        return f"{head}/s{int(tail or 1) + 1}"
    return f"{unit}/s" if "/" not in unit else f"{unit}.s-1"


def ratio(above: str, below: str) -> str:
    """The unit of a quotient, for a person: ``m/N``, ``rad/(N·m)``; 1 where both are the same, empty if not known."""
    if not above or not below:
        return ""
    if above == below:
        return "1"
    below = f"({unit_text(below)})" if "." in below or "/" in below else unit_text(below)
    above = f"({unit_text(above)})" if "/" in above else unit_text(above)
    return above if below == "1" else f"{above}/{below}"
