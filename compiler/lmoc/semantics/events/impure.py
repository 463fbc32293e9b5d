"""Numbers of a generator with a hidden state: what a call in a `when` draws, and what it leaves for the next instant.

The state is that of the whole model: discrete variables that the compiler adds, which the `when` changes where it is
carried out. Several calls would have to be put in an order that nothing in a model gives, so that there is one.
"""

from __future__ import annotations

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Label
from lmoc.messages.source import Span
from lmoc.semantics.drafts.draft import equality
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.builtins import builtin
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.generators import drawn, halves
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree

ORIGIN = "condition"  # of equations that the compiler adds at events, as `whens.CONDITION`


@builtin("__lmoc_impure_random")
def _impure_random(context: Context, call: tree.Call) -> Value:
    """The next number in (0, 1]; the argument is the state with which the generator begins."""
    drafts = context.model.drafts
    if drafts.guard is None:
        raise Wrong("E0230", "a generator with a hidden state is available in when-equations only", call.span,
                    hint="'random' of a generator takes its state and returns the next one")  # fmt: skip
    if drafts.guard.branches or context.open_ifs or context.known_ifs:
        raise Wrong("E0230", "a generator with a hidden state in a branch of an expression is not available", call.span,
                    hint="draw in an assignment of its own, in an 'if' of equations where that depends")  # fmt: skip
    if context.space.shape:
        raise Wrong("E0230", "a generator with a hidden state in an array of parts is not available yet", call.span)
    if drafts.drawn is not None:
        raise Wrong("E0230", "a second call of the generator with a hidden state is not available", call.span,
                    labels=(Label(drafts.drawn, "also here"),),
                    hint="draw once, or use generators whose states are variables")  # fmt: skip
    where, begins = drafts.guard, halves(context, call)
    drafts.drawn = where.span
    begun, had_begun = _variable(context, "the hidden generator has begun", "Boolean")
    _equation(context, where.span, "Boolean", begun, dag.function("or", where.condition, had_begun))
    names = [f"state of the hidden generator[{k}]" for k in range(1, len(begins) + 1)]
    states = [_variable(context, name, "Integer") for name in names]
    first = [_first(context, f"first {name}", value, where.span) for name, value in zip(names, begins, strict=True)]
    before = [dag.if_(had_begun, was, start) for (_, was), start in zip(states, first, strict=True)]
    found, after = drawn(before)
    for (now, was), value in zip(states, after, strict=True):
        _equation(context, where.span, "Integer", now, dag.if_(where.condition, value, was))
    return Value(found)


def _variable(context: Context, name: str, type_: str) -> tuple[Expr, Expr]:
    """A discrete variable of the model: what it is, and what it was before the event."""
    helpers, root = context.model.drafts.helpers, context.model.root
    made, index, slot = helpers.add(root, context.space, context.leaves, name, Kind.DISCRETE, type_)
    return slot, context.leaves.slot(helpers.pre(made), index)


def _first(context: Context, name: str, value: Expr, span: Span) -> Expr:
    """A number that parameters give, be it at the start only."""
    slot, _ = _variable(context, name, "Integer")
    _equation(context, span, "Integer", slot, value)
    return slot


def _equation(context: Context, span: Span, type_: str, left: Expr, right: Expr) -> None:
    one, other = Value(left, (), type_), Value(right, (), type_)
    context.model.drafts.groups.extend(equality(context, one, other, span, context.model.root, ORIGIN))
