"""The functions of events: pre, edge, change, initial, terminal, sample (Modelica specification, 3.7.5)."""

from __future__ import annotations

from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.semantics.drafts.draft import ActionDraft, AssignmentDraft, CheckDraft, Column, compact, equality, flat_column
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Variable
from lmoc.semantics.values.builtins import arguments, builtin
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.rows import Leaf
from lmoc.semantics.values.translate import changes
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree


@builtin("pre")
def _pre(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context.unassigned, call, 1)
    return before(context, x, call)


def before(context: Context, value: Value, call: tree.Call) -> Value:
    """The left limit of variables: what they were before the present event."""
    if value.items is not None:
        return Value(None, value.dims, value.type, tuple(before(context, v, call) for v in value.items))
    variable = _variable(context, value, call)
    if variable.known:
        return value
    if variable.kind != Kind.DISCRETE and not context.in_when:
        raise Wrong(
            "E0250", f"'{call.arguments[0].span.text}' changes continuously: outside of a 'when' it has no pre()",
            call.span, expected="a variable that changes at events only",
            hint="in the body of a 'when' pre(x) is the value just before the event",
        )  # fmt: skip
    leaf = context.leaves[value.expr.value[0]]
    return Value(context.leaves.slot(context.model.drafts.helpers.pre(variable), leaf.index), value.dims, value.type)


def _variable(context: Context, value: Value, call: tree.Call) -> Variable:
    name = call.function.parts[0].name
    plain = value.expr is not None and value.expr.op == "slot" and value.expr.value[1] == 0
    variable = context.leaves[value.expr.value[0]].variable if plain else None
    if variable is None:
        raise Wrong("E0301", f"'{name}' takes a variable", call.arguments[0].span, expected="a variable",
                    found="an expression")  # fmt: skip
    return variable


@builtin("edge")
def _edge(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    if x.type != "Boolean":
        raise Wrong("E0301", "'edge' takes a Boolean variable", call.arguments[0].span, expected="Boolean",
                    found=x.type)  # fmt: skip
    (variable,) = arguments(context.unassigned, call, 1)
    return context.arrays.map(rises, x, before(context, variable, call), type="Boolean")


def rises(now: Expr, earlier: Expr) -> Expr:
    """Return whether a logical value becomes true."""
    return dag.function("and", now, dag.function("not", earlier))


@builtin("change")
def _change(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    (variable,) = arguments(context.unassigned, call, 1)
    earlier = before(context, variable, call)
    return context.arrays.map(lambda a, b: dag.function("ne", a, b), x, earlier, type="Boolean")


@builtin("initial", "terminal")
def _phase(context: Context, call: tree.Call) -> Value:
    arguments(context, call, 0)
    return phase(context, f"{call.function.parts[0].name}()")


def phase(context: Context, name: str) -> Value:
    """``initial()`` or ``terminal()``: true while the start, or the end, is computed."""
    variable = context.model.drafts.helpers.of_model(context.model.root, name)
    return Value(context.leaves.slot(variable, 0), (), "Boolean")


@builtin("sample")
def _sample(context: Context, call: tree.Call) -> Value:
    given = dict(zip(("start", "interval"), call.arguments)) | dict(call.named)
    if set(given) != {"start", "interval"} or len(call.arguments) > 2:
        raise Wrong("E0217", "'sample' takes a start and an interval", call.span, expected="sample(start, interval)")
    values = {name: context.value(e) for name, e in given.items()}
    for name, value in values.items():
        if value.dims or value.type not in ("Real", "Integer"):
            raise Wrong("E0301", f"the {name} of 'sample' must be a single number", given[name].span, found=value.type)
        if changes(context, value) and not _is_found_at_start(context, value):
            raise Wrong("E0211", f"the {name} of 'sample' must be known before the run, but changes in time",
                        given[name].span)  # fmt: skip
    if context.node is None:
        raise Wrong("E0301", "'sample' is not allowed in a function", call.span)
    drafts, space = context.model.drafts, context.space
    variable, index, slot = drafts.helpers.add(
        context.node, space, context.leaves, call.span.text, Kind.DISCRETE, "Boolean"
    )
    leaves, (interval,) = compact(context.leaves.items, values["interval"].expr)
    table = tuple(flat_column(leaf, space.shape) for leaf in leaves)
    positive = dag.function("gt", interval, dag.ZERO)
    message = f"the interval of '{call.span.text}' must be positive"
    drafts.checks.append(CheckDraft(positive, message, True, table, prod(space.shape), call.span))
    columns = {name: _known_column(context, value, f"{name} of {call.span.text}") for name, value in values.items()}
    columns["target"] = flat_column(Leaf(variable, index), space.shape)
    drafts.samples.append(ActionDraft(columns, dag.ZERO, (), prod(space.shape), call.span, context.node))
    return Value(slot, (), "Boolean")


def _is_found_at_start(context: Context, value: Value) -> bool:
    """Return whether a value depends on no more than parameters, and some that the equations of the start determine."""
    variables = [context.leaves[leaf.value[0]].variable for leaf in dag.slots(value.expr) if not leaf.value[1]]
    return not dag.depends_on_time(value.expr) and all(v is None or v.known or v.from_start for v in variables)


def _known_column(context: Context, value: Value, name: str) -> Column:
    """The parameter that a value is; an expression of parameters gets a constant of its own."""
    shape, expr = context.space.shape, value.expr
    if expr.is_const:
        return None, expr.value
    if expr.op == "slot":
        return flat_column(context.leaves[expr.value[0]], shape)
    drafts, kind = context.model.drafts, Kind.UNKNOWN if changes(context, value) else Kind.CONSTANT
    leaves, (only,) = compact(context.leaves.items, expr)
    variable, index, slot = drafts.helpers.add(context.node, context.space, context.leaves, name, kind)
    columns = tuple(flat_column(leaf, shape) for leaf in leaves)
    target = index.reshape(-1) if isinstance(index, np.ndarray) else index
    if kind == Kind.UNKNOWN:
        drafts.groups += equality(context, Value(slot), value, context.scope.definition.span, context.node, "argument")
        return flat_column(Leaf(variable, index), shape)
    drafts.bindings.append(AssignmentDraft(variable, target, only, columns, None, context.scope.library))
    return flat_column(Leaf(variable, index), shape)
