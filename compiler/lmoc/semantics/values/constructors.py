"""Arrays written out, ranges, and what an iteration variable goes through (Modelica specification, 10.4, 11.2.2)."""

from __future__ import annotations

from math import prod

import numpy as np

from lmoc.messages.source import Span
from lmoc.semantics.mistakes.wrong import NotAlike, NotOneGroup, Wrong, check_size
from lmoc.semantics.values.context import Context, translates
from lmoc.semantics.values.dimensions import dimension_type
from lmoc.semantics.values.implied_range import implied_length
from lmoc.semantics.values.translate import MAX_UNROLLED, sizes_differ
from lmoc.semantics.values.value import Value, common_type, number, stack
from lmoc.support.sizes import WRITTEN_OUT
from lmoc.syntax import tree


@translates(tree.Array)
def _array(context: Context, e: tree.Array) -> Value:
    if not e.items:
        raise Wrong("E0302", "an array constructor needs at least one element", e.span)
    items = [context.value(item) for item in e.items]
    return join(context, items, [item.span for item in e.items])


def join(context: Context, items: list[Value], spans: list[Span]) -> Value:
    """Values of one size along a new first axis."""
    for item, span in zip(items, spans):
        if item.dims != items[0].dims:
            raise sizes_differ("the elements of an array", items[0].dims, item.dims, span)
        if item.type != items[0].type and {item.type, items[0].type} - {"Real", "Integer"}:
            raise Wrong("E0301", "the elements of an array differ in type", span,
                        expected=items[0].type, found=item.type)  # fmt: skip
    if len(items) > WRITTEN_OUT and all(v.expr is not None and v.expr.is_const and not v.dims for v in items):
        return column_of_numbers(context, np.array([v.expr.value for v in items]), common_type(items))
    return stack(items)


def column_of_numbers(context: Context, numbers: np.ndarray, type_: str) -> Value:
    """A vector of known numbers, alike in all rows, as one uniform value."""
    array = numbers.reshape((1,) * context.space.rank + numbers.shape)
    return Value(context.leaves.slot(None, array), numbers.shape, type_)


@translates(tree.Matrix)
def _matrix(context: Context, e: tree.Matrix) -> Value:
    rows = [[context.value(item) for item in row] for row in e.rows]
    if not any(item.dims for row in rows for item in row):
        joined = [join(context, items, [x.span for x in row]) for items, row in zip(rows, e.rows)]
        return join(context, joined, [row[0].span for row in e.rows])
    rank = max(2, *(len(item.dims) for row in rows for item in row))
    joined = [
        concatenated(context, 1, [_promoted(context, item, rank) for item in items], [x.span for x in row])
        for items, row in zip(rows, e.rows)
    ]
    return concatenated(context, 0, joined, [row[0].span for row in e.rows])


def _promoted(context: Context, value: Value, rank: int) -> Value:
    """The value with further dimensions of length 1 behind its own (10.4.2.1)."""
    if rank == len(value.dims):
        return value
    if value.dims:
        return stack([_promoted(context, item, rank - 1) for item in context.arrays.elements(value)])
    return stack([_promoted(context, value, rank - 1)])


def concatenated(context: Context, axis: int, parts: list[Value], spans: list[Span]) -> Value:
    """Arrays joined along an axis, counted from 0; along the others they are equally long (10.4.2)."""
    first = parts[0]
    for part, span in zip(parts, spans):
        fits = len(part.dims) == len(first.dims) > axis
        if not fits or any(m != n for k, (m, n) in enumerate(zip(part.dims, first.dims)) if k != axis):
            raise sizes_differ("the arrays that are joined", first.dims, part.dims, span)
    if axis == 0:
        items = [(item, span) for part, span in zip(parts, spans) for item in context.arrays.elements(part)]
        return join(context, *map(list, zip(*items))) if items else first
    along = zip(*(context.arrays.elements(part) for part in parts))
    rows = [concatenated(context, axis - 1, list(row), spans) for row in along]
    return stack(rows) if rows else first


@translates(tree.Range)
def _range(context: Context, e: tree.Range) -> Value:
    numbers, type_ = range_numbers(context, e)
    if len(numbers) > WRITTEN_OUT:
        return column_of_numbers(context, numbers, type_)
    return stack([number(x, type_) for x in numbers], type=type_)


def range_numbers(context: Context, e: tree.Range) -> tuple[np.ndarray, str]:
    """The numbers of ``a:b`` or ``a:step:b`` (10.4.3), and their type."""
    ends = [e.start, e.stop] if e.step is None else [e.start, e.stop, e.step]
    values = [context.value(x) for x in ends]
    for value, x in zip(values, ends):
        if value.dims or value.type == "String":
            raise Wrong("E0301", "the ends of a range must be numbers", x.span)
    a, b, *steps = (context.scalar(v, x.span, "a range") for v, x in zip(values, ends))
    step = steps[0] if steps else 1.0
    if step == 0:
        raise Wrong("E0301", "the step of a range must not be zero", e.step.span)
    rounds = np.floor((b - a) / step + 1e-10) if a != b else 0.0
    if not np.isfinite([a, b, step, rounds]).all():
        raise Wrong("E0301", "the ends of a range must be finite", e.span, found=f"{a:g} … {b:g}")
    count = int(rounds) + 1
    check_size(count, "this range", e.span)
    return a + step * np.arange(max(count, 0)), common_type(values)


def iteration(context: Context, index: tree.ForIndex, body: object) -> tuple[np.ndarray, str]:
    """The numbers that an iteration variable goes through; where no range is written, the body tells it."""
    if index.range is None:
        return 1.0 + np.arange(implied_length(context, index, body)), "Integer"
    if isinstance(index.range, tree.Range):
        return range_numbers(context, index.range)
    literals = dimension_type(context, index.range)
    if literals is not None:
        return np.arange(literals.length) + literals.first, literals.name
    value = context.value(index.range)
    if len(value.dims) != 1:
        raise Wrong("E0301", f"'{index.name}' must iterate over a vector", index.range.span)
    return context.alike(value, index.range.span, "a range"), value.type


@translates(tree.Comprehension)
def comprehension(context: Context, e: tree.Comprehension) -> Value:
    """``{element for i in r, j in s}``: the last index is the outermost array (10.4.1.1)."""
    return _comprehend(context, e, len(e.indices) - 1)


def _comprehend(context: Context, e: tree.Comprehension, k: int) -> Value:
    if k < 0:
        return context.value(e.element)
    index = e.indices[k]
    numbers, type_ = iteration(context, index, e.element)
    if len(numbers) > WRITTEN_OUT:
        try:
            return _comprehend_at_once(context, e, k, numbers, type_)
        except NotOneGroup:
            if len(numbers) > MAX_UNROLLED:
                raise
    context.model.rounds.spend(len(numbers), e.span)
    inner = [_comprehend(context.within(context.space, {index.name: number(x, type_)}), e, k - 1) for x in numbers]
    if inner:
        return stack(inner)
    rest = _sizes(context.within(context.space, {index.name: number(0, type_)}), e, k - 1)
    return Value(None, (0, *rest), "Real", ())


def _sizes(context: Context, e: tree.Comprehension, k: int) -> tuple[int, ...]:
    """Return the sizes of the arrays in an array without elements, as far as they are written as further ranges."""
    if k < 0:
        inner = e.element
        return _sizes(context, inner, len(inner.indices) - 1) if isinstance(inner, tree.Comprehension) else ()
    index = e.indices[k]
    numbers, type_ = iteration(context, index, e.element)
    return len(numbers), *_sizes(context.within(context.space, {index.name: number(0, type_)}), e, k - 1)


def _comprehend_at_once(context: Context, e: tree.Comprehension, k: int, numbers: np.ndarray, type_: str) -> Value:
    """All elements as one shape, with the iteration variable as a column of numbers."""
    index = e.indices[k]
    rank = context.space.rank
    leaf = context.leaves.slot(None, numbers.reshape((1,) * rank + numbers.shape))
    space = context.space.with_axis(len(numbers))
    check_size(prod(space.shape), "this array", e.span)
    value = _comprehend(context.within(space, {index.name: Value(leaf, (), type_)}), e, k - 1)
    if not value.uniform:
        raise NotAlike("the form", e.span)
    return Value(value.expr, (len(numbers), *value.dims), value.type)
