"""Records as values: what is said of a whole record is said of each of its fields (Modelica specification, 4.8)."""

from __future__ import annotations

from dataclasses import replace

from lmoc.semantics.modification import Modifier
from lmoc.semantics.scope import Member, Scope
from lmoc.semantics.wrong import Wrong
from lmoc.syntax import tree


def field_of(ref: tree.Ref, name: str) -> tree.Ref:
    """``r.name``."""
    return replace(ref, parts=(*ref.parts, tree.RefPart(name, (), ref.span)))


def record_fields(name: str, cls: Scope, modifier: Modifier) -> Modifier:
    """The value of a record, as values of its fields; what the fields are given themselves goes before."""
    value = modifier.value
    if cls.kind != "record":
        raise Wrong("E0301", f"'{name}' is a part and cannot be given a value", value.span)
    fields = [n for n, m in cls.table.items() if isinstance(m, Member)]
    inside = dict(modifier.inside)
    for field, expression in _field_values(name, cls, fields, value.expression).items():
        own = inside.get(field, Modifier(span=value.span))
        if own.value is None:
            inside[field] = replace(own, value=replace(value, expression=expression, each=()))
    return replace(modifier, value=None, inside=inside)


def _field_values(name: str, cls: Scope, fields: list[str], expression: tree.Expression) -> dict[str, tree.Expression]:
    if isinstance(expression, tree.Ref):
        return {field: field_of(expression, field) for field in fields}
    if isinstance(expression, tree.Call) and expression.function.parts[-1].name == cls.name:
        if len(expression.arguments) > len(fields):
            raise Wrong("E0217", f"the record '{cls.name}' has {len(fields)} fields", expression.span)
        return dict(zip(fields, expression.arguments)) | dict(expression.named)
    raise Wrong(
        "E0230",
        f"'{name}' is a record: its value can be another record, or {cls.name}(…)",
        expression.span,
    )
