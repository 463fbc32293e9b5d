"""The unit of an expression, from those of its variables.

A literal and a variable without unit have an unknown unit. What is unknown makes a product unknown, fits any sum, and
is never an error.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, UnitRule
from lmoc.expression.units import ONE_UNIT, SECOND, Unit, UnitError, parse_unit
from lmoc.semantics.nodes.instance import Variable
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.value import Value


class Mismatch(Exception):
    """Two operands whose units do not fit (`right` None: the left one should have no unit)."""

    def __init__(self, left: Expr, left_unit: Unit, right: Expr | None, right_unit: Unit):
        self.left, self.left_unit, self.right, self.right_unit = left, left_unit, right, right_unit


def unit_of(variable: Variable | None) -> Unit | None:
    """The declared unit; None where there is none, or where it is not understood (which has been reported)."""
    if variable is None:
        return None
    try:
        return parse_unit(variable.unit)
    except UnitError:
        return None


def infer(root: Expr, units: Sequence[Unit | None]) -> Unit | None:
    """The unit of a shape whose columns have these units.

    Raises
    ------
    Mismatch
    """
    found: dict[int, Unit | None] = {}
    for node in postorder(root):
        found[id(node)] = _infer_node(node, [found[id(a)] for a in node.args], units)
    return found[id(root)]


def has_unit(root: Expr, variables: Sequence[Variable | None]) -> bool:
    """Return whether a shape has a unit that is known, other than 1."""
    try:
        unit = infer(root, [unit_of(v) for v in variables])
    except Mismatch:
        return False  # which is reported with the equation
    return unit is not None and not unit.same_as(ONE_UNIT)


def unit_of_value(context: Context, value: Value) -> Unit | None:
    """The unit of an expression; None where it is unknown or inconsistent (which is reported with the equation)."""
    try:
        return infer(value.expr, [unit_of(leaf.variable) for leaf in context.leaves.items])
    except Mismatch:
        return None


def _infer_node(node: Expr, args: list[Unit | None], units: Sequence[Unit | None]) -> Unit | None:
    op = node.op
    if op == "slot":
        unit = units[node.value[0]]
        return None if unit is None else unit / SECOND ** node.value[1] if node.value[1] else unit
    if op in ("const", "time"):  # sin(time) is a signal that people write: time counts as a plain number
        return None
    rule = FUNCTIONS[op].unit
    if op in ("add", "sub") and None not in args and (args[0].offset or args[1].offset):
        return _of_temperatures(node, *args)
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
            raise Mismatch(node.args[0], args[0], None, ONE_UNIT)
        return ONE_UNIT if args[0] is not None else None
    if rule is UnitRule.CHOICE:
        return _common(node.args[1], args[1], node.args[2], args[2])
    return ONE_UNIT if rule is UnitRule.NONE else None


def _common(a: Expr, unit_a: Unit | None, b: Expr, unit_b: Unit | None) -> Unit | None:
    if unit_a is not None and unit_b is not None and not unit_a.same_as(unit_b):
        raise Mismatch(a, unit_a, b, unit_b)
    return unit_a if unit_a is not None else unit_b


def _of_temperatures(node: Expr, a: Unit, b: Unit) -> Unit:
    """Return the unit of a sum or difference with degrees of a scale that does not begin at zero: 20 degC + 5 K."""
    if a.same_step(b):
        if node.op == "sub" and a.offset == b.offset:
            return Unit(a.exponents, a.factor)
        if not b.offset or (node.op == "add" and not a.offset):
            return a if a.offset else b
    raise Mismatch(node.args[0], a, node.args[1], b)


def _infer_power(node: Expr, args: list[Unit | None]) -> Unit | None:
    base, exponent = args
    if exponent is not None and not exponent.same_as(ONE_UNIT):
        raise Mismatch(node.args[1], exponent, None, ONE_UNIT)
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
