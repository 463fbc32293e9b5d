"""Unit checks of the user's own equations and bindings.

A group is checked once: its columns have one unit each.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from lmoc.expression.dag import Expr
from lmoc.expression.text import to_text
from lmoc.expression.units import Unit, UnitError, parse_unit
from lmoc.messages.diagnostics import Report, Subject
from lmoc.messages.source import Source, Span
from lmoc.semantics.drafts.draft import Column, Drafts
from lmoc.semantics.nodes.instance import Variable
from lmoc.semantics.values.unit_inference import Mismatch, infer, unit_of


def check_units(drafts: Drafts, report: Report, own: Collection[Source]) -> None:
    """Report every equation, binding and start value of the user's whose units do not fit.

    In the text of a library that is found in a folder this is a warning: whoever uses it cannot mend it.

    Parameters
    ----------
    own : the files that the user has named
    """
    judged = Report([*drafts.arguments])
    _check_all(drafts, judged)
    for d in judged.diagnostics:
        if d.span is None or d.span.source in own:
            report.diagnostics.append(d)
        else:
            report.diagnostics.append(replace(d, code="W0303", subject=Subject.WRITING))


def _check_all(drafts: Drafts, report: Report) -> None:
    seen: set[tuple] = set()
    for group in (*drafts.groups, *drafts.branches, *drafts.initial):
        if not group.library:
            _check(report, seen, group.left, group.right, group.columns, None, group.span, group.node.label)
    for bindings in (drafts.bindings, drafts.starts):
        for b in bindings:
            if not b.library:
                _check(report, seen, None, b.shape, b.columns, b.variable, b.span)


def report_unknown_units(variables: Sequence[Variable], report: Report) -> None:
    """Unit strings that mean nothing, once for each place."""
    said: set[tuple] = set()
    for variable in variables:
        if not variable.unit:
            continue
        try:
            parse_unit(variable.unit)
        except UnitError as error:
            binding = variable.attributes.get("unit")
            span = getattr(binding.expression, "span", None) if binding else variable.span
            key = (id(span.source), span.start) if span else (variable.label,)
            if key not in said:
                said.add(key)
                report.error("E0304", str(error), span, hint=error.hint)


def _check(
    report: Report,
    seen: set[tuple],
    left: Expr | None,
    right: Expr,
    columns: Sequence[Column],
    target: Variable | None,
    span: Span | None,
    inside: str = "",
) -> None:
    written = tuple(variable.unit if variable is not None else "" for variable, _ in columns)
    key = (left, right, written, target and target.unit, span and span.start)
    if key in seen:
        return
    seen.add(key)
    units = tuple(unit_of(variable) for variable, _ in columns)
    own = unit_of(target)
    try:
        found = infer(right, units)
        expected = own if left is None else infer(left, units)
    except Mismatch as mismatch:
        _report_mismatch(report, mismatch, columns, span, inside)
        return
    if found is None or expected is None or found.same_as(expected):
        return
    side = target.label if left is None else to_text(left, _namer(columns, inside))
    value = to_text(right, _namer(columns, inside))
    report.error(
        "E0303",
        "the units of the two sides differ" if left is not None else f"the value of '{target.label}' has another unit",
        span,
        expected=f"{side} is in {target.unit if left is None else _shown(left, expected, columns)}",
        found=f"{value} is in {_shown(right, found, columns)}",
    )


def _shown(expr: Expr, unit: Unit, columns: Sequence[Column]) -> str:
    """The unit as it was declared, for a variable; else in base units."""
    variable = columns[expr.value[0]][0] if expr.op == "slot" and expr.value[1] == 0 else None
    return variable.unit if variable is not None and variable.unit else str(unit)


def _report_mismatch(report: Report, m: Mismatch, columns: Sequence[Column], span: Span | None, inside: str) -> None:
    name = _namer(columns, inside)
    if m.right is None:
        message = "this needs a number without unit"
        expected, found = "unit 1", f"{to_text(m.left, name)} is in {_shown(m.left, m.left_unit, columns)}"
    else:
        message = "quantities of different units are added or compared"
        expected = f"{to_text(m.left, name)} is in {_shown(m.left, m.left_unit, columns)}"
        found = f"{to_text(m.right, name)} is in {_shown(m.right, m.right_unit, columns)}"
    report.error("E0303", message, span, expected=expected, found=found)


def _namer(columns: Sequence[Column], inside: str):
    """Names for slots, as seen from inside a part."""
    lead = f"{inside}." if inside else ""

    def name(column: int, order: int) -> str:
        variable, index = columns[column]
        text = variable.label.removeprefix(lead) if variable is not None else "…"
        for _ in range(order):
            text = f"der({text})"
        return text

    return name
