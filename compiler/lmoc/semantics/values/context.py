"""The context of an expression: its class, rows and iteration variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import prod
from typing import Any, Protocol

import numpy as np

from lmoc.expression import dag
from lmoc.ir.flat import Block, Kind
from lmoc.messages.diagnostics import Label, Report
from lmoc.messages.source import Span
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Budget, NotAlike, NotKnown, Wrong
from lmoc.semantics.nodes.instance import Binding, Instance, InstanceNode, Variable
from lmoc.semantics.values.rows import Index, Leaves, Space, whole_space
from lmoc.semantics.values.value import Arrays, Value
from lmoc.syntax import tree


class Known(Protocol):
    """Values that are computed while the model is made."""

    def numbers(self, variable: Variable) -> np.ndarray: ...

    def decided(
        self, context: Context, condition: Value, evaluate: Callable[[], np.ndarray | float]
    ) -> np.ndarray | float: ...

    def binding(self, binding: Binding) -> tuple[Context, Value]: ...

    def constant(self, component: tree.Component, expression: tree.Expression, scope: Scope) -> Value: ...


class Summation(Protocol):
    """Sums that get a variable of their own."""

    def fits(self, context: Context, array: Value) -> bool: ...

    def add(self, context: Context, array: Value, span: Span) -> Value: ...

    sums: list
    variables: list


class Model(Protocol):
    """The model in the making, as far as its expressions need it."""

    report: Report
    known: Known
    long_sums: Summation
    rounds: Budget
    parts: Budget
    drafts: Any
    root: Instance
    topology: Any  # what is connected to what, once all parts are made

    def child(self, instance: Instance, name: str) -> InstanceNode: ...

    def populate(self, instance: Instance) -> None: ...

    def in_the_making(self, instance: Instance, name: str) -> bool: ...

    def open_size(self, instance: Instance, name: str, axis: int) -> int: ...

    def say_once(self, code: str, message: str, span: Span, **more: object) -> None: ...

    def not_said(self, code: str, span: Span) -> bool: ...


# how each kind of syntax node is translated; the modules of the translation fill it
TRANSLATORS: dict[type, Callable[[Context, object], Value]] = {}


def translates(*kinds: type):
    """Register the function that gives the value of these syntax nodes."""

    def register(function):
        for kind in kinds:
            TRANSLATORS[kind] = function
        return function

    return register


class Context:
    """The surroundings of an expression.

    Attributes
    ----------
    model : the elaboration that this is part of
    node : the instance whose names can be used; None inside packages and functions
    scope : the class whose text this is
    space : the rows
    leaves : the columns of the group in the making
    names : iteration variables and, in a function, its variables
    quiet : how many noEvent() or smooth() stand around, or a place without events: kinks are intended, and relations
        make no events
    marked : how many of these are noEvent() or smooth(), within which relations of time alone are events all the same
    in_when : it appears in the body of a `when`
    choices : branches that these rows take, by the identity of the if-expression
    depth : of function calls
    open_ifs : how many statements stand around that only the run decides to reach
    known_ifs : how many branches stand around that are all written out, though parameters decide which is taken
    entered : `known_ifs` where each function that is being carried out was last called, by the identity of its text
    end : what `end` means in the subscript being read
    assigned : those of the names that stand for what an algorithm has assigned so far
    """

    __slots__ = (
        "model", "node", "scope", "space", "leaves", "names", "arrays", "quiet", "marked", "in_when", "choices",
        "depth", "open_ifs", "known_ifs", "entered", "end", "assigned",
    )  # fmt: skip

    def __init__(
        self,
        model: Model,
        node: Instance | None,
        scope: Scope,
        space: Space | None = None,
        leaves: Leaves | None = None,
        names: dict[str, Value] | None = None,
        quiet: int = 0,
    ):
        self.model = model
        self.node = node
        self.scope = scope
        self.space = whole_space(node.total if node else ()) if space is None else space
        self.leaves = Leaves() if leaves is None else leaves
        self.names = {} if names is None else names
        self.arrays = Arrays(self.leaves, self.space.rank)
        self.quiet = quiet
        self.marked = 0
        self.in_when = False
        self.choices: dict[int, int] = {}
        self.depth = self.open_ifs = self.known_ifs = 0
        self.entered: Mapping[int, int] = {}
        self.end: int | None = None
        self.assigned: frozenset[str] = frozenset()

    def value(self, expression: tree.Expression) -> Value:
        """The meaning of an expression here."""
        return TRANSLATORS[type(expression)](self, expression)

    def within(self, space: Space, names: dict[str, Value]) -> Context:
        """The same place with another space and further names."""
        inner = Context(self.model, self.node, self.scope, space, self.leaves, {**self.names, **names}, self.quiet)
        inner.assigned = self.assigned
        self._go_on_in(inner)
        return inner

    @property
    def unassigned(self) -> Context:
        """The same place, with the variables themselves in place of what an algorithm has assigned."""
        if not self.assigned:
            return self
        kept = {name: value for name, value in self.names.items() if name not in self.assigned}
        inner = Context(self.model, self.node, self.scope, self.space, self.leaves, kept, self.quiet)
        self._go_on_in(inner)
        return inner

    def inside_function(self, scope: Scope, names: dict[str, Value]) -> Context:
        """The body of a function: it sees its own names only."""
        inner = Context(self.model, None, scope, self.space, self.leaves, names, self.quiet)
        inner.depth, inner.marked, inner.open_ifs = self.depth, self.marked, self.open_ifs
        inner.known_ifs, inner.entered = self.known_ifs, self.entered
        return inner

    def _go_on_in(self, inner: Context) -> None:
        """What stands around a place stands around a part of it."""
        inner.depth, inner.choices, inner.in_when, inner.marked = self.depth, self.choices, self.in_when, self.marked
        inner.open_ifs, inner.known_ifs, inner.entered = self.open_ifs, self.known_ifs, self.entered

    # ------------------------------------------------------------ known when compiling

    def known(self, value: Value, span: Span, what: str = "this") -> np.ndarray | float:
        """The numbers of a value that must be known when compiling, over the axes of the space and then its own."""
        if value.type == "String":
            raise Wrong("E0301", f"{what} must be a number, not a text", span)
        if value.fields is not None:
            raise Wrong("E0301", f"{what} must be a number, not a record", span, found=value.type)
        if any(dag.depends_on_time(piece.expr) for _, piece in self.arrays.pieces(value)):
            raise NotKnown("E0211", f"{what} must be known when compiling, but depends on time", span)

        def column(k: int, order: int) -> Index | float | np.ndarray:
            leaf = self.leaves[k]
            if leaf.variable is None:
                return leaf.index
            if not leaf.variable.known or order:
                name = leaf.variable.label
                raise NotKnown("E0211", f"{what} must be known when compiling, but depends on '{name}'", span)
            return self.model.known.numbers(leaf.variable)[leaf.index]

        def numbers() -> np.ndarray | float:
            return self.arrays.numbers(value, column)

        decides = value.type == "Boolean" and not value.dims
        result = self.model.known.decided(self, value, numbers) if decides else numbers()
        if np.any(np.isnan(result)):
            raise NotKnown("E0211", f"{what} must be known when compiling, but has no value", span)
        return result

    def scalar(self, value: Value, span: Span, what: str = "this") -> float:
        """As `alike`, for a single number."""
        if value.dims:
            raise Wrong("E0301", f"{what} must be a single value", span, found="an array")
        return float(self.alike(value, span, what))

    def whole(self, value: Value, span: Span, what: str, least: int = 0) -> int:
        """As `scalar`, for a whole number."""
        if value.dims or value.type == "Boolean":
            raise Wrong("E0301", f"{what} must be an integer", span)
        number = self.scalar(value, span, what)
        if not np.isfinite(number) or number != round(number) or number < least:
            raise Wrong("E0301", f"{what} must be an integer of at least {least}", span, found=f"{number:g}")
        return int(number)

    def alike(self, value: Value, span: Span, what: str = "this") -> np.ndarray:
        """As `known`, where it must be the same in all rows: over the value's own axes only."""
        numbers = np.asarray(self.known(value, span, what), float)
        if numbers.ndim <= len(value.dims) and self.space.rank == 0:
            return np.broadcast_to(numbers, value.dims)
        numbers = numbers.reshape(numbers.shape + (1,) * (self.space.rank + len(value.dims) - numbers.ndim))
        flat = numbers.reshape((prod(numbers.shape[: self.space.rank]), *numbers.shape[self.space.rank :]))
        if len(flat) and np.any(flat != flat[0]):
            raise NotAlike(what, span, **self._difference(value, flat))
        if not len(flat):
            raise Wrong()
        return np.broadcast_to(flat[0], value.dims)

    def _difference(self, value: Value, numbers: np.ndarray) -> dict[str, object]:
        """Describe which two elements differ, where numbers, one row for each of the space, should be the same."""
        if not self.space.whole or self.node is None or self.space.shape != self.node.total:
            return {}  # the rows are rounds of a loop
        differing = int(np.flatnonzero((numbers != numbers[0]).reshape(len(numbers), -1).any(axis=1))[0])
        names = (Block(self.node.path, 0, self.node.size, Kind.UNKNOWN).name(k) for k in (0, differing))
        shown = (_number_text(numbers[k], value.type) for k in (0, differing))
        found = ", ".join(f"{text} in '{name}'" for text, name in zip(shown, names))
        array: Instance = self.node
        while not array.dims:
            array = array.parent
        hint = f"declare the elements of '{array.name}' that differ one by one, as parts with names of their own"
        labels = (Label(array.name_span, "the array of parts"),) if array.name_span else ()
        return {"expected": "the same in all elements", "found": found, "hint": hint, "labels": labels}


def _number_text(numbers: np.ndarray, type_: str) -> str:
    if type_ == "Boolean" and numbers.size == 1:
        return "true" if numbers.item() else "false"
    return f"{numbers.item():g}" if numbers.size == 1 else "an array"
