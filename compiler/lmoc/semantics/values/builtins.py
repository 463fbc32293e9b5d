"""The predefined functions (Modelica specification, 3.7 and 10.3)."""

from __future__ import annotations

from collections.abc import Callable
from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.expression.calculus import total_derivative
from lmoc.expression.functions import FUNCTIONS, SMOOTH, Kind
from lmoc.ir.flat import Kind as Role
from lmoc.semantics.mistakes.wrong import OutOfRange, Wrong, check_size
from lmoc.semantics.nodes.instance import InstanceNode
from lmoc.semantics.values.constructors import column_of_numbers, comprehension, concatenated
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.helpers import WEIGHT
from lmoc.semantics.values.reference import find_start, locate
from lmoc.semantics.values.translate import (
    at_event,
    changes,
    choose,
    matrix_product,
    need_number,
    sizes_differ,
    warn_kink,
)
from lmoc.semantics.values.value import Value, common_type, number, stack, text
from lmoc.support.sizes import WRITTEN_OUT
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
        if value.type in ("String", "Boolean") or value.type != values[0].type:
            need_number(value, place.span)
            need_number(values[0], call.arguments[0].span)
        if isinstance(place, tree.Comprehension) and len(value.dims) > len(place.indices):
            raise Wrong("E0302", f"'{name}' takes single values", place.span, found="an array")
    warn_kink(context, f"{name}(…)", call.span, *values)
    if len(values) == 2:
        x, y = values
        if x.dims or y.dims:
            raise Wrong("E0302", f"'{name}' of two arguments takes single values", call.span)
        return Value(dag.function(name, x.expr, y.expr), (), common_type(values))
    scalars = context.arrays.scalars(values[0])
    if not scalars:
        raise Wrong("E0302", f"'{name}' of an empty array", call.span)
    result = scalars[0].expr
    for item in scalars[1:]:
        result = dag.function(name, result, item.expr)
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


# --------------------------------------------------------------------------------- sizes


@builtin("size")
def _size(context: Context, call: tree.Call) -> Value:
    if call.named or not 1 <= len(call.arguments) <= 2:
        raise Wrong("E0217", "'size' takes an array and perhaps an axis", call.span)
    open_size = _size_in_the_making(context, call)
    if open_size is not None:
        return number(open_size, "Integer")
    dims = _dims(context, call.arguments[0])
    if len(call.arguments) == 1:
        return stack([number(n, "Integer") for n in dims], type="Integer")
    k = context.whole(context.value(call.arguments[1]), call.arguments[1].span, "an axis", 1)
    if k > len(dims):
        raise OutOfRange("E0215", f"there is no axis {k}", call.arguments[1].span, expected=f"1 … {len(dims)}")
    return number(dims[k - 1], "Integer")


def _size_in_the_making(context: Context, call: tree.Call) -> int | None:
    """``size(A, 1)`` in the declaration of A itself; None elsewhere."""
    e = call.arguments[0]
    plain = isinstance(e, tree.Ref) and len(e.parts) == 1 and not e.absolute and not e.parts[0].subscripts
    if not plain or len(call.arguments) < 2 or context.node is None or e.parts[0].name in context.names:
        return None
    axis = call.arguments[1]
    if not context.model.in_the_making(context.node, e.parts[0].name):
        return None
    k = context.whole(context.value(axis), axis.span, "an axis", 1)
    return context.model.open_size(context.node, e.parts[0].name, k - 1)


def _dims(context: Context, e: tree.Expression) -> tuple[int, ...]:
    """The dimensions of a value, or of an array of parts."""
    if isinstance(e, tree.Ref) and e.parts[0].name not in context.names:
        start = find_start(context, e)
        if isinstance(start, InstanceNode):
            return locate(context, e, start).dims
    return context.value(e).dims


@builtin("ndims")
def _ndims(context: Context, call: tree.Call) -> Value:
    if len(call.arguments) != 1:
        raise Wrong("E0217", "'ndims' takes one array", call.span)
    return number(len(_dims(context, call.arguments[0])), "Integer")


@builtin("scalar")
def _scalar(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    if prod(x.dims) != 1:
        raise sizes_differ("the argument of 'scalar'", (1,), x.dims, call.span)
    return context.arrays.scalars(x)[0]


@builtin("vector")
def _vector(context: Context, call: tree.Call) -> Value:
    """The elements of an array that is longer than 1 in one direction at most (10.3.2)."""
    (x,) = arguments(context, call, 1)
    if sum(n > 1 for n in x.dims) > 1:
        raise sizes_differ("the argument of 'vector'", (prod(x.dims), 1), x.dims, call.span)
    return x if len(x.dims) == 1 else stack(context.arrays.scalars(x))


@builtin("matrix")
def _matrix(context: Context, call: tree.Call) -> Value:
    """An array with two dimensions: those beyond the second one have the length 1 (10.3.2)."""
    (x,) = arguments(context, call, 1)
    if any(n != 1 for n in x.dims[2:]):
        raise sizes_differ("the argument of 'matrix'", (*x.dims[:2], 1), x.dims, call.span)
    if not x.dims:
        return stack([stack([x])])
    if len(x.dims) == 1:
        return stack([stack([item]) for item in context.arrays.elements(x)])
    rows = [context.arrays.elements(row) for row in context.arrays.elements(x)]
    return stack([stack([context.arrays.scalars(item)[0] for item in row]) for row in rows])


@builtin("symmetric")
def _symmetric(context: Context, call: tree.Call) -> Value:
    """A matrix whose upper triangle is repeated below (10.3.5)."""
    (x,) = numbers(context, call, 1)
    if len(x.dims) != 2 or x.dims[0] != x.dims[1]:
        raise Wrong("E0302", "'symmetric' takes a square matrix", call.span)
    rows = [context.arrays.elements(row) for row in context.arrays.elements(x)]
    return stack([stack([rows[min(i, j)][max(i, j)] for j in range(len(rows))]) for i in range(len(rows))])


@builtin("skew")
def _skew(context: Context, call: tree.Call) -> Value:
    """The matrix S with ``S*y = cross(x, y)`` (10.3.5)."""
    (x,) = numbers(context, call, 1)
    if x.dims != (3,):
        raise sizes_differ("the argument of 'skew'", (3,), x.dims, call.span)
    a, b, c = (s.expr for s in context.arrays.scalars(x))
    zero = dag.ZERO
    rows = ((zero, dag.neg(c), b), (c, zero, dag.neg(a)), (dag.neg(b), a, zero))
    return stack([stack([Value(e) for e in row]) for row in rows])


@builtin("transpose")
def _transpose(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    if len(x.dims) != 2:
        raise Wrong("E0302", "'transpose' takes a matrix", call.span)
    return context.arrays.transpose(x)


# ---------------------------------------------------------------------------- reductions


def _reduced(context: Context, call: tree.Call) -> tuple[Value, int]:
    """The array in ``sum(array)``, ``sum(e for i in r)`` and the same for products; how many of its axes are e's."""
    own = 0
    if len(call.arguments) == 1 and isinstance(call.arguments[0], tree.Comprehension):
        array = comprehension(context, call.arguments[0])
        own = len(array.dims) - len(call.arguments[0].indices)
    else:
        (array,) = arguments(context, call, 1)
    need_number(array, call.span)
    return array, own


@builtin("sum")
def _sum(context: Context, call: tree.Call) -> Value:
    array, own = _reduced(context, call)
    if own > 0:
        return _sum_of_arrays(context, array, own)
    if changes(context, array) and context.model.long_sums.fits(context, array):
        return context.model.long_sums.add(context, array, call.span)
    return Value(context.arrays.fold(dag.add, array, dag.ZERO), (), array.type)


def _sum_of_arrays(context: Context, array: Value, own: int) -> Value:
    """The sum over the first axes of an array, element by element of the last ones."""
    while len(array.dims) > own:
        items = context.arrays.elements(array)
        if not items:
            return _filled(number(0, array.type), list(array.dims[-own:]))
        total = items[0]
        for item in items[1:]:
            total = context.arrays.map(dag.add, total, item, type=array.type)
        array = total
    return array


@builtin("product")
def _product(context: Context, call: tree.Call) -> Value:
    array, own = _reduced(context, call)
    if own > 0:
        raise Wrong("E0302", "'product' takes single values", call.span, found="an array")
    return Value(context.arrays.fold(dag.mul, array, dag.ONE), (), array.type)


# -------------------------------------------------------------------------- constructors


def _size_of_array(context: Context, value: Value, place: tree.Expression, axes: int = 1) -> int:
    n = context.whole(value, place.span, "a size")
    check_size(n**axes, "this array", place.span)
    return n


def _filled(value: Value, dims: list[int]) -> Value:
    if value.uniform and not value.dims and value.type != "String":
        return Value(value.expr, tuple(dims), value.type)
    for n in reversed(dims):
        value = stack([value] * n, value.dims, value.type)
    return value


@builtin("zeros", "ones")
def _constant_array(context: Context, call: tree.Call) -> Value:
    sizes = arguments(context, call, 1, 9)
    dims = [_size_of_array(context, v, e) for v, e in zip(sizes, call.arguments)]
    check_size(prod(dims), "this array", call.span)
    return _filled(number(call.function.parts[0].name == "ones", "Integer"), dims)


@builtin("fill")
def _fill(context: Context, call: tree.Call) -> Value:
    value, *sizes = arguments(context, call, 2, 9)
    dims = [_size_of_array(context, v, e) for v, e in zip(sizes, call.arguments[1:])]
    check_size(prod(dims), "this array", call.span)
    return _filled(value, dims)


@builtin("linspace")
def _linspace(context: Context, call: tree.Call) -> Value:
    a, b, count = numbers(context, call, 3)
    n = _size_of_array(context, count, call.arguments[2])
    if n < 2:
        raise Wrong("E0301", "'linspace' needs at least 2 points", call.arguments[2].span, found=str(n))
    steps = np.arange(n) / (n - 1)
    if n > WRITTEN_OUT:
        weight = column_of_numbers(context, steps, "Real")
    else:
        weight = stack([number(w) for w in steps])
    return context.arrays.map(lambda x, y, w: dag.add(x, dag.mul(dag.sub(y, x), w)), a, b, weight)


@builtin("identity")
def _identity(context: Context, call: tree.Call) -> Value:
    (size,) = arguments(context, call, 1)
    n = _size_of_array(context, size, call.arguments[0], 2)
    return stack([stack([number(i == j, "Integer") for j in range(n)]) for i in range(n)])


@builtin("diagonal")
def _diagonal(context: Context, call: tree.Call) -> Value:
    (x,) = numbers(context, call, 1)
    items = context.arrays.scalars(x)
    zero = number(0)
    return stack([stack([v if i == j else zero for j in range(len(items))]) for i, v in enumerate(items)])


@builtin("cross")
def _cross(context: Context, call: tree.Call) -> Value:
    x, y = numbers(context, call, 2)
    if x.dims != (3,) or y.dims != (3,):
        raise sizes_differ("the arguments of 'cross'", x.dims, y.dims, call.span)
    a, b = ([s.expr for s in context.arrays.scalars(v)] for v in (x, y))
    return stack([Value(a[i] * b[j] - a[j] * b[i]) for i, j in ((1, 2), (2, 0), (0, 1))])


@builtin("outerProduct")
def _outer_product(context: Context, call: tree.Call) -> Value:
    x, y = numbers(context, call, 2)
    if len(x.dims) != 1 or len(y.dims) != 1:
        raise Wrong("E0302", "'outerProduct' takes two vectors", call.span)
    column = stack([stack([v]) for v in context.arrays.scalars(x)])
    return matrix_product(context, column, stack([y]), call.span)


@builtin("cat")
def _cat(context: Context, call: tree.Call) -> Value:
    axis, *parts = arguments(context, call, 2, 99)
    along = context.whole(axis, call.arguments[0].span, "an axis", 1)
    for part, place in zip(parts, call.arguments[1:]):
        if not part.dims:
            raise Wrong("E0302", "'cat' joins arrays", place.span, expected="an array", found="a scalar")
        if along > len(part.dims):
            raise OutOfRange("E0215", f"there is no axis {along}", place.span, expected=f"1 … {len(part.dims)}")
    return concatenated(context, along - 1, parts, [place.span for place in call.arguments[1:]])


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
