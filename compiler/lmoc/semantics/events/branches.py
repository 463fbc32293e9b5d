"""If-equations whose condition changes in time (Modelica specification, 8.3.4).

All branches have as many equations. The k-th equations of all branches become one: ``x = if c then a else b`` where
they have the same variable alone on the left, else the difference of the sides of the branch that holds is zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.messages.diagnostics import Label
from lmoc.semantics.drafts.draft import CheckDraft, Column, Drafts, GroupDraft, compact, flat_column
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree

Translate = Callable[[tuple[tree.Equation, ...]], list[GroupDraft]]


def conditional(
    drafts: Drafts, node: Instance, context: Context, conditions: list[Value], e: tree.IfEquation, translate: Translate
) -> list[GroupDraft]:
    """The equations of an if-equation.

    Parameters
    ----------
    context : where it stands, with columns of its own, in which the conditions are
    conditions : one for each branch, without that of `else`
    translate : gives the drafts of a body, the checks among them left in `drafts.checks`

    Raises
    ------
    Wrong
        The branches have different numbers of equations, or do what cannot be done by halves.
    """
    guards = _guards(conditions)
    bodies: list[list[GroupDraft]] = []
    for guard, body in zip(guards, (*(b for _, b in e.branches), e.otherwise), strict=True):
        _possible(body)
        before = len(drafts.checks)
        bodies.append(translate(body))
        drafts.checks[before:] = [_guarded(context, check, guard) for check in drafts.checks[before:]]
    bodies = [_like(bodies[0], body) for body in bodies]
    rows = [sum(d.rows for d in body) for body in bodies]
    if len(set(rows)) > 1 or any([d.rows for d in b] != [d.rows for d in bodies[0]] for b in bodies):
        _report_counts(e, rows)
    for body in bodies:
        drafts.branches += body
    return [_merged(context, conditions, parts, node, e) for parts in zip(*bodies, strict=True)]


def _possible(body: tuple[tree.Equation, ...]) -> None:
    for equation in body:
        if isinstance(equation, (tree.Connect, tree.When)):
            what = "'connect'" if isinstance(equation, tree.Connect) else "'when'"
            raise Wrong("E0252", f"{what} cannot depend on a condition that changes in time", equation.span)


def _report_counts(e: tree.IfEquation, rows: list[int]) -> None:
    labels = tuple(
        Label(condition.span, f"{n} equation{'s' * (n != 1)} here")
        for (condition, _), n in zip(e.branches, rows, strict=False)
    )
    hint = "without 'else' there is nothing to determine the variables where no condition holds" * (not e.otherwise)
    raise Wrong("E0257", "the branches of this if-equation have different numbers of equations", e.branches[0][0].span,
                expected="as many in each branch, 'else' included", found=", ".join(map(str, rows)), labels=labels[1:],
                hint=hint)  # fmt: skip


def _guards(conditions: list[Value]) -> list[Expr]:
    """Return the condition under which each branch holds: its own, and none before."""
    result, left = [], dag.const(True)
    for condition in conditions:
        result.append(_and(left, condition.expr))
        left = _and(left, dag.function("not", condition.expr))
    return [*result, left]


def _and(a: Expr, b: Expr) -> Expr:
    return b if a.is_const and a.value else dag.function("and", a, b)


def _guarded(context: Context, check: CheckDraft, guard: Expr) -> CheckDraft:
    leaves, (shape,) = compact(context.leaves.items, guard)
    columns = _repeated([flat_column(leaf, context.space.shape) for leaf in leaves], context, check.rows)
    condition = dag.function("or", dag.function("not", shape), _moved(check.condition, len(columns)))
    return replace(check, condition=condition, columns=(*columns, *check.columns))


def _repeated(columns: list[Column], context: Context, rows: int) -> list[Column]:
    """Columns over the rows of the space, as columns over the rows of an equation between arrays."""
    times = rows // max(1, prod(context.space.shape))
    return [(v, np.repeat(i, times) if isinstance(i, np.ndarray) and times > 1 else i) for v, i in columns]


def _moved(shape: Expr, by: int) -> Expr:
    return dag.transform(shape, lambda n: dag.slot(n.value[0] + by, n.value[1]) if n.op == "slot" else n)


def _left(draft: GroupDraft) -> tuple | None:
    """The variable that appears alone on the left of an equation."""
    if draft.left.op != "slot" or draft.left.value[1]:
        return None
    variable, index = draft.columns[draft.left.value[0]]
    return id(variable), index.tobytes() if isinstance(index, np.ndarray) else index


def _like(first: list[GroupDraft], body: list[GroupDraft]) -> list[GroupDraft]:
    """The equations of a branch, those with the same left side as in the first branch at the same places."""
    if body is first:
        return body
    places = {_left(d): k for k, d in enumerate(first) if _left(d) is not None}
    result: list[GroupDraft | None] = [None] * max(len(first), len(body))
    rest = []
    for d in body:
        place = places.get(_left(d))
        if place is None or result[place] is not None:
            rest.append(d)
        else:
            result[place] = d
    queue = iter(rest)
    filled = [d if d is not None else next(queue, None) for d in result]
    return [d for d in filled if d is not None]


def _merged(
    context: Context, conditions: list[Value], parts: tuple[GroupDraft, ...], node: Instance, e: tree.IfEquation
) -> GroupDraft:
    """One equation from those of all branches."""
    leaves, shapes = compact(context.leaves.items, *(c.expr for c in conditions))
    columns = _repeated([flat_column(leaf, context.space.shape) for leaf in leaves], context, parts[0].rows)
    same = _left(parts[0]) is not None and len({_left(d) for d in parts}) == 1
    sides = []
    for d in parts:
        value = d.right if same else dag.sub(d.left, d.right)
        sides.append(_moved(value, len(columns)))
        columns += d.columns
    value = sides[-1]
    for condition, side in zip(reversed(shapes), reversed(sides[:-1]), strict=True):
        value = dag.if_(condition, side, value)
    first = parts[0]
    left = _moved(first.left, len(leaves)) if same else dag.ZERO
    span = first.span if same else e.span
    return GroupDraft(left, value, tuple(columns), first.rows, span, node, "equation", True)
