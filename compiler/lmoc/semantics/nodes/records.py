"""Records as values: a statement about a whole record applies to each of its fields (Modelica specification, 4.8)."""

from __future__ import annotations

from dataclasses import replace

from lmoc.semantics.classes.place import Member
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
    if isinstance(expression, tree.Number | tree.String | tree.Boolean):
        raise Wrong("E0301", f"'{name}' is a record: its value can be another record, or {cls.name}(…)",
                    expression.span)  # fmt: skip
    return {field: tree.Field(expression, field, expression.span) for field in fields}
