"""Modifications as trees, and how they merge: the outermost wins (Modelica specification, 7.2).

A `Modifier` says what is given to one element: a value, and modifiers of what lies inside. Every value keeps the
place it was written at, because there its names are looked up and its array dimensions begin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.messages.diagnostics import Label
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import NOTHING, Binding, Instance, Modifier
from lmoc.syntax import tree


def from_tree(modification: tree.Modification | None, node: Instance | None, scope: Scope) -> Modifier:
    """The modifier that a declaration, an `extends` or a short class definition carries."""
    if modification is None:
        return NOTHING
    value = None
    if modification.value is not None:
        value = Binding(modification.value, node, scope, modification.value.span)
    inside: dict[str, Modifier] = {}
    for argument in modification.arguments:
        name, modifier = _argument(argument, node, scope)
        inside[name] = _beside(name, inside[name], modifier) if name in inside else modifier
    return Modifier(value, inside, span=modification.span)


def _argument(argument: tree.Argument, node: Instance | None, scope: Scope) -> tuple[str, Modifier]:
    if isinstance(argument, tree.Redeclaration):
        element = argument.element
        modification = element.modification if isinstance(element, tree.Component) else None
        modifier = from_tree(modification, node, scope)
        modifier = replace(modifier, final=argument.final, redeclaration=(argument, scope), span=argument.span)
        return element.name, _marked(modifier, argument.each)
    modifier = from_tree(argument.modification, node, scope)
    modifier = _marked(replace(modifier, final=argument.final, span=argument.span), argument.each)
    for name in reversed(argument.name[1:]):
        modifier = _marked(Modifier(inside={name: modifier}, span=argument.span), argument.each)
    return argument.name[0], modifier


def _marked(modifier: Modifier, each: bool) -> Modifier:
    """Note the `each` mark of an argument, or its absence, on all values inside it."""
    value = modifier.value
    if value is not None:
        value = replace(value, each=(*value.each, each))
    inside = {name: _marked(inner, each) for name, inner in modifier.inside.items()}
    return replace(modifier, value=value, inside=inside)


def from_argument(argument: tree.Argument, node: Instance, scope: Scope) -> Modifier:
    """The modifier that one argument of a modification puts on the element it names."""
    return _argument(argument, node, scope)[1]


def _beside(name: str, first: Modifier, second: Modifier) -> Modifier:
    """Two arguments of one modification for the same element: allowed where they give different things."""
    _refuse_twice(name, first, second)
    return merge(first, second)


def _refuse_twice(name: str, first: Modifier, second: Modifier) -> None:
    """``x(k = 1), x.k = 2``"""
    if first.value is not None and second.value is not None:
        first_place = (Label(first.span, "first here"),) if first.span else ()
        raise Wrong("E0221", f"'{name}' is modified twice", second.span, labels=first_place)
    for inner in first.inside.keys() & second.inside.keys():
        _refuse_twice(f"{name}.{inner}", first.inside[inner], second.inside[inner])


def of_class(modifier: Modifier, between: int = 0) -> Modifier:
    """A modifier that belongs to a class (``model S = Spring(k = 2)``): alike in all elements of an array of it.

    `between` counts the array dimensions between the instance in which it is written and the one that has the part.
    """

    def marked(inner: Modifier, depth: int) -> Modifier:
        value = inner.value
        if value is not None:
            each = (*value.each[:depth], True, *value.each[depth + 1 :])
            value = replace(value, each=each, alike=(True,) * between)
        inside = {name: marked(m, depth + 1) for name, m in inner.inside.items()}
        return replace(inner, value=value, inside=inside)

    return replace(modifier, inside={name: marked(inner, 0) for name, inner in modifier.inside.items()})


def merge(outer: Modifier, inner: Modifier, name: str = "") -> Modifier:
    """Merge `outer` over `inner`; a change of something `final` is an error."""
    if inner is NOTHING:
        return outer
    if outer is NOTHING:
        return inner
    if inner.final and (outer.value is not None or outer.inside or outer.redeclaration):
        labels = (Label(inner.span, "final here"),) if inner.span else ()
        what = f"'{name}'" if name else "an element"
        raise Wrong("E0206", f"{what} is final and cannot be modified", outer.span, labels=labels)
    if outer.redeclaration is not None and inner.redeclaration not in (None, outer.redeclaration):
        _require_replaceable(outer.redeclaration[0], inner.redeclaration[0], name)
        return outer  # what a redeclaration gives to its own element is not given to another one (7.3.2)
    inside = dict(inner.inside)
    for key, modifier in outer.inside.items():
        inside[key] = merge(modifier, inside[key], key) if key in inside else modifier
    return Modifier(
        outer.value or inner.value,
        inside,
        outer.final or inner.final,
        outer.redeclaration or inner.redeclaration,
        outer.span or inner.span,
    )


def _require_replaceable(again: tree.Redeclaration, first: tree.Redeclaration, name: str) -> None:
    """What has been redeclared is redeclared again only where that said ``redeclare replaceable`` (7.3)."""
    if not first.element.replaceable:
        labels = (Label(first.span, "redeclared here, without 'replaceable'"),)
        raise Wrong("E0206", f"'{name or first.element.name}' is not replaceable", again.span, labels=labels)


def descend(modifier: Modifier, name: str, dimensions: int) -> Modifier:
    """Return the part of a modifier that applies to element `name` of a component with this many own dimensions.

    Values marked `each` are alike along those dimensions; the others are arrays over them.
    """
    found = modifier.inside.get(name, NOTHING)
    return _extend(found, dimensions, 0) if dimensions and found is not NOTHING else found


def _extend(modifier: Modifier, dimensions: int, depth: int) -> Modifier:
    value = modifier.value
    if value is not None:
        each = depth < len(value.each) and value.each[depth]
        value = replace(value, alike=value.alike + (each,) * dimensions)
    inside = {name: _extend(inner, dimensions, depth + 1) for name, inner in modifier.inside.items()}
    return replace(modifier, value=value, inside=inside)


def given(number: np.ndarray) -> Modifier:
    """The modifier of a number that the caller gave, alike everywhere, or of an array of them."""
    return Modifier(Binding(number, None, None, None))
