"""Assignments to elements of arrays and fields of records, in algorithms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.mistakes.wrong import NotAlike, NotKnownSubscript, Wrong
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.reference import Slice, check_subscripts, subscript
from lmoc.semantics.values.rows import Index
from lmoc.semantics.values.translate import sizes_differ
from lmoc.semantics.values.value import Value, as_real, record, stack
from lmoc.semantics.values.variable_subscripts import replaced_where
from lmoc.syntax import tree


def check_type(name: str, wrong: tuple[str, str] | None, span: Span) -> None:
    """Refuse a value of another type; `wrong` are the types that are expected and found."""
    if wrong is not None:
        raise Wrong("E0301", f"'{name}' is of type {wrong[0]}", span, expected=wrong[0], found=wrong[1])


def with_part(context: Context, old: Value, parts: tuple[tree.RefPart, ...], k: int, value: Value, span: Span) -> Value:
    """Return the value of ``parts[k]`` after ``parts[k][…].parts[k + 1]… := value``."""
    part = parts[k]
    if part.subscripts:
        check_subscripts(part, old)

    def inside(element: Value, new: Value) -> Value:
        return _inside(context, element, parts, k, new, span)

    return replaced(context, old, part.subscripts, value, part.name, span, inside)


def _inside(context: Context, old: Value, parts: tuple[tree.RefPart, ...], k: int, value: Value, span: Span) -> Value:
    """An element of ``parts[k]`` after the assignment: the value itself, or a record with one field changed."""
    if k + 1 == len(parts):
        if old.fields is None and value.fields is None:
            fits = value.type == old.type or (old.type, value.type) == ("Real", "Integer")
            check_type(parts[k].name, None if fits else (old.type, value.type), span)
        elif set(old.fields or ()) != set(value.fields or ()):
            check_type(parts[k].name, (old.type, value.type), span)
        if old.dims != value.dims:
            raise sizes_differ(f"'{parts[k].name}' and what is assigned", old.dims, value.dims, span)
        return as_real(value) if old.type == "Real" else value
    name = parts[k + 1].name
    if old.fields is None or name not in old.fields:
        raise Wrong("E0201", f"'{parts[k].name}' has no element '{name}'", parts[k + 1].span,
                    hint=nearest(name, old.fields or ()))  # fmt: skip
    field = with_part(context, old.fields[name], parts, k + 1, value, span)
    return record({**old.fields, name: field}, old.dims, old.type)


def replaced(
    context: Context,
    array: Value,
    subscripts: tuple[tree.Expression, ...],
    value: Value,
    name: str,
    span: Span,
    inside: Callable[[Value, Value], Value],
) -> Value:
    """Return an array with the elements that subscripts mean replaced by what `inside` makes of them and the value."""
    if not subscripts:
        return inside(array, value)
    items = context.arrays.elements(array)
    try:
        where = subscript(context, subscripts[0], array.dims[0], name)
    except NotKnownSubscript as by:
        new = partial(replaced, context, subscripts=subscripts[1:], value=value, name=name, span=span, inside=inside)
        return stack(replaced_where(context, by, items, span, new), array.dims[1:], array.type)
    if isinstance(where, Slice):
        places = [int(k) for k in where.index.reshape(-1)]
        if not value.dims or value.dims[0] != len(places):
            raise sizes_differ(f"'{name}' and what is assigned", (len(places),), value.dims, span)
        parts = context.arrays.elements(value)
    else:
        places, parts = [_place(where, subscripts[0])], [value]
    for place, part in zip(places, parts, strict=True):
        items[place] = replaced(context, items[place], subscripts[1:], part, name, span, inside)
    return stack(items, array.dims[1:], array.type)


def _place(where: Index, subscript: tree.Expression) -> int:
    """A position that is the same in all rows."""
    if isinstance(where, int):
        return where
    if np.any(where != where.flat[0]):
        raise NotAlike("a subscript", subscript.span)
    return int(where.flat[0])
