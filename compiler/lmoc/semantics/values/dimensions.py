"""Sizes of dimensions: a number, or a type whose values count along one (Modelica specification, 10.5)."""

from __future__ import annotations

from typing import NamedTuple

from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.context import Context
from lmoc.syntax import tree


class DimensionType(NamedTuple):
    """A type whose values count along a dimension: an enumeration, or Boolean (10.5).

    `first` is the number of its first value.
    """

    name: str
    length: int
    first: int


def dimension_type(context: Context, expression: tree.Expression) -> DimensionType | None:
    """Return the enumeration, or Boolean, that an expression names; None where it is a value."""
    if not isinstance(expression, tree.Ref) or not expression.absolute and expression.parts[0].name in context.names:
        return None
    return type_of_dimension(context.scope, expression)


def type_of_dimension(scope: Scope, expression: tree.Expression) -> DimensionType | None:
    """As `dimension_type`, in a declaration of a class."""
    if not isinstance(expression, tree.Ref) or any(part.subscripts for part in expression.parts):
        return None
    try:
        found = scope.meaning(expression)
        base = None if isinstance(found, Member) else resolve(found).base
    except Wrong:
        return None  # no class: it is said where its value is needed
    if not isinstance(base, Builtin) or not base.literals and base.name != "Boolean":
        return None
    return DimensionType(base.name, len(base.literals) or 2, 1 if base.literals else 0)


def length(context: Context, size: tree.Expression, what: str) -> int:
    """Return the number of elements along a dimension that is declared with this size."""
    literals = dimension_type(context, size)
    return literals.length if literals else context.whole(context.value(size), size.span, what)
