"""The elements of a class: its own, those it inherits, those it redeclares (Modelica specification, chapter 7)."""

from __future__ import annotations

from dataclasses import replace

from lmoc.messages.diagnostics import Label, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.place import Member, Place, Resolved
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.redeclare import constraint_of, merged_component
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.syntax import tree

Table = dict[str, Member | Place]
RESERVED = ("time", "Real", "Integer", "Boolean", "String")  # names with one meaning in all classes (4.8, 3.6.7)
Layer = tuple[dict[str, list[tree.Argument]], Place]  # arguments by the name they modify, and where they are written


def collect(scope: Place) -> Table:
    """Return own and inherited elements by name, in the order of declaration; what is wrong is reported."""
    table: Table = {}
    if scope.definition is None:
        return dict(scope.local)
    clauses = {id(clause): (clause, base) for clause, base in scope.bases}
    for element in (*scope.definition.elements, *scope.clauses):
        if isinstance(element, tree.Component) and not element.redeclare:
            _declare(scope, table, Member(element, scope, (), element.protected))
        elif isinstance(element, tree.Class) and not element.redeclare:
            if scope.local[element.name].definition is element:
                _define(scope, table, scope.local[element.name])
        elif id(element) in clauses:
            _inherit(scope, table, *clauses.pop(id(element)))
    for name, inner in scope.local.items():  # of other files that are `within` this package
        if not inner.definition.redeclare:
            table.setdefault(name, inner)
    _redeclare(scope, table)
    return table


def _inherit(scope: Place, table: Table, clause: tree.Extends, resolved: Resolved) -> None:
    base = resolved.base
    if isinstance(base, Builtin):
        return
    try:
        inherited = base.table
    except Wrong as wrong:
        wrong.put_into(scope.report)
        return
    layers: list[Layer] = [(by_name(clause.modification), scope.parent if scope.definition.short else scope)]
    layers += [(by_name(short.modification), place) for short, place in resolved.steps]
    for name, arguments in layers[0][0].items():
        if name not in inherited:
            message = f"'{base.name}' has no element '{name}' to modify"
            scope.report.error("E0205", message, arguments[0].span, hint=nearest(name, inherited))
    for name, found in inherited.items():
        if isinstance(found, Member):
            outer = tuple((a, place) for arguments, place in layers for a in arguments.get(name, ()))
            protected = found.protected or clause.protected
            _declare(scope, table, replace(found, outer=outer + found.outer, protected=protected))
        else:
            _define(scope, table, _redeclared(scope, found, name, layers))


def _redeclared(scope: Place, found: Place, name: str, layers: list[Layer]) -> Place:
    try:
        for arguments, place in reversed(layers):
            for argument in arguments.get(name, ()):
                found = found.replaced(argument, place)
    except Wrong as wrong:
        wrong.put_into(scope.report)
    return found


def _declare(scope: Place, table: Table, member: Member) -> None:
    name = member.component.name
    if name in RESERVED and member.scope is scope:
        _refuse(scope, name, member.component.name_span)
        return
    old = table.get(name)
    if old is None:
        table[name] = member
        return
    same = isinstance(old, Member) and old.component.span.text == member.component.span.text
    if same and old.component is member.component and not (old.outer and member.outer):
        table[name] = old if old.outer else member  # one base reached by two ways
        return
    if same and old.scope.definition is not member.scope.definition:
        return  # inherited twice, or repeated: allowed where identical (7.1)
    _twice(scope, name, old, member.component.name_span)


def _refuse(scope: Place, name: str, place: Span) -> None:
    scope.report.error("E0110", f"'{name}' has a meaning everywhere and cannot be a name", place)


def _define(scope: Place, table: Table, inner: Place) -> None:
    if inner.name in RESERVED and inner.parent is scope:
        _refuse(scope, inner.name, inner.definition.name_span)
        return
    old = table.get(inner.name)
    same = old is not None and not isinstance(old, Member) and old.definition.span.text == inner.definition.span.text
    if old is None or same and old.definition is inner.definition:
        table[inner.name] = inner
    elif not same:
        _twice(scope, inner.name, old, inner.definition.name_span)


def _twice(scope: Place, name: str, old: Member | Place, place: Span) -> None:
    first, owner = (
        (old.component.name_span, old.scope) if isinstance(old, Member) else (old.definition.name_span, old.parent)
    )
    hint = "" if owner is scope else "to put it in the place of the inherited one write 'redeclare'"
    labels = (Label(first, "first declared here"),)
    message = f"'{name}' is declared twice in '{scope.name}'"
    scope.report.error("E0204", message, place, labels=labels, hint=hint)


# ---------------------------------------------------------------- redeclaration


def _redeclare(scope: Place, table: Table) -> None:
    """Put what this class, or a modification of it, redeclares in the place of what is inherited (7.3)."""
    for element in scope.definition.elements:
        if isinstance(element, tree.Component | tree.Class) and element.redeclare:
            try:
                table[element.name] = _in_place_of(scope, table.get(element.name), element, table)
            except Wrong as wrong:
                wrong.put_into(scope.report)
    for name, (argument, place) in scope.redeclarations.items():
        found = table.get(name)
        if found is not None and not isinstance(found, Member):
            table[name] = _redeclared(scope, found, name, [({name: [argument]}, place)])


def _in_place_of(
    scope: Place, old: Member | Place | None, element: tree.Component | tree.Class, table: Table
) -> Member | Place:
    if old is None or isinstance(old, Member) != isinstance(element, tree.Component):
        raise Wrong("E0205", f"there is no '{element.name}' to redeclare in '{scope.name}'", element.name_span,
                    hint=nearest(element.name, table) or "only inherited elements can be redeclared")  # fmt: skip
    if not isinstance(old, Member):
        made = scope.local[element.name]
        made.take_place_of(old, element.name_span)
        return made
    component = old.component
    if not component.replaceable:
        labels = (Label(component.name_span, "declared here"),)
        raise Wrong("E0206", f"'{element.name}' is not replaceable", element.name_span, labels=labels)
    base, modification = constraint_of(component)
    under = [
        (argument.modification, place)
        for argument, place in old.outer
        if isinstance(argument, tree.ElementModification) and argument.modification is not None
    ]
    under += [(modification, old.scope)] if modification else []
    new = merged_component(component, element)
    return Member(new, scope, (), old.protected, (*under, *old.under), old.constraint or (base, old.scope))


def by_name(modification: tree.Modification | None) -> dict[str, list]:
    """The arguments of a modification by the first name of what they modify."""
    result: dict[str, list] = {}
    for argument in modification.arguments if modification else ():
        name = argument.name[0] if isinstance(argument, tree.ElementModification) else argument.element.name
        result.setdefault(name, []).append(argument)
    return result
