"""Records as values: a statement about a whole record applies to each of its fields (Modelica specification, 4.8)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from lmoc.messages.diagnostics import nearest
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Modifier
from lmoc.syntax import tree


def field_of(ref: tree.Ref, name: str) -> tree.Ref:
    """``r.name``."""
    return replace(ref, parts=(*ref.parts, tree.RefPart(name, (), ref.span)))


def record_fields(name: str, cls: Scope, modifier: Modifier) -> Modifier:
    """The value of a record, as values of its fields; what the fields are given themselves goes before."""
    value = modifier.value
    if cls.kind != "record":
        raise Wrong("E0301", f"'{name}' is a part and cannot be given a value", value.span)
    fields = given_fields(cls)
    inside = dict(modifier.inside)
    for field, expression in _field_values(name, cls, fields, value.expression).items():
        own = inside.get(field, Modifier(span=value.span))
        if own.value is None:
            inside[field] = replace(own, value=replace(value, expression=expression, each=()))
    return replace(modifier, value=None, inside=inside)


def given_fields(cls: Scope) -> list[str]:
    """The fields of a record that can be given: its constructor takes these, in this order (12.6.1).

    Left out are final ones and constants with a value: they keep what the class says.
    """
    return [n for n, m in cls.table.items() if isinstance(m, Member) and not _settled(m)]


def _settled(member: Member) -> bool:
    component = member.component
    if component.final:
        return True
    return component.variability == "constant" and member.value[0] is not None


def leaf_fields(cls: Scope, prefix: str = "") -> Iterator[tuple[str, Member, Builtin]]:
    """The fields of a record that are no records themselves, by dotted name, with their types."""
    for name, member in cls.table.items():
        if isinstance(member, Member):
            base = member.scope.type_of(member.component).base
            if isinstance(base, Builtin):
                yield f"{prefix}{name}", member, base
            else:
                yield from leaf_fields(base, f"{prefix}{name}.")


def argument_fields(name: str, cls: Scope, expression: tree.Expression) -> Iterator[tuple[str, tree.Expression]]:
    """A record given as the argument of a function: what each of its fields is given, by dotted name."""
    members = {n: m for n, m in cls.table.items() if isinstance(m, Member)}
    for field, value in _field_values(name, cls, given_fields(cls), expression).items():
        if field not in members:
            raise Wrong("E0217", f"the record '{cls.name}' has no field '{field}'", expression.span,
                        hint=nearest(field, members))  # fmt: skip
        base = members[field].scope.type_of(members[field].component).base
        if isinstance(base, Builtin):
            yield f"{name}.{field}", value
        else:
            yield from argument_fields(f"{name}.{field}", base, value)


def _field_values(name: str, cls: Scope, fields: list[str], expression: tree.Expression) -> dict[str, tree.Expression]:
    if isinstance(expression, tree.Ref):
        return {field: field_of(expression, field) for field in fields}
    if isinstance(expression, tree.Call) and expression.function.parts[-1].name == cls.name:
        if len(expression.arguments) > len(fields):
            raise Wrong("E0217", f"the record '{cls.name}' has {len(fields)} fields", expression.span)
        for field, value in expression.named:
            if field not in fields and isinstance(cls.table.get(field), Member):
                kind = "final" if cls.table[field].component.final else "a constant"
                raise Wrong("E0206", f"'{field}' is {kind} in the record '{cls.name}' and cannot be given",
                            value.span)  # fmt: skip
        return dict(zip(fields, expression.arguments)) | dict(expression.named)
    later = isinstance(expression, tree.Call | tree.If | tree.Array)  # these could give a record
    code = "E0230" if later else "E0301"
    raise Wrong(code, f"'{name}' is a record: its value can be another record, or {cls.name}(…)", expression.span)
