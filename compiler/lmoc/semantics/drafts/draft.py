"""Groups and assignments before the variables have their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field, replace
from math import prod
from typing import TypeVar

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.ir.law import LawKind
from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Span
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Binding, Instance, Variable
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.helpers import Helpers
from lmoc.semantics.values.rows import Index, Leaf, align, positions
from lmoc.semantics.values.translate import dims_text
from lmoc.semantics.values.value import Value
from lmoc.support.records import dataclass

Column = tuple[Variable | None, Index | float | np.ndarray]  # flat positions (or numbers), one a row or alike in all


@dataclass(frozen=True, eq=False)
class GroupDraft:
    """As `flat.Group`, with columns instead of slots."""

    left: Expr
    right: Expr
    columns: tuple[Column, ...]
    rows: int
    span: Span | None
    node: Instance  # whose equation it is
    origin: str = "equation"
    library: bool = False
    smooth: int = -1


@dataclass(frozen=True, eq=False)
class AssignmentDraft:
    """As `flat.Assignments`; `target` are flat positions within the variable's array."""

    variable: Variable
    target: np.ndarray | int
    shape: Expr
    columns: tuple[Column, ...]
    span: Span | None
    library: bool = False
    depth: float = 0  # of the instance in whose text it is written: 0 for the model itself; inf for that of a type

    @property
    def rows(self) -> int:
        return self.target.size if isinstance(self.target, np.ndarray) else 1


@dataclass(frozen=True, eq=False)
class CheckDraft:
    """As `flat.Check`."""

    condition: Expr
    message: str
    error: bool
    columns: tuple[Column, ...]
    rows: int
    span: Span
    at_events: bool = False
    node: Instance | None = None  # the part whose text it is in


@dataclass(frozen=True, eq=False)
class DecisionDraft:
    """As `flat.Decision`."""

    condition: Expr
    columns: tuple[Column, ...]
    held: np.ndarray

    @property
    def rows(self) -> int:
        return len(self.held)


@dataclass(frozen=True, eq=False)
class ConnectDraft:
    """``connect(a, b)`` for many pairs of connector elements."""

    left: Instance | Variable
    left_index: np.ndarray
    right: Instance | Variable
    right_index: np.ndarray
    node: Instance  # the part whose class says so
    span: Span


@dataclass(frozen=True, eq=False)
class RootDraft:
    """``Connections.root(a)``, ``potentialRoot(a, priority)`` or ``branch(a, b)`` (9.4), for many rows."""

    kind: str  # root, potentialRoot, branch
    left: Instance
    left_index: np.ndarray
    right: Instance | None
    right_index: np.ndarray
    priority: int
    span: Span


@dataclass(frozen=True, eq=False)
class LawDraft:
    """As `lmoc.ir.law.Laws`, with columns instead of variables; `texts` are the names of the events."""

    kind: LawKind
    columns: dict[str, Column]
    texts: dict[str, str]
    rows: int
    span: Span
    node: Instance


@dataclass(frozen=True, eq=False)
class ActionDraft:
    """Something that a branch of a `when` does: columns by name, shapes over further columns.

    Attributes
    ----------
    columns : {name: column}, each over all rows
    shape, slots : an expression and its columns
    """

    columns: dict[str, Column]
    shape: Expr
    slots: tuple[Column, ...]
    rows: int
    span: Span
    node: Instance
    text: str = ""


AnyDraft = TypeVar("AnyDraft", GroupDraft, AssignmentDraft, CheckDraft, ActionDraft)


@dataclass(frozen=True)
class Guard:
    """What must be true for a statement of a when-equation to be carried out, where it stands, and if it branches."""

    condition: Expr
    span: Span
    branches: bool


@dataclass
class Drafts:
    """The equations and bindings of the whole model translated so far."""

    groups: list[GroupDraft] = field(default_factory=list)
    initial: list[GroupDraft] = field(default_factory=list)
    bindings: list[AssignmentDraft] = field(default_factory=list)
    starts: list[AssignmentDraft] = field(default_factory=list)
    fixed: list[AssignmentDraft] = field(default_factory=list)
    nominals: list[AssignmentDraft] = field(default_factory=list)
    checks: list[CheckDraft] = field(default_factory=list)
    decisions: list[DecisionDraft] = field(default_factory=list)
    connects: list[ConnectDraft] = field(default_factory=list)
    roots: list[RootDraft] = field(default_factory=list)
    laws: list[LawDraft] = field(default_factory=list)
    branches: list[GroupDraft] = field(default_factory=list)  # of if-equations, as they are written: for their units
    whens: list[ActionDraft] = field(default_factory=list)
    samples: list[ActionDraft] = field(default_factory=list)
    reinits: list[ActionDraft] = field(default_factory=list)
    terminations: list[ActionDraft] = field(default_factory=list)
    helpers: Helpers = field(default_factory=Helpers)
    assigned: dict[tuple, tuple[object, Span]] = field(default_factory=dict)  # at events: by which `when`, and where
    guard: Guard | None = None  # of the statement of a when-equation that is being translated
    arguments: list[Diagnostic] = field(default_factory=list)  # of functions, in another unit than the input's
    drawn: Span | None = None  # where a generator with a hidden state is called


def compact(leaves: list[Leaf], *shapes: Expr) -> tuple[list[Leaf], tuple[Expr, ...]]:
    """Only the columns that the shapes use, numbered in the order in which they first appear."""
    order: dict[int, int] = {}
    used = []
    for shape in shapes:
        for node in dag.postorder(shape):
            if node.op == "slot":
                used.append(node)
                order.setdefault(node.value[0], len(order))
    if all(old == new for old, new in order.items()):
        return leaves[: len(order)], shapes
    new = {node: dag.slot(order[node.value[0]], node.value[1]) for node in used}
    return [leaves[k] for k in order], tuple(dag.substitute(shape, new) for shape in shapes)


def without_ones(draft: GroupDraft | AssignmentDraft) -> GroupDraft | AssignmentDraft:
    """The draft without the factors 1 that have made units unknown."""
    return _with_ones(draft, lambda v, index: v is None and np.ndim(index) == 0 and index == 1.0)


def with_one(draft: AnyDraft, variable: Variable) -> AnyDraft:
    """The draft with 1 in the place of a variable."""
    return _with_ones(draft, lambda v, _: v is variable)


_SHAPES = {
    GroupDraft: ("left", "right"),
    AssignmentDraft: ("shape",),
    CheckDraft: ("condition",),
    ActionDraft: ("shape",),
}


def _with_ones(draft: AnyDraft, is_one: Callable[[Variable | None, object], bool]) -> AnyDraft:
    table, shapes = "slots" if isinstance(draft, ActionDraft) else "columns", _SHAPES[type(draft)]
    old = getattr(draft, table)
    new = {dag.slot(k): dag.ONE for k, (v, index) in enumerate(old) if is_one(v, index)}
    if not new:
        return draft
    columns, found = compact(old, *(dag.substitute(getattr(draft, name), new) for name in shapes))
    return replace(draft, **{table: tuple(columns)}, **dict(zip(shapes, found)))


def flat_column(leaf: Leaf, shape: tuple[int, ...]) -> Column:
    """A column over rows of this shape, row by row."""
    index = leaf.index
    if not isinstance(index, np.ndarray):
        return leaf.variable, index
    index = align(index, len(shape))
    if index.shape != shape:
        if index.size == 1:
            return leaf.variable, index.reshape(-1)[0].item()
        index = np.broadcast_to(index, shape)
    return leaf.variable, index.reshape(-1)


def decision(context: Context, condition: Value, found: np.ndarray | float) -> Iterator[DecisionDraft]:
    """What a condition on parameters was, over the rows of a space; nothing where it cannot change."""
    leaves, (shape,) = compact(context.leaves.items, condition.expr)
    if not any(leaf.variable is not None and leaf.variable.kind == Kind.PARAMETER for leaf in leaves):
        return
    rows = context.space.shape
    columns = tuple(flat_column(leaf, rows) for leaf in leaves)
    if not any(isinstance(index, np.ndarray) for _, index in columns):
        rows = ()
    held = np.broadcast_to(align(np.asarray(found), len(rows)), rows).reshape(-1) != 0
    if len(held):
        yield DecisionDraft(shape, columns, held)


def equality(context: Context, left: Value, right: Value, span: Span, node: Instance, origin="equation") -> Iterator:
    """The groups of ``left = right``, which must have the same dimensions."""
    if left.uniform and right.uniform:
        shape = context.space.shape + left.dims
        rows = prod(shape)
        if rows:
            leaves, (a, b) = compact(context.leaves.items, left.expr, right.expr)
            columns = tuple(flat_column(leaf, shape) for leaf in leaves)
            smooth = -1 if context.leaves.smooth is None else context.leaves.smooth
            yield GroupDraft(a, b, columns, rows, span, node, origin, context.scope.library, smooth)
        return
    for a, b in zip(context.arrays.elements(left), context.arrays.elements(right)):
        yield from equality(context, a, b, span, node, origin)


def spread(
    context: Context, value: Value, binding: Binding, variable: Variable, lenient: bool = False
) -> Iterator[tuple[np.ndarray | int, Expr, tuple[Column, ...]]]:
    """A value given to a variable: positions in its array, shape and columns of its contents.

    Parameters
    ----------
    lenient : a scalar is taken for all elements of an array without `each`
    """
    rank = context.space.rank
    extra = variable.total[rank:]
    alike = (*binding.alike, *(False,) * (len(extra) - len(binding.alike)))
    if not value.dims and (lenient or all(alike)):
        alike = (True,) * len(extra)
    open_axes = tuple(n for n, same in zip(extra, alike) if not same)
    if value.dims != open_axes:
        raise _size_mismatch(value.dims, open_axes, binding, variable)
    everything = positions(variable.total)
    for at, piece in context.arrays.pieces(value):
        choice, kept = _axes(alike, at)
        target = everything[(slice(None),) * rank + choice] if choice else everything
        leaves, (shape,) = compact(context.leaves.items, piece.expr)
        columns = []
        for leaf in leaves:
            index = leaf.index
            if isinstance(index, np.ndarray) and index.ndim:
                index = align(index, rank + len(piece.dims))[(slice(None),) * rank + kept]
            columns.append(flat_column(Leaf(leaf.variable, index), target.shape))
        if target.size:
            yield (target.reshape(-1) if target.ndim else int(target)), shape, tuple(columns)


def _axes(alike: tuple[bool, ...], at: tuple[int, ...]) -> tuple[tuple, tuple]:
    """Return how a piece at these positions indexes the target's further axes, and how its columns get equal ones."""
    choice, kept, k = [], [], 0
    for same in alike:
        if same:
            choice.append(slice(None))
            kept.append(np.newaxis)
        elif k < len(at):
            choice.append(at[k])
            k += 1
        else:
            choice.append(slice(None))
            kept.append(slice(None))
    return tuple(choice), tuple(kept)


def _with_each(binding: Binding, variable: Variable) -> str:
    """The modification that gives one value to all elements, as it would be written: ``car(each wheel(m = …))``."""
    path = variable.path[len(binding.node.path) :]
    array = next(k for k, (_, dims) in enumerate(path) if dims)
    names = [name for name, _ in path[array + 1 :]]
    return f"{path[array][0]}(each {'('.join(names)} = …{')' * len(names)}"


def _size_mismatch(found: tuple[int, ...], expected: tuple[int, ...], binding: Binding, variable: Variable) -> Wrong:
    of_parts = len(expected) > len(variable.dims)
    if not found and of_parts:
        hint = f"write 'each' to give all the same: '{_with_each(binding, variable)}'"
        if any(binding.each):
            hint = f"'each' is too deeply nested, move it out: '{_with_each(binding, variable)}'"
        message = f"'{variable.label}' is in an array of parts and needs one value for each"
        return Wrong("E0213", message, binding.span, expected=dims_text(expected), found="a scalar", hint=hint)
    row = len(expected) == 1 and found in ((1, *expected), (*expected, 1))
    return Wrong(
        "E0302", f"the value of '{variable.label}' has the wrong size", binding.span,
        expected=dims_text(expected), found=dims_text(found),
        hint="a vector is written {a, b, c}; [a, b, c] is a matrix" if row else "",
    )  # fmt: skip
