"""Assertions, and limits of parameters, that hold or not before anything moves."""

from __future__ import annotations

import numpy as np

from lmoc.ir.flat import Check, FlatDAE, Kind
from lmoc.messages.diagnostics import Label, Report, Subject
from lmoc.messages.ranges import over_range

_SHOWN = 4  # at most this many values are shown
_HINT = "look for a division by zero, the root or logarithm of a negative number"


def check_parameters(flat: FlatDAE, values: np.ndarray, report: Report) -> None:
    """Report each assertion of level error, over parameters alone, that their values break.

    Parameters
    ----------
    flat : FlatDAE
    values : (variables,) those of parameters and constants, NaN where there is none: what uses it is not judged
    report : takes E0551, and W0537 for what has lost its value
    """
    warn_of_lost(flat, values, report)
    _warn_of_signs(flat, values, report)
    for check in flat.checks:
        if not check.error or check not in flat.constant_checks:
            continue  # looked at along the run
        broken = np.flatnonzero(~check.holds(values))
        broken = broken[~np.isnan(values[check.slots[broken]]).any(axis=1)]
        if len(broken):
            named = dict.fromkeys(int(i) for i in check.slots[broken[0]] if flat.kind[i] == Kind.PARAMETER)
            found = ", ".join(f"{flat.variable_name(i)} = {values[i]:g}" for i in list(named)[:_SHOWN])
            _report_broken(flat, check, int(broken[0]), found, report)


def _report_broken(flat: FlatDAE, check: Check, row: int, found: str, report: Report) -> None:
    """Report an assertion: of a part, where the part is declared."""
    part = flat.parts[check.part]
    if not check.part or part.span is None or check.span is None:
        report.error("E0551", check.message, check.span, found=found)
        return
    message = f"{part.element(row, len(check.slots))}: {check.message}"
    report.error("E0551", message, part.span, found=found, labels=(Label(check.span, "required here"),))


def warn_of_lost(flat: FlatDAE, values: np.ndarray, report: Report) -> None:
    """A binding without a finite value, though everything in it has one: 1/0, the root of a negative number."""
    lost = ~np.isfinite(values) & (flat.kind <= Kind.PARAMETER)
    if not lost.any():
        return
    given = given_without_value(flat, values)
    for binding in flat.bindings:
        if binding.numbers is not None:
            continue
        rows = np.flatnonzero(lost[binding.target] & ~lost[binding.slots].any(axis=1))
        if len(rows):
            variables = binding.target[rows]
            names, value = [flat.variable_name(v) for v in variables.tolist()], values[variables[0]]
            name = over_range(names) or f"{names[0]} (and {len(names) - 1} more bound there)"
            if given[variables[0]]:
                message = f"the value given for {name} is not finite ({value})"
                report.warning("W0537", message, subject=Subject.NOT_FINITE)
            else:
                message = f"{name} has no finite value ({value})"
                report.warning("W0537", message, binding.span, hint=_HINT, subject=Subject.NOT_FINITE)


def _warn_of_signs(flat: FlatDAE, values: np.ndarray, report: Report) -> None:
    """A spring or a damper with a negative coefficient is allowed, and seldom meant."""
    variables = flat.coefficients
    for variable in variables[values[variables] < 0][:_SHOWN].tolist():
        name, block = flat.variable_name(variable), flat.block_at(variable)
        damping = ".s" in block.unit
        what = "damping: it feeds energy in" if damping else "stiffness: it pushes away from its relaxed length"
        message = f"{name} = {values[variable]:g} {block.unit} is a negative {what}"
        report.warning("W0560", message, flat.declared_at(variable), hint="a sign too many, unless that is meant")


def given_without_value(flat: FlatDAE, values: np.ndarray) -> np.ndarray:
    """(variables,) mask of those without finite value that have one in the model: the caller has given another."""
    mask = np.zeros(flat.count, bool)
    for binding in flat.bindings:
        mask[binding.target] = np.isfinite(binding.values(values)) & ~np.isfinite(values[binding.target])
    return mask & (flat.kind <= Kind.PARAMETER)
