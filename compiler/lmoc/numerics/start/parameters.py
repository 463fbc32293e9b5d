"""Parameters that the equations need and that have no value."""

from __future__ import annotations

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.program import needed_steps, read
from lmoc.messages.diagnostics import Report, Subject
from lmoc.messages.ranges import LOOKED_AT, over_range, report_alike
from lmoc.numerics.plan.plan import Plan
from lmoc.semantics.parameter_checks import given_without_value
from lmoc.structure.messages.equations import SHOWN
from lmoc.support.distinct import distinct


def check_parameters(plan: Plan, base: np.ndarray, values: np.ndarray, report: Report) -> None:
    """Every parameter that the equations read has a value."""
    flat, (registers, variables) = plan.reduced.flat, plan.read_parameters
    missing = variables[np.isnan(base[registers])]
    if not len(missing):
        missing = _needed_for_derived(plan, base)
    if not len(missing):
        missing = flat.read_beside[np.isnan(values[flat.read_beside])]
    if len(missing):
        _report_missing(flat, missing, values, report)


def _report_missing(flat: FlatDAE, missing: np.ndarray, values: np.ndarray, report: Report) -> None:
    sources, found = sources_without_value(flat, missing, values), Report()
    bound = np.isin(sources, np.concatenate([np.zeros(0, int), *(a.target for a in flat.bindings)])).tolist()
    given = given_without_value(flat, values)
    for variable, has_binding in list(zip(sources, bound, strict=True))[:LOOKED_AT]:
        block = flat.block_at(variable)
        name = flat.variable_name(variable)
        span = flat.declared_at(variable) if block.part else block.span
        message, hint = f"parameter '{name}' has no value", f"--set {name}=…, or bind it in the model"
        if given[variable]:
            message, span, hint = f"the value given for parameter '{name}' is not a number (nan)", None, ""
        elif has_binding:
            message = f"the value of parameter '{name}' is not a number (nan)"
            hint = "look for 0/0, and for roots or logarithms of negative numbers"
        found.error("E0530", message, span, hint=hint)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(sources) - LOOKED_AT))


def check_derived(plan: Plan, base: np.ndarray, report: Report) -> None:
    """Check that quantities of parameters alone are finite, too; the motion does not depend on those that are not."""
    variables, registers = plan.derived
    lost = variables[~np.isfinite(base[registers])]
    if len(lost) and not np.isnan(base[plan.known[0]]).any():
        flat, first = plan.reduced.flat, int(lost[0])
        value, block = base[registers[variables == first][0]], flat.block_at(first)
        names = [flat.variable_name(v) for v in distinct(lost).tolist() if flat.block_at(v) is block]
        name = over_range(names) or f"{flat.variable_name(first)} (and {len(names) - 1} more of its array)"
        span = flat.declared_at(first) if block.part else block.span
        report.warning("W0537", f"{name} has no finite value ({value})", span, subject=Subject.NOT_FINITE)


def sources_without_value(flat: FlatDAE, variables: np.ndarray | int, values: np.ndarray) -> list[int]:
    """The parameters without value that the bindings of some come from; themselves where nothing else lacks one."""
    lacking, wanted = np.isnan(values), np.zeros(flat.count, bool)
    wanted[variables] = True
    for binding in reversed(flat.bindings):  # each uses only what precedes it
        rows = np.flatnonzero(wanted[binding.target])
        slots = binding.slots[rows]
        from_others = lacking[slots]
        wanted[binding.target[rows[from_others.any(axis=1)]]] = False
        wanted[slots[from_others]] = True
    return np.flatnonzero(wanted).tolist()


def _needed_for_derived(plan: Plan, base: np.ndarray) -> np.ndarray:
    """Parameters without value that only derived parameters read."""
    bad = plan.parameters[np.isnan(base[plan.parameters])]
    if not len(bad):
        return np.zeros(0, int)
    used = [read(s) for s in needed_steps(plan.reduced.parameter_program, bad, plan.count)]
    if not used:
        return np.zeros(0, int)
    own = np.isin(plan.known[0], np.concatenate(used)) & np.isnan(base[plan.known[0]])
    return plan.known[1][own]
