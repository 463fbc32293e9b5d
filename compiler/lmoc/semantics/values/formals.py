"""What a function or the constructor of a record declares: types, sizes, values without an argument (12)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from lmoc.semantics.classes.place import Member, Place
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong, check_size
from lmoc.semantics.nodes.records import given_fields
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.dimensions import length
from lmoc.semantics.values.value import Value, as_real, number, record, stack
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk


@dataclass(frozen=True)
class LocalVariable:
    """A declared variable of a function.

    Attributes
    ----------
    type : name of its type
    role : input, output, "" for a local one
    record : its class where it is a record
    unit : as declared, of itself or by its type; "" where there is none
    dimensions : its sizes, its own and those of its type, each with the class in which that is written
    """

    member: Member | None
    type: str
    role: str
    record: Scope | None = None
    dimensions: tuple[tuple[tree.Expression, Place], ...] = ()
    unit: str = ""

    @property
    def open_size(self) -> bool:
        """Return whether a dimension is left to its value."""
        return any(isinstance(d, tree.Colon) for d, _ in self.dimensions)


def declared_in(function: Scope) -> dict[str, LocalVariable]:
    """Return the variables of a function; those of a record are inputs of its constructor as far as they are given."""
    found = function.made.get("declared")
    if found is None:
        found = function.made["declared"] = _declared_in(function)
    return found


def _declared_in(function: Scope) -> dict[str, LocalVariable]:
    given = given_fields(function) if resolve(function).base.kind == "record" else None
    found = {}
    for name, member in function.table.items():
        if isinstance(member, Member):
            role = member.component.causality if given is None else "input" if name in given else ""
            found[name] = _variable(member, role)
    return found


def _variable(member: Member, role: str) -> LocalVariable:
    component = member.component
    resolved = member.scope.type_of(component)
    dimensions = [(d, member.scope) for d in component.dimensions]
    dimensions += [(d, where) for short, where in resolved.steps for d in short.dimensions]
    if isinstance(resolved.base, Builtin):
        given = (component.modification, *(short.modification for short, _ in resolved.steps))
        unit = next((text for modification in given for text in _units(modification)), "")
        return LocalVariable(member, resolved.base.name, role, None, tuple(dimensions), unit)
    if resolved.base.kind != "record":
        raise Wrong("E0230", "functions take numbers, records and arrays of these so far", component.span,
                    found=f"a {resolved.base.kind}")  # fmt: skip
    return LocalVariable(member, resolved.name, role, resolved.base, tuple(dimensions))


def _units(modification: tree.Modification | None) -> Iterator[str]:
    for a in modification.arguments if modification else ():
        if isinstance(a, tree.ElementModification) and ".".join(a.name) == "unit" and a.modification:
            if isinstance(a.modification.value, tree.String):
                yield a.modification.value.value


def sizes(context: Context, variable: LocalVariable, function: Scope) -> tuple[int | None, ...]:
    """Return the declared size along each dimension; None where it is left open.

    Parameters
    ----------
    context : of the function's body, whose variables the sizes may use
    """
    what = f"the size of '{variable.member.component.name}'"
    found: list[int | None] = []
    for size, where in variable.dimensions:
        inside = context if function.is_made_of(where) else context.inside_function(where, {})
        found.append(None if isinstance(size, tree.Colon) else length(inside, size, what))
    return tuple(found)


def nothing(context: Context, variable: LocalVariable, function: Scope) -> Value | None:
    """Return the value of a variable that has not been assigned: NaN, which is found where it is used.

    Fields of a record with a value in the class have that one. None for a scalar.
    """
    component = variable.member.component
    dims = tuple(n for n in sizes(context, variable, function) if n is not None)
    check_size(math.prod(dims), f"'{component.name}'", component.span)
    if variable.record is not None:
        value = fields_as_declared(context, variable.record, component.modification, variable.member.scope)
    elif variable.dimensions:
        value = number(math.nan, variable.type)
    else:
        return None
    for size in reversed(dims):
        value = stack([value] * size, value.dims, value.type)
    return value


def fields_as_declared(
    context: Context, cls: Scope, modification: tree.Modification | None, where: Place
) -> Value:
    """Return a record with the values that its class and a modification, written in `where`, give to its fields."""
    declared = declared_in(cls)
    values: dict[str, Value] = {}
    inside = context.inside_function(cls, values)
    given = {
        a.name[0]: a.modification.value
        for a in (modification.arguments if modification else ())
        if isinstance(a, tree.ElementModification) and a.modification and len(a.name) == 1
    }
    for name in in_order_of_use(cls):
        if given.get(name) is not None:
            values[name] = context.inside_function(where, {}).value(given[name])
            continue
        expression, scope = declared[name].member.value
        place = inside if cls.is_made_of(scope) else context.inside_function(scope, {})
        value = place.value(expression) if expression is not None else nothing(inside, declared[name], cls)
        values[name] = number(math.nan, declared[name].type) if value is None else value
    return record({name: values[name] for name in declared}, (), cls.name)


def has_gap(value: Value) -> bool:
    """Return whether an element of an array, or a field, has never been assigned."""
    inside: tuple[Value, ...] = (*(value.items or ()), *(value.fields or {}).values())
    if inside or value.items is not None or value.fields is not None:
        return any(map(has_gap, inside))
    return value.expr is not None and value.expr.is_const and math.isnan(value.expr.value)


def mismatch(variable: LocalVariable, value: Value) -> tuple[str, str] | None:
    """Return what type a variable must have and which one a value has; None where they fit.

    Records fit by their fields (6.4).
    """
    if variable.record is None:
        types = variable.type, value.type
        fits = value.fields is None and (types[0] == types[1] or types == ("Real", "Integer"))
        return None if fits else types
    if value.fields is None:
        return variable.type, value.type
    for name, field in declared_in(variable.record).items():
        inner = value.fields.get(name)
        if inner is None:
            return f"{variable.type} with a field '{name}'", value.type
        wrong = mismatch(field, inner)
        if wrong is not None:
            return f"{variable.type}, whose field '{name}' is {wrong[0]}", f"{value.type}, whose field is {wrong[1]}"
    return None


def widened(variable: LocalVariable, value: Value) -> Value:
    """Return a value that fits a variable with the variable's own type: Integers become Real where that is Real."""
    if variable.record is None:
        return as_real(value) if variable.type == "Real" else value
    own = {name: widened(field, value.fields[name]) for name, field in declared_in(variable.record).items()}
    return record(own, value.dims, value.type)


def in_order_of_use(function: Scope) -> list[str]:
    """Return the variables of a function so that each comes after those that its declaration uses (12.4.4).

    Raises
    ------
    Wrong
        E0207 where the declarations use each other in a circle.
    """
    order = function.made.get("order")
    if order is None:
        order = function.made["order"] = _in_order_of_use(function, declared_in(function))
    return order


def _in_order_of_use(function: Scope, declared: dict[str, LocalVariable]) -> list[str]:
    order: list[str] = []
    path: list[str] = []

    def visit(name: str) -> None:
        if name in order:
            return
        variable = declared[name]
        if name in path:
            cycle = [*path[path.index(name) :], name]
            raise Wrong("E0207", f"the value of '{name}' depends on itself", variable.member.component.span,
                        found=" → ".join(cycle))  # fmt: skip
        path.append(name)
        for used in _used(function, variable):
            if used in declared:
                visit(used)
        order.append(path.pop())

    for name in declared:
        visit(name)
    return order


def _used(function: Scope, variable: LocalVariable) -> Iterator[str]:
    """The names in the declaration of a variable; not itself in a size, as in ``input Real A[:, size(A, 1)]``."""
    component = variable.member.component
    value, scope = variable.member.value
    own = scope.definition is not None and function.is_made_of(scope)
    own_sizes = list(walk(component.dimensions))
    for used in walk((*component.dimensions, *((value,) if own and value else ()))):
        if isinstance(used, tree.Ref):
            name = used.parts[0].name
            if not (name == component.name and variable.role == "input" and used in own_sizes):
                yield name
