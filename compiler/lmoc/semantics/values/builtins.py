"""The predefined functions (Modelica specification, 3.7 and 10.3)."""

from __future__ import annotations

from collections.abc import Callable

from lmoc.expression import dag
from lmoc.expression.calculus import total_derivative
from lmoc.expression.functions import FUNCTIONS, SMOOTH, Kind
from lmoc.ir.flat import Kind as Role
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.helpers import WEIGHT
from lmoc.semantics.values.translate import (
    at_event,
    changes,
    choose,
    need_number,
    sizes_differ,
    warn_kink,
)
from lmoc.semantics.values.value import Value, common_type, text
from lmoc.syntax import tree

Handler = Callable[[Context, tree.Call], Value]
BUILTIN_FUNCTIONS: dict[str, Handler] = {}

KINKED = tuple(f.name for f in FUNCTIONS.values() if f.kind is Kind.KINKED and f.arity == 1)
LATER = "delay spatialDistribution".split()
_INSTEAD = {
    "delay": "a formula of time is written with time - T in it, a table has its times shifted; what follows a state is "
    "nearly a lag: T*der(y) = u - y"
}


def builtin(*names: str):
    """Register the function that translates calls of these names."""

    def register(function: Handler) -> Handler:
        for name in names:
            BUILTIN_FUNCTIONS[name] = function
        return function

    return register


def arguments(context: Context, call: tree.Call, low: int, high: int | None = None) -> list[Value]:
    """The values of positional arguments, of which there must be so many."""
    high = low if high is None else high
    name, count = str(call.function), len(call.arguments)
    if call.named:
        raise Wrong("E0217", f"'{name}' takes no named arguments", call.span)
    if not low <= count <= high:
        expected = str(low) if low == high else f"{low} to {high}"
        raise Wrong("E0217", f"'{name}' is called with {count} argument{'s' * (count != 1)}", call.span,
                    expected=expected, found=str(count))  # fmt: skip
    return [context.value(a) for a in call.arguments]


def numbers(context: Context, call: tree.Call, low: int, high: int | None = None) -> list[Value]:
    """As `arguments`, where all of them must be numbers."""
    values = arguments(context, call, low, high)
    for value, place in zip(values, call.arguments):
        need_number(value, place.span)
    return values


# ------------------------------------------------------------------- element by element


@builtin(*SMOOTH)
def _smooth(context: Context, call: tree.Call) -> Value:
    (x,) = numbers(context, call, 1)
    name = call.function.parts[0].name
    return context.arrays.map(lambda e: dag.function(name, e), x)


@builtin(*KINKED)
def _kinked(context: Context, call: tree.Call) -> Value:
    (x,) = numbers(context, call, 1)
    name = call.function.parts[0].name
    type_ = "Integer" if name in ("integer", "sign") or x.type == "Integer" and name == "abs" else "Real"
    result = context.arrays.map(lambda e: dag.function(name, e), x, type=type_)
    if name == "abs":  # 3.7.1: has a kink, but no jump
        warn_kink(context, "abs(…)", call.span, x)
        return result
    return at_event(context, result)


@builtin("atan2", "mod", "rem", "div")
def _two_arguments(context: Context, call: tree.Call) -> Value:
    x, y = numbers(context, call, 2)
    if x.dims and y.dims and x.dims != y.dims:
        raise sizes_differ("the arguments", x.dims, y.dims, call.span)
    name = call.function.parts[0].name
    op = "div_integer" if name == "div" else name
    type_ = "Real" if name == "atan2" else common_type((x, y))
    result = context.arrays.map(lambda a, b: dag.function(op, a, b), x, y, type=type_)
    return result if name == "atan2" else at_event(context, result)


@builtin("min", "max")
def _extreme(context: Context, call: tree.Call) -> Value:
    name = call.function.parts[0].name
    values = arguments(context, call, 1, 2)
    for value, place in zip(values, call.arguments):
        if value.type == "String" or value.type != values[0].type:
            need_number(value, place.span)
            need_number(values[0], call.arguments[0].span)
        if isinstance(place, tree.Comprehension) and len(value.dims) > len(place.indices):
            raise Wrong("E0302", f"'{name}' takes single values", place.span, found="an array")
    of_truth = values[0].type == "Boolean"  # false is less than true (3.5)
    op = {"min": "and", "max": "or"}[name] if of_truth else name
    if not of_truth:
        warn_kink(context, f"{name}(…)", call.span, *values)
    if len(values) == 2:
        x, y = values
        if x.dims or y.dims:
            raise Wrong("E0302", f"'{name}' of two arguments takes single values", call.span)
        return Value(dag.function(op, x.expr, y.expr), (), x.type if of_truth else common_type(values))
    scalars = context.arrays.scalars(values[0])
    if not scalars:
        raise Wrong("E0302", f"'{name}' of an empty array", call.span)
    result = scalars[0].expr
    for item in scalars[1:]:
        result = dag.function(op, result, item.expr)
    return Value(result, (), values[0].type)


# What is exchanged where nothing flows, in the unit of the flow: it settles 0·h = 0, in which h is an unknown, at the
# mean of what is around (3.7.4.5 asks for one meaningful solution), and is lost in rounding beside any flow that
# counts. Products of three such coefficients are still far from underflow. Beside larger flows it is left out: the side
# that does not count may have no value there.
_EXCHANGE, _NOTHING = 1e-60, 1e-30


@builtin("semiLinear")
def _semi_linear(context: Context, call: tree.Call) -> Value:
    x, positive, negative = numbers(context, call, 3)
    if x.dims or positive.dims or negative.dims:
        raise Wrong("E0302", "'semiLinear' takes single values", call.span)
    warn_kink(context, "semiLinear(…)", call.span, x)
    condition = Value(dag.function("ge", x.expr, dag.ZERO), (), "Boolean")
    slope = choose(context, condition, positive, negative, call.span)
    carried = dag.mul(slope.expr, x.expr)
    if not changes(context, x) or not (changes(context, positive) or changes(context, negative)):
        return Value(carried)
    exchanged = context.leaves.slot(None, _EXCHANGE) * (positive.expr - negative.expr)
    still = dag.function("lt", dag.function("abs", x.expr), context.leaves.slot(None, _NOTHING))
    return Value(carried + dag.if_(still, exchanged, dag.ZERO))


@builtin("noEvent")
def _no_event(context: Context, call: tree.Call) -> Value:
    _decides(context, -1)
    return _quietly(context, lambda: arguments(context, call, 1)[0])


@builtin("smooth")
def _smooth_order(context: Context, call: tree.Call) -> Value:
    order = call.arguments[0] if call.arguments else None
    _decides(context, int(order.value) if isinstance(order, tree.Number) else 0)
    return _quietly(context, lambda: arguments(context, call, 2)[1])


def _decides(context: Context, order: int) -> None:
    """Note how smooth the value is of what decides without an event; within another one, that one says it."""
    if context.marked == 0:
        known = context.leaves.smooth
        context.leaves.smooth = order if known is None else min(known, order)


@builtin("getInstanceName")
def _instance_name(context: Context, call: tree.Call) -> Value:
    """The name of the part that this is, from the model on (3.7.4)."""
    arguments(context, call, 0)
    if context.node is None:
        raise Wrong("E0203", "'getInstanceName' has no meaning in a function", call.span)
    if context.node.total:
        raise Wrong("E0230", "'getInstanceName' in an array of parts is not available yet", call.span)
    model = context.model.root.cls.name.rsplit(".", 1)[-1]
    return text(".".join((model, *(name for name, _ in context.node.path))))


@builtin("homotopy")
def _homotopy(context: Context, call: tree.Call) -> Value:
    """``w*actual + (1 - w)*simplified`` with a weight w that is 1 but on the way to the start (3.7.4.4)."""
    given = dict(zip(("actual", "simplified"), call.arguments)) | dict(call.named)
    if "actual" not in given:
        raise Wrong("E0217", "'homotopy' needs an actual expression", call.span)
    actual = context.value(given["actual"])
    if "simplified" not in given:
        return actual
    simplified = _quietly(context, lambda: context.value(given["simplified"]))
    if not changes(context, actual) and not changes(context, simplified):
        return actual
    if simplified is actual or (actual.uniform and simplified.uniform and actual.expr is simplified.expr):
        return actual
    for value, name in ((actual, "actual"), (simplified, "simplified")):
        need_number(value, given[name].span)
    if actual.dims != simplified.dims:
        raise sizes_differ("'actual' and 'simplified'", actual.dims, simplified.dims, call.span)
    variable = context.model.drafts.helpers.of_model(context.model.root, WEIGHT, Role.PARAMETER, "Real")
    weight = context.leaves.slot(variable, 0)
    return context.arrays.map(lambda a, s: weight * a + (dag.ONE - weight) * s, actual, simplified)


def _quietly(context: Context, make: Callable[[], Value]) -> Value:
    context.quiet, context.marked = context.quiet + 1, context.marked + 1
    try:
        return make()
    finally:
        context.quiet, context.marked = context.quiet - 1, context.marked - 1


# -------------------------------------------------------------------------- derivatives


@builtin("der")
def _der(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    need_number(x, call.span)
    if context.node is None:
        raise Wrong("E0301", "'der' is not allowed in a function", call.span)
    return derivative(context, x, call)


def derivative(context: Context, value: Value, call: tree.Call) -> Value:
    """The derivative by time, element by element."""
    if value.items is not None:
        items = tuple(derivative(context, v, call) for v in value.items)
        return Value(None, value.dims, "Real", items)
    columns = {leaf.value[0] for leaf in dag.slots(value.expr)}
    constant = context.leaves.held(columns)
    if value.expr.op == "slot" and constant:
        name = str(call.arguments[0])
        raise Wrong("E0309", f"'{name}' does not change in time: it has no derivative", call.span,
                    hint="der() is meant for variables")  # fmt: skip
    return Value(total_derivative(value.expr, constant), value.dims)


# --------------------------------------------------------------------------- conversions


@builtin("Integer")
def _to_integer(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    if x.type in ("Real", "Boolean", "String"):
        raise Wrong("E0301", "'Integer' takes a literal of an enumeration", call.arguments[0].span, found=x.type,
                    hint="integer(x) rounds down" if x.type == "Real" else "")  # fmt: skip
    return Value(x.expr, x.dims, "Integer", x.items)


@builtin(*LATER)
def _later(context: Context, call: tree.Call) -> Value:
    name = str(call.function)
    raise Wrong("E0230", f"'{name}' is not available yet", call.span, hint=_INSTEAD.get(name, ""))
