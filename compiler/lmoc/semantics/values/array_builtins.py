"""The predefined functions of arrays: sizes, shapes, sums, constructors (Modelica specification, 10.3)."""

from __future__ import annotations

from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.semantics.mistakes.wrong import OutOfRange, Wrong, check_size
from lmoc.semantics.nodes.instance import InstanceNode
from lmoc.semantics.values.builtins import arguments, builtin, numbers
from lmoc.semantics.values.constructors import column_of_numbers, comprehension, concatenated, join
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.reference import find_start, locate
from lmoc.semantics.values.translate import changes, matrix_product, need_number, sizes_differ
from lmoc.semantics.values.value import Value, number, stack
from lmoc.support.sizes import WRITTEN_OUT
from lmoc.syntax import tree

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


@builtin("array")
def _array(context: Context, call: tree.Call) -> Value:
    """``array(a, b, …)`` is ``{a, b, …}`` (10.4)."""
    items = arguments(context, call, 1, max(1, len(call.arguments)))
    return join(context, items, [place.span for place in call.arguments])


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
