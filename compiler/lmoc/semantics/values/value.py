"""The meaning of an expression: one shape for all elements of an array, or a value for each where they differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from lmoc.expression.dag import Expr, const, slot, slots, substitute
from lmoc.expression.evaluate import evaluate
from lmoc.semantics.values.rows import Leaves, align


class Value:
    """The meaning of an expression over the rows of a space.

    Either *uniform*: one shape for all array elements, whose columns have the array's axes behind those of the space;
    or *stacked*: one value for each position along the first array axis. A `String` is known when compiling. A record
    has a value for each of its fields; those of an array of records have its dimensions before their own.

    Attributes
    ----------
    expr : the shape, None where stacked or a String
    dims : array dimensions
    items : values along the first axis, None where uniform
    type : Real, Integer, Boolean, String, or the name of an enumeration or a record
    text : of a String
    fields : of a record, by name; None where it is none
    """

    __slots__ = ("expr", "dims", "items", "type", "text", "fields")

    def __init__(self, expr: Expr | None, dims: tuple[int, ...] = (), type: str = "Real", items=None, text: str = ""):
        self.expr = expr
        self.dims = dims
        self.type = type
        self.items = items
        self.text = text
        self.fields: dict[str, Value] | None = None

    @property
    def uniform(self) -> bool:
        return self.items is None

    def __repr__(self) -> str:
        return f"Value({self.expr if self.uniform else self.items}, {self.dims}, {self.type})"


def number(value: float | bool, type: str = "Real") -> Value:
    """A known number."""
    return Value(const(value), (), type)


def text(value: str) -> Value:
    """A known text."""
    return Value(None, (), "String", text=value)


def record(fields: dict[str, Value], dims: tuple[int, ...], type: str) -> Value:
    """A record, or an array of records, from its fields."""
    made = Value(None, dims, type)
    made.fields = fields
    return made


def stack(items: list[Value] | tuple[Value, ...], dims: tuple[int, ...] = (), type: str = "") -> Value:
    """An array from its elements along a new first axis; `dims` and `type` of an element where there are none."""
    if items and items[0].fields is not None:
        fields = {name: stack([item.fields[name] for item in items]) for name in items[0].fields}
        return record(fields, (len(items), *items[0].dims), type or items[0].type)
    inner = items[0].dims if items else dims
    return Value(None, (len(items), *inner), type or common_type(items), tuple(items))


def as_real(value: Value) -> Value:
    """Return Integers as Real numbers; what is Real already, as it is."""
    if value.items is not None:
        return stack([as_real(item) for item in value.items], value.dims[1:], "Real")
    return Value(value.expr, value.dims, "Real") if value.type == "Integer" else value


def from_numbers(numbers: np.ndarray, type: str = "Real") -> Value:
    """Known numbers, element by element."""
    if numbers.ndim == 0:
        return number(float(numbers), type)
    return stack([from_numbers(row, type) for row in numbers], numbers.shape[1:], type)


def common_type(values) -> str:
    """The type of an array of such elements."""
    types = {v.type for v in values}
    if not types:
        return "Real"
    if types == {"Real", "Integer"}:
        return "Real"
    return next(iter(types)) if len(types) == 1 else "Real"


class Arrays:
    """Array operations on values over a space with `rank` axes, with columns in `leaves`."""

    __slots__ = ("leaves", "rank")

    def __init__(self, leaves: Leaves, rank: int):
        self.leaves = leaves
        self.rank = rank

    # -------------------------------------------------------------- taking apart

    def element(self, value: Value, position: int) -> Value:
        """The part of an array at a position (from 0) of its first axis."""
        if value.items is not None:
            return value.items[position]
        if value.fields is not None:
            fields = {name: self.element(field, position) for name, field in value.fields.items()}
            return record(fields, value.dims[1:], value.type)
        return Value(self._map_columns(value.expr, lambda a: self._take(a, position)), value.dims[1:], value.type)

    def _take(self, array, position: int):
        if not isinstance(array, np.ndarray) or array.ndim <= self.rank:
            return array
        taken = np.take(array, position if array.shape[self.rank] > 1 else 0, axis=self.rank)
        return int(taken) if taken.ndim == 0 and taken.dtype.kind == "i" else taken

    def _map_columns(self, expr: Expr, change: Callable) -> Expr:
        """The shape with every column's array changed."""
        new = {}
        for leaf in slots(expr):
            column, order = leaf.value
            old = self.leaves[column]
            index = change(old.index)
            if old.variable is None and not isinstance(index, np.ndarray):
                new[leaf] = const(index)
            elif index is not old.index:
                moved = self.leaves.slot(old.variable, index)
                new[leaf] = moved if order == 0 else slot(moved.value[0], order)
        return substitute(expr, new) if new else expr

    def elements(self, value: Value) -> list[Value]:
        """All parts along the first axis."""
        if value.items is not None:
            return list(value.items)
        return [self.element(value, j) for j in range(value.dims[0])]

    def scalars(self, value: Value) -> list[Value]:
        """All elements, in row-major order."""
        if not value.dims:
            return [value]
        return [s for item in self.elements(value) for s in self.scalars(item)]

    def pieces(self, value: Value, at: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], Value]]:
        """Uniform values with the positions along the first axes that they belong to; a record's are its fields'."""
        if value.fields is not None:
            for field in value.fields.values():
                yield from self.pieces(field, at)
        elif value.uniform:
            yield at, value
        else:
            for j, item in enumerate(value.items):
                yield from self.pieces(item, (*at, j))

    # ----------------------------------------------------------- putting together

    def transpose(self, value: Value) -> Value:
        """First and second axis exchanged."""
        columns = [self.elements(row) for row in self.elements(value)]
        return stack([stack([row[j] for row in columns]) for j in range(value.dims[1])])

    def map(self, function: Callable[..., Expr], *values: Value, type: str = "Real") -> Value:
        """A function of scalars, element by element; scalars are alike along arrays."""
        dims = next((v.dims for v in values if v.dims), ())
        if all(v.items is None for v in values):
            return Value(function(*(v.expr for v in values)), dims, type)
        rows = [self.elements(v) if v.dims else [v] * dims[0] for v in values]
        items = [self.map(function, *row, type=type) for row in zip(*rows)]
        return Value(None, dims, type, tuple(items))

    def fold(self, function: Callable[[Expr, Expr], Expr], value: Value, start: Expr) -> Expr:
        """All elements combined from left to right."""
        result = start
        for item in self.scalars(value):
            result = function(result, item.expr)
        return result

    # --------------------------------------------------------------------- numbers

    def numbers(self, value: Value, column: Callable[[int, int], object]) -> np.ndarray | float:
        """The numbers of a value whose columns are known: over the axes of the space, then of the array."""
        if value.items is not None:
            if not value.items:
                return np.zeros(value.dims)
            axes = self.rank + len(value.dims) - 1
            parts = [align(np.asarray(self.numbers(v, column), float), axes) for v in value.items]
            shape = np.broadcast_shapes(*(p.shape for p in parts))
            return np.stack([np.broadcast_to(p, shape) for p in parts], axis=self.rank)
        if value.expr.is_const:
            return value.expr.value
        axes = self.rank + len(value.dims)
        return evaluate(value.expr, lambda k, order: align(column(k, order), axes))
