"""Unit checks of the user's own equations and bindings.

A literal and a variable without unit have an unknown unit. What is unknown makes a product unknown, fits any sum, and
is never an error. A group is checked once: its columns have one unit each.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, UnitRule
from lmoc.expression.text import to_text
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span
from lmoc.semantics.draft import Column, Drafts
from lmoc.semantics.instances.instance import Variable
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.units import ONE_UNIT, SECOND, Unit, UnitError, parse_unit
from lmoc.semantics.values.value import Value


class _Mismatch(Exception):
    """Two operands whose units do not fit (`right` None: the left one should have no unit)."""

    def __init__(self, left: Expr, left_unit: Unit, right: Expr | None, right_unit: Unit):
        self.left, self.left_unit, self.right, self.right_unit = left, left_unit, right, right_unit


def check_units(drafts: Drafts, report: Report) -> None:
    """Report every equation, binding and start value of the user's whose units do not fit."""
    seen: set[tuple] = set()
    for group in (*drafts.groups, *drafts.branches, *drafts.initial):
        if not group.library:
            _check(report, seen, group.left, group.right, group.columns, None, group.span, group.node.label)
    for bindings in (drafts.bindings, drafts.starts):
        for b in bindings:
            if not b.library:
                _check(report, seen, None, b.shape, b.columns, b.variable, b.span)


def unit_of(variable: Variable | None) -> Unit | None:
    """The declared unit; None where there is none, or where it is not understood (which has been reported)."""
    if variable is None:
        return None
    try:
        return parse_unit(variable.unit)
    except UnitError:
        return None


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
    except _Mismatch as mismatch:
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


def _report_mismatch(report: Report, m: _Mismatch, columns: Sequence[Column], span: Span | None, inside: str) -> None:
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


def infer(root: Expr, units: Sequence[Unit | None]) -> Unit | None:
    """The unit of a shape whose columns have these units.

    Raises
    ------
    _Mismatch
    """
    found: dict[int, Unit | None] = {}
    for node in postorder(root):
        found[id(node)] = _infer_node(node, [found[id(a)] for a in node.args], units)
    return found[id(root)]


def has_unit(root: Expr, variables: Sequence[Variable | None]) -> bool:
    """Return whether a shape has a unit that is known, other than 1."""
    try:
        unit = infer(root, [unit_of(v) for v in variables])
    except _Mismatch:
        return False  # which is reported with the equation
    return unit is not None and not unit.same_as(ONE_UNIT)


def unit_of_value(context: Context, value: Value) -> Unit | None:
    """The unit of an expression; None where it is unknown or inconsistent (which is reported with the equation)."""
    try:
        return infer(value.expr, [unit_of(leaf.variable) for leaf in context.leaves.items])
    except _Mismatch:
        return None


def _infer_node(node: Expr, args: list[Unit | None], units: Sequence[Unit | None]) -> Unit | None:
    op = node.op
    if op == "slot":
        unit = units[node.value[0]]
        return None if unit is None else unit / SECOND ** node.value[1] if node.value[1] else unit
    if op in ("const", "time"):  # sin(time) is a signal that people write: time counts as a plain number
        return None
    rule = FUNCTIONS[op].unit
    if rule in (UnitRule.COMMON, UnitRule.COMPARED):
        unit = _common(node.args[0], args[0], node.args[1], args[1])
        return unit if rule is UnitRule.COMMON else ONE_UNIT
    if rule in (UnitRule.PRODUCT, UnitRule.QUOTIENT):
        if args[0] is None or args[1] is None:
            return None
        return args[0] * args[1] if rule is UnitRule.PRODUCT else args[0] / args[1]
    if rule is UnitRule.POWER:
        return _infer_power(node, args)
    if rule is UnitRule.ROOT:
        return args[0] and _to_power(args[0], 0.5)
    if rule is UnitRule.KEPT:
        return args[0]
    if rule is UnitRule.NUMBER:
        if args[0] is not None and not args[0].same_as(ONE_UNIT):
            raise _Mismatch(node.args[0], args[0], None, ONE_UNIT)
        return ONE_UNIT if args[0] is not None else None
    if rule is UnitRule.CHOICE:
        return _common(node.args[1], args[1], node.args[2], args[2])
    return ONE_UNIT if rule is UnitRule.NONE else None


def _common(a: Expr, unit_a: Unit | None, b: Expr, unit_b: Unit | None) -> Unit | None:
    if unit_a is not None and unit_b is not None and not unit_a.same_as(unit_b):
        raise _Mismatch(a, unit_a, b, unit_b)
    return unit_a if unit_a is not None else unit_b


def _infer_power(node: Expr, args: list[Unit | None]) -> Unit | None:
    base, exponent = args
    if exponent is not None and not exponent.same_as(ONE_UNIT):
        raise _Mismatch(node.args[1], exponent, None, ONE_UNIT)
    if base is None or base.same_as(ONE_UNIT):
        return base
    if node.args[1].is_const and abs(node.args[1].value) < 1000:
        return _to_power(base, node.args[1].value)
    return None


def _to_power(unit: Unit, power: float) -> Unit:
    if power == int(power):
        return unit ** int(power)
    from fractions import Fraction

    return unit ** Fraction(power).limit_denominator(64)
