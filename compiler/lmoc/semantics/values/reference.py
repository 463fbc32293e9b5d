"""Resolution of names in expressions to index arrays (Modelica specification, chapter 5 and 10.5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import TIME
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.hints import visible
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import ENUMERATIONS, Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import NoElement, NotAlike, NotKnown, NotKnownSubscript, NotThere, OutOfRange, Wrong
from lmoc.semantics.nodes.instance import Absent, Broken, Instance, InstanceNode, Variable
from lmoc.semantics.values.constants import constant_of, element_of
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.dimensions import type_of_dimension
from lmoc.semantics.values.rows import Index, align, positions
from lmoc.semantics.values.value import Value, record, stack
from lmoc.support.records import dataclass
from lmoc.syntax import tree


@dataclass(frozen=True, eq=False, slots=True)
class Slice:
    """A subscript that keeps an axis: positions from 0, their own axis last."""

    index: np.ndarray

    @property
    def length(self) -> int:
        return self.index.shape[-1]


@dataclass(frozen=True, eq=False)
class Located:
    """A node and which of its elements.

    Attributes
    ----------
    axes : for each of the node's total dimensions, where along it
    shared : how many of them, the first ones, are those of the part around the expression
    implicit : no subscripts: all that the rows have of it
    """

    node: InstanceNode
    axes: tuple[Index | Slice, ...]
    shared: int
    implicit: bool

    @property
    def dims(self) -> tuple[int, ...]:
        return tuple(a.length for a in self.axes if isinstance(a, Slice))


def reference(context: Context, ref: tree.Ref) -> Value:
    """The value of a name."""
    first = ref.parts[0]
    if not ref.absolute:
        name = ".".join(part.name for part in ref.parts)
        value = context.names.get(name)  # dotted: the field of a record
        last = ref.parts[-1]
        if value is not None and name in context.assigned:
            last = replace(last, subscripts=all_subscripts(context, ref))
            return subscripted(context, value, last) if last.subscripts else value
        if value is not None and not any(part.subscripts for part in ref.parts[:-1]):
            return subscripted(context, value, last) if last.subscripts else value
        if first.name in context.names and first.name not in context.assigned:
            return _field_of_value(context, ref)
    start = find_start(context, ref)
    if isinstance(start, InstanceNode):
        value = located_value(context, locate(context, ref, start), ref.span)
        return _as_assigned(context, str(ref), value) if value.fields is not None and context.assigned else value
    if start is None:
        if first.name == "time" and len(ref.parts) == 1:
            return Value(TIME)
        raise unknown_name(context, ref)
    return _constant(context, start, ref)


def _as_assigned(context: Context, name: str, value: Value) -> Value:
    """A record with what an algorithm has assigned to its fields so far."""
    if value.fields is None:
        return context.names[name] if name in context.assigned else value
    fields = {field: _as_assigned(context, f"{name}.{field}", own) for field, own in value.fields.items()}
    return record(fields, value.dims, value.type)


def _field_of_value(context: Context, ref: tree.Ref, k: int = 0, value: Value | None = None) -> Value:
    """``r.a[2].b``, where the parts up to `k` have led to a record, the value of a name or a constant."""
    value = context.names[ref.parts[0].name] if value is None else value
    while True:
        part = ref.parts[k]
        value = subscripted(context, value, part) if part.subscripts else value
        if k + 1 == len(ref.parts):
            return value
        k, part = k + 1, ref.parts[k + 1]
        if value.fields is None or part.name not in value.fields:
            fields = tuple(value.fields or ())
            hint = nearest(part.name, fields) or (f"it has {', '.join(fields)}" if fields else "")
            raise Wrong("E0201", f"'{ref.parts[k - 1].name}' has no element '{part.name}'", part.span, hint=hint)
        value = value.fields[part.name]


def all_subscripts(context: Context, ref: tree.Ref) -> tuple[tree.Expression, ...]:
    """Return a subscript for each dimension of a variable and the parts around it; none where none is written."""
    node = find_start(context, ref)
    if not isinstance(node, InstanceNode) or not any(part.subscripts for part in ref.parts):
        return ()
    found: list[tree.Expression] = []
    for k, part in enumerate(ref.parts):
        node = step(context, node, part) if k else node
        found += part.subscripts or [tree.Colon(part.span) for _ in node.dims]
    return tuple(found)


def unknown_name(context: Context, ref: tree.Ref) -> Wrong:
    """Return the mistake for a reference whose first name is unknown."""
    name = ref.parts[0].name
    candidates = [*context.names, *_variables(context, len(ref.parts) > 1), "time"]
    owner = next((e for e, literals in ENUMERATIONS.items() if name in literals), "")
    hint = "the time is called 'time'" if name == "t" else nearest(name, candidates)
    plain = name.strip("'")  # the quotes around a name with other characters belong to it
    if plain != name:
        hint = f'a string is written in double quotes: "{plain}"'
    if owner and not hint:
        hint = f"the literal is written '{owner}.{name}'"
    if name == "pi" or [part.name for part in ref.parts] == ["Modelica", "Constants", "pi"]:
        hint = "declare it: constant Real pi = 3.14159265358979;"
    return Wrong("E0201", f"there is no variable '{plain}' here", ref.parts[0].span, hint=hint)


def _variables(context: Context, classes: bool) -> Iterator[str]:
    """Names that can be seen and stand for variables or parts; for classes too, where a name inside is meant."""
    for name in dict.fromkeys(visible(context.scope)):
        if classes or isinstance(context.scope.find(name), Member):
            yield name


def find_start(context: Context, ref: tree.Ref) -> InstanceNode | Member | Scope | Builtin | None:
    """Return the meaning of the first name of a reference: a node of the instance tree, a package constant, a class."""
    name = ref.parts[0].name
    if context.node is not None and not ref.absolute and isinstance(context.scope.table.get(name), Member):
        return context.model.child(context.node, name)
    return (context.scope.root if ref.absolute else context.scope).find(name)


def named_node(context: Context, ref: tree.Ref) -> InstanceNode | None:
    """The variable, record or part that a reference names, subscripts apart; None where there is none."""
    node = find_start(context, ref)
    if not isinstance(node, InstanceNode):
        return None
    try:
        for part in ref.parts[1:]:
            node = step(context, node, part)
    except Wrong:
        return None  # which is reported where the reference is used
    return node


def named_variables(context: Context, ref: tree.Ref) -> list[Variable]:
    """The variable that a reference names, or those of the record; none where there are none."""
    node = named_node(context, ref)
    if isinstance(node, Instance) and node.kind == "record":
        return node.variables()
    return [node] if isinstance(node, Variable) else []


# ------------------------------------------------------------------- in the instance tree


def locate(context: Context, ref: tree.Ref, start: InstanceNode) -> Located:
    """Walk a dotted name down the instance tree, evaluating the subscripts."""
    node = start
    shared = len(start.total) - len(start.dims)
    axes: list[Index | Slice] = list(context.space.coordinates[:shared])
    implicit = True
    for k, part in enumerate(ref.parts):
        if k:
            node = step(context, node, part)
        _require_present(node, part)
        if part.subscripts:
            implicit = False
            axes += _subscripts(context, node, part)
        else:
            axes += [Slice(positions((n,))) for n in node.dims]
    return Located(node, tuple(axes), shared, implicit)


def step(context: Context, node: InstanceNode, part: tree.RefPart) -> InstanceNode:
    """The element of a node that a further part of a reference names."""
    if not isinstance(node, Instance):
        message = f"'{node.name}' is a variable and has no element '{part.name}'"
        raise NoElement("E0201", message, part.span, "", guessed=False)
    found = node.cls.table.get(part.name)
    if not isinstance(found, Member) and node.expandable and part.name in node.children:
        return node.children[part.name]
    if not isinstance(found, Member):
        members = [n for n, m in node.cls.table.items() if isinstance(m, Member) and not m.protected]
        near = nearest(part.name, members)
        hint = near or (f"it has {', '.join(members[:8])}" if members else "")
        message = f"'{node.name}' ({node.cls.name}) has no element '{part.name}'"
        raise NoElement("E0201", message, part.span, hint, guessed=bool(near))
    if found.protected:
        raise Wrong("E0210", f"'{part.name}' is protected in '{node.cls.name}'", part.span)
    return context.model.child(node, part.name)


def _require_present(node: InstanceNode, part: tree.RefPart) -> None:
    if isinstance(node, Broken):
        raise Wrong()
    if isinstance(node, Absent):
        why = "its condition is false" if node.component.condition is not None else "nothing is connected to it"
        raise NotThere("E0218", f"'{node.name}' is absent here: {why}", part.span)


def _subscripts(context: Context, node: InstanceNode, part: tree.RefPart) -> list[Index | Slice]:
    if len(part.subscripts) != len(node.dims):
        count = len(node.dims)
        expected = f"{count} subscript{'s' * (count != 1)}" if count else "no subscripts: it is not an array"
        raise Wrong(
            "E0216", f"'{node.name}' has {count} dimension{'s' * (count != 1)}", part.span,
            expected=expected, found=str(len(part.subscripts)),
        )  # fmt: skip
    declared = node.component.dimensions if node.component is not None else ()
    sizes = (*declared, *(None for _ in range(len(node.dims) - len(declared))))
    return [
        subscript(context, s, n, node.name, _counted(node, size))
        for s, n, size in zip(part.subscripts, node.dims, sizes, strict=True)
    ]


def _counted(node: InstanceNode, size: tree.Expression | None) -> Callable[[], str]:
    """What gives the type whose values count along a dimension that is declared so; nothing where that is not known."""

    def type_() -> str:
        if size is None or isinstance(size, tree.Colon):
            return ""
        literals = type_of_dimension(node.scope, size)
        return literals.name if literals else "Integer"

    return type_


def subscript(
    context: Context, expression: tree.Expression, length: int, name: str, counted: Callable[[], str] = str
) -> Index | Slice:
    """Positions from 0 along an axis of this length; `counted` gives the type of its subscripts where that is known."""
    if isinstance(expression, tree.Colon):
        return Slice(positions((length,)))
    before, context.end = context.end, length
    try:
        value = context.value(expression)
    finally:
        context.end = before
    if value.type == "String" or len(value.dims) > 1:
        raise Wrong("E0301", "a subscript must be an integer", expression.span, found=value.type)
    if value.type not in ("Integer", "Real") and counted() not in ("", value.type):
        raise Wrong("E0301", f"'{name}' is not counted by values of this type", expression.span, expected=counted(),
                    found=value.type)  # fmt: skip
    try:
        numbers = context.known(value, expression.span, "a subscript")
    except NotKnown as wrong:
        if value.dims or value.type != "Integer":
            raise
        raise NotKnownSubscript(wrong, expression, length) from None
    if value.type == "Boolean":
        numbers = numbers + 1.0  # `false` is the first
    if not np.isfinite(numbers).all():
        raise Wrong("E0301", "a subscript must be an integer", expression.span, found="a number that is not finite")
    if not isinstance(numbers, np.ndarray) or numbers.ndim == 0:
        numbers = float(numbers)
        position = int(numbers) - 1
        if position + 1 != numbers:
            raise Wrong("E0301", "a subscript must be an integer", expression.span, found=f"{numbers:g}")
        if not 0 <= position < length:
            raise _out_of_range(position + 1, length, name, expression.span)
        return Slice(np.array([position])) if value.dims else position
    index = numbers.astype(int) - 1
    if np.any(index + 1 != numbers):
        raise Wrong("E0301", "a subscript must be an integer", expression.span)
    if index.size and (index.min() < 0 or index.max() >= length):
        bad = index[(index < 0) | (index >= length)].flat[0] + 1
        raise _out_of_range(int(bad), length, name, expression.span)
    if value.dims:
        rank = context.space.rank
        full = np.broadcast_to(align(index, rank + 1), (*align(index, rank + 1).shape[:-1], value.dims[0]))
        return Slice(full.reshape(full.shape[-1:]) if full.size == full.shape[-1] else full)
    return index


def _out_of_range(number: int, length: int, name: str, span: Span) -> Wrong:
    return OutOfRange(
        "E0215", f"index {number} of '{name}' is out of range", span, expected=f"1 … {length}", found=str(number)
    )


def element_index(context: Context, located: Located) -> Index:
    """Positions of the elements within the node's array: over the axes of the space, then of the slices."""
    node, space = located.node, context.space
    if not node.total:
        return 0
    only_rows = located.shared == len(node.total)
    if located.implicit and space.whole and (only_rows or space.rank == located.shared):
        return positions(node.total)
    slices, seen = len(located.dims), 0
    result: Index = 0
    stride = node.size
    for axis, length in zip(located.axes, node.total):
        stride //= length or 1
        if isinstance(axis, Slice):
            array = align_slice(axis.index, space.rank, seen, slices)
            seen += 1
        else:
            array = align(axis, space.rank + slices)
        result = result + array * stride
    return int(result) if isinstance(result, np.ndarray) and result.ndim == 0 else result


def align_slice(index: np.ndarray, rank: int, place: int, slices: int) -> np.ndarray:
    """The positions of one slice among several, behind the axes of the space."""
    rows = index.shape[:-1]
    return index.reshape(rows + (1,) * (rank - len(rows) + place) + index.shape[-1:] + (1,) * (slices - place - 1))


def located_value(context: Context, located: Located, span: Span) -> Value:
    """The value of a variable's elements."""
    node = located.node
    if isinstance(node, Instance) and node.kind == "record":
        return _record(context, located, span)
    if not isinstance(node, Variable):
        kind = "connector" if isinstance(node, Instance) and node.connector else "part"
        raise Wrong("E0301", f"'{node.name}' is a {kind}, not a variable", span)
    if node.type.name == "String":
        return _text_at(context, _string(context, node, span), located.axes, span)
    value = Value(context.leaves.slot(node, element_index(context, located)), located.dims, node.type.name)
    return value if node.kind != Kind.INPUT or node.type.name == "Real" else _sampled(context, value)


def _record(context: Context, located: Located, span: Span) -> Value:
    """A record, or an array of records, as a value: those of its fields."""
    node, fields = located.node, {}
    for name, member in node.cls.table.items():
        child = context.model.child(node, name) if isinstance(member, Member) else None
        if isinstance(child, Broken):
            raise Wrong()
        if child is not None and not isinstance(child, Absent):
            axes = (*located.axes, *(Slice(positions((n,))) for n in child.dims))
            fields[name] = located_value(context, replace(located, node=child, axes=axes), span)
    return record(fields, located.dims, node.cls.name)


def _sampled(context: Context, value: Value) -> Value:
    """A signal from outside that jumps: its value changes at events (a Boolean above 1/2, else the nearest number)."""
    if context.quiet or context.depth:
        return value
    half = dag.const(0.5)
    logical = value.type == "Boolean"
    jumps = dag.function("gt", value.expr, half) if logical else dag.function("floor", value.expr + half)
    return Value(dag.event(jumps), value.dims, value.type)


def _string(context: Context, node: Variable, span: Span) -> Value:
    if node.value is None or node.value.scope is None:
        raise Wrong("E0212", f"the string '{node.name}' has no value", span)
    return context.model.known.binding(node.value)[1]


def _text_at(context: Context, value: Value, axes: tuple[Index | Slice, ...], span: Span) -> Value:
    """The elements of texts along some axes; along those that are more than its own a value is alike."""
    if not axes:
        return value
    axis, own = axes[0], len(axes) <= len(value.dims)
    if isinstance(axis, Slice):
        if axis.index.ndim > 1:
            raise NotAlike("a text", span)
        places = [int(k) for k in axis.index]
        items = [context.arrays.element(value, k) if own else value for k in places]
        return stack([_text_at(context, item, axes[1:], span) for item in items], value.dims[1:], "String")
    if not own:
        return _text_at(context, value, axes[1:], span)
    where = np.asarray(axis)
    if np.any(where != where.flat[0]):
        raise NotAlike("a text", span)
    return _text_at(context, context.arrays.element(value, int(where.flat[0])), axes[1:], span)


# --------------------------------------------------------------------------- in packages


def _constant(context: Context, found: Member | Scope | Builtin, ref: tree.Ref) -> Value:
    """A constant of a package or a literal of an enumeration."""
    for k, part in enumerate(ref.parts):
        if k:
            found = element_of(found, part)
        if isinstance(found, Member):
            return _field_of_value(context, ref, k, constant_of(context, found, part))
        if isinstance(found, Value):
            return found
    hint = nearest(ref.parts[-1].name, _variables(context, False))
    raise Wrong("E0301", f"'{found.name}' is a class, not a variable", ref.span, hint=hint)


# --------------------------------------------------------------------- subscripts of values


def subscripted(context: Context, value: Value, part: tree.RefPart) -> Value:
    """Elements of a value that is not an array of variables: of a function's variable, of a package's constant."""
    check_subscripts(part, value)
    return _select(context, value, part, 0)


def check_subscripts(part: tree.RefPart, value: Value) -> None:
    """Refuse another number of subscripts than a value has dimensions."""
    if len(part.subscripts) != len(value.dims):
        count = len(value.dims)
        raise Wrong("E0216", f"'{part.name}' has {count} dimension{'s' * (count != 1)}", part.span,
                    expected=f"{count} subscripts", found=str(len(part.subscripts)))  # fmt: skip


def _select(context: Context, value: Value, part: tree.RefPart, k: int) -> Value:
    if k == len(part.subscripts):
        return value
    expression = part.subscripts[k]
    where = subscript(context, expression, value.dims[0], part.name)
    if isinstance(where, Slice):
        if where.index.ndim > 1:
            raise NotAlike("a subscript", expression.span)
        items = [_select(context, context.arrays.element(value, int(j)), part, k + 1) for j in where.index]
        return stack(items, type=value.type)
    if isinstance(where, np.ndarray):
        if np.any(where != where.flat[0]):
            return _select_by_row(context, value, part, k, where)
        where = int(where.flat[0])
    return _select(context, context.arrays.element(value, where), part, k + 1)


def _select_by_row(context: Context, value: Value, part: tree.RefPart, k: int, where: np.ndarray) -> Value:
    """An array of numbers indexed by an iteration variable: a column of numbers."""
    span = part.subscripts[k].span
    if len(value.dims) != 1:
        raise NotAlike("a subscript", span)
    numbers = context.alike(value, span, f"'{part.name}'")
    return Value(context.leaves.slot(None, numbers[where]), (), value.type)
