"""The subtype relation of classes (Modelica specification, 6.4 and 6.5).

Types are compared by what they consist of, not by their names: every public element of the constraining class must be
there, as the same kind of thing and with a type that is a subtype itself.
"""

from __future__ import annotations

from lmoc.messages.diagnostics import Label
from lmoc.messages.source import Span
from lmoc.semantics.classes.place import Member, Resolved
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.syntax import tree

# kinds of classes that can stand for each other, because both describe parts
_PARTS = {"model", "block", "class"}
_VARIABILITY = ("constant", "parameter", "discrete", "")


def check_subtype(new: Resolved, old: Resolved, place: Span) -> None:
    """Raise `Wrong` where a class cannot stand in the place of another one.

    Parameters
    ----------
    new, old : what is given, and the constraining class
    place : where `new` is named
    """
    reason = _difference(new, old, set())
    if reason is None:
        return
    text, at = reason
    labels = (Label(at, "needed here"),) if at is not None and at.source is not None else ()
    raise Wrong("E0243", f"'{new.name}' cannot replace '{old.name}': {text}", place, labels=labels,
                hint=f"what stands in its place needs all elements of '{old.name}'")  # fmt: skip


def _difference(new: Resolved, old: Resolved, compared: set[tuple[int, int]]) -> tuple[str, Span | None] | None:
    """Return what `new` lacks to be a subtype of `old`; None where it is one."""
    a, b = new.base, old.base
    if isinstance(a, Builtin) or isinstance(b, Builtin):
        same = isinstance(a, Builtin) and isinstance(b, Builtin)
        same = same and (a.literals == b.literals if a.literals or b.literals else a.name == b.name)
        return None if same else (f"{_called(new)} is not {_called(old)}", None)
    if a.definition is b.definition or (id(a.definition), id(b.definition)) in compared:
        return None
    compared.add((id(a.definition), id(b.definition)))
    if a.kind != b.kind and not {a.kind, b.kind} <= _PARTS:
        return f"it is a {a.kind}, not a {b.kind}", b.definition.name_span
    for name, element in b.table.items():
        found = a.table.get(name)
        if isinstance(element, Member) and not element.protected:
            reason = _component(name, found, element, compared)
        elif isinstance(element, Scope) and not element.definition.protected:
            reason = None if isinstance(found, Scope) else (f"it has no class '{name}'", element.definition.name_span)
            reason = reason or _difference(resolve(found), resolve(element), compared)
        else:
            continue
        if reason is not None:
            return reason
    return _arguments(a, b, _given(new)) if b.kind == "function" else None


def _called(resolved: Resolved) -> str:
    return f"'{resolved.name}' ({resolved.base.name})" if resolved.name != resolved.base.name else resolved.name


def _component(
    name: str, found: Member | Scope | None, element: Member, compared: set[tuple[int, int]]
) -> tuple[str, Span | None] | None:
    place = element.component.name_span
    if not isinstance(found, Member) or found.protected:
        return f"it has no {'public ' if isinstance(found, Member) else ''}'{name}'", place
    new, old = found.component, element.component
    if new.flow != old.flow:
        return f"'{name}' is {'' if new.flow else 'not '}a flow", place
    if new.causality != old.causality:
        return f"'{name}' is not declared '{old.causality or new.causality}'", place
    if _VARIABILITY.index(new.variability) > _VARIABILITY.index(old.variability):
        return f"'{name}' is not declared '{old.variability}'", place
    types = found.scope.type_of(new), element.scope.type_of(old)
    if _rank(new, types[0]) != _rank(old, types[1]):
        return f"'{name}' has another number of dimensions", place
    reason = _difference(*types, compared)
    return None if reason is None else (f"'{name}' does not fit: {reason[0]}", reason[1] or place)


def _rank(component: tree.Component, resolved: Resolved) -> int:
    return len(component.dimensions) + sum(len(short.dimensions) for short, _ in resolved.steps)


def _given(function: Resolved) -> set[str]:
    """Return the inputs to which short definitions give a value, as in ``function f = g(p = 3)``."""
    arguments = [a for short, _ in function.steps if short.modification for a in short.modification.arguments]
    values = [a for a in arguments if isinstance(a, tree.ElementModification) and a.modification is not None]
    return {a.name[0] for a in values if len(a.name) == 1 and a.modification.value is not None}


def _arguments(new: Scope, old: Scope, given: set[str]) -> tuple[str, Span | None] | None:
    """Arguments are given by place: the inputs come in the same order, further ones have a value (12.3).

    Parameters
    ----------
    given : inputs of the new one that have a value besides those which its declaration gives
    """
    for role in ("input", "output"):
        own, needed = (_with(scope, role) for scope in (new, old))
        if list(own)[: len(needed)] != list(needed):
            return f"its {role}s do not begin with {', '.join(needed)}", old.definition.name_span
        for name in list(own)[len(needed) :]:
            modification = own[name].modification
            valued = name in given or (modification is not None and modification.value is not None)
            if role == "input" and not valued:
                return f"its further input '{name}' has no value", own[name].name_span
    return None


def _with(scope: Scope, role: str) -> dict[str, tree.Component]:
    members = {n: m.component for n, m in scope.table.items() if isinstance(m, Member)}
    return {n: c for n, c in members.items() if c.causality == role}
