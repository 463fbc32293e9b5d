"""Constants and literals that stand in classes."""

from __future__ import annotations

from lmoc.messages.diagnostics import nearest
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.value import Value, number
from lmoc.syntax import tree


def element_of(found: Scope | Builtin, part: tree.RefPart) -> Member | Scope | Builtin | Value:
    """Return what a part of a name stands for in a class: an element of it, or a literal of an enumeration."""
    enumeration = found if isinstance(found, Builtin) else None
    if isinstance(found, Scope) and found.definition.kind == "type":
        enumeration = resolve(found).base
    if isinstance(enumeration, Builtin):
        if part.name not in enumeration.literals:
            hint = nearest(part.name, enumeration.literals) or f"it has {', '.join(enumeration.literals)}"
            raise Wrong("E0201", f"'{enumeration.name}' has no literal '{part.name}'", part.span, hint=hint)
        return number(enumeration.literals.index(part.name) + 1, enumeration.name)
    inner = found.element(part.name)
    if inner is None:
        raise Wrong("E0201", f"'{found.full_name}' has no element '{part.name}'", part.span,
                    hint=nearest(part.name, found.table))  # fmt: skip
    return inner


def constant_of(context: Context, member: Member, part: tree.RefPart) -> Value:
    """Return the value of a constant of a class."""
    component = member.component
    if component.variability != "constant":
        raise Wrong("E0201", f"'{part.name}' cannot be used from here: only constants of a class can", part.span)
    expression, scope = member.value
    if expression is None:
        if isinstance(member.scope.type_of(component).base, Scope):
            raise Wrong("E0230", f"the constant '{component.name}' is a record that is given field by field",
                        component.span, hint="give it a value with the constructor of the record")  # fmt: skip
        raise Wrong("E0212", f"the constant '{component.name}' has no value", component.span)
    return context.model.known.constant(component, expression, scope)
