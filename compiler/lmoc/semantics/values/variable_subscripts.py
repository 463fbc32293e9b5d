"""Names in expressions; those with a subscript that changes while it runs are a choice among elements.

``x[i]`` is what ``if i == 1 then x[1] elseif i == 2 then x[2] …`` is. There is no element for another number: the value
is none (NaN), which the run reports where it matters, and not in a branch that is not taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial, reduce

import numpy as np

from lmoc.expression import dag
from lmoc.messages.source import Span
from lmoc.semantics.mistakes.wrong import NotKnownSubscript
from lmoc.semantics.values.context import Context, translates
from lmoc.semantics.values.reference import reference
from lmoc.semantics.values.translate import choose
from lmoc.semantics.values.value import Value, number, stack
from lmoc.syntax import tree


@translates(tree.Ref)
def name(context: Context, ref: tree.Ref) -> Value:
    """The value of a name."""
    try:
        return reference(context, ref)
    except NotKnownSubscript as subscript:
        if not any(s is subscript.expression for part in ref.parts for s in part.subscripts):
            raise  # one in a subscript of this one
        return _choice(context, ref, subscript)


def _choice(context: Context, ref: tree.Ref, subscript: NotKnownSubscript) -> Value:
    """Choose among the elements by the value of the subscript."""
    by = subscript.expression
    result: Value | None = None
    for k in range(subscript.length, 0, -1):
        value = context.value(_with_number(ref, by, k))
        if result is None:
            result = _nothing(value.dims, value.type)
        result = choose(context, _is(context, by, k, subscript.length), value, result, ref.span)
    if result is None:
        raise subscript
    return result


def replaced_where(
    context: Context, subscript: NotKnownSubscript, items: list[Value], span: Span, new: Callable[[Value], Value]
) -> list[Value]:
    """Return the elements of an array, of which the one that the value of a subscript means is replaced.

    Beyond the ends nothing is replaced, and nothing has a value any more, as an element that is read there has none.
    """
    by, found = subscript.expression, []
    here = [_is(context, by, k + 1, len(items)) for k in range(len(items))]
    inside = Value(reduce(partial(dag.function, "or"), (one.expr for one in here)), (), "Boolean") if here else None
    for item, chosen in zip(items, here, strict=True):
        kept = choose(context, inside, item, _nothing(item.dims, item.type), span)
        found.append(choose(context, chosen, new(item), kept, span))
    return found


def _is(context: Context, subscript: tree.Expression, k: int, length: int) -> Value:
    """Return whether a subscript has a value."""
    before, context.end = context.end, length
    try:
        return context.value(tree.Binary("==", subscript, tree.Number(float(k), True, subscript.span), subscript.span))
    finally:
        context.end = before


def _with_number(ref: tree.Ref, subscript: tree.Expression, k: int) -> tree.Ref:
    """Return a reference with a number in place of one subscript."""
    place = tree.Number(float(k), True, subscript.span)
    parts = [replace(p, subscripts=tuple(place if s is subscript else s for s in p.subscripts)) for p in ref.parts]
    return replace(ref, parts=tuple(parts))


def _nothing(dims: tuple[int, ...], type_: str) -> Value:
    """Return no value, of a size and type."""
    if not dims:
        return number(np.nan, type_)
    return stack([_nothing(dims[1:], type_) for _ in range(dims[0])], dims[1:], type_)
