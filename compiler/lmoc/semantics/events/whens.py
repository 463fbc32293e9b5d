"""When-equations (Modelica specification, 8.3.5): what each branch does at the instants at which its condition rises.

A condition that becomes true makes its branch *active*: a helper variable that is true in that event iteration only. A
variable that the branches assign is then one discrete equation,
``v = if active[1] then e[1] elseif active[2] then e[2] else pre(v)``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Label, nearest
from lmoc.messages.source import Span
from lmoc.semantics.assembly.laws import law_function, misplaced
from lmoc.semantics.drafts.draft import ActionDraft, CheckDraft, Drafts, Guard, compact, equality, flat_column
from lmoc.semantics.events.functions import phase, rises
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.semantics.values.constructors import iteration
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.functions import call_all
from lmoc.semantics.values.rows import Leaf
from lmoc.semantics.values.translate import MAX_UNROLLED, changes, continuous, dims_text, sizes_differ
from lmoc.semantics.values.value import Value, number
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

CONDITION, ASSIGNED = "condition", "when"  # origins of the equations made here
STATEMENTS = ("assert", "terminate", "reinit")


@dataclass
class _Target:
    """One variable (or array of them) that a `when` assigns: what, under which guard, in which branch."""

    value: Value
    span: Span
    cases: list[tuple[Expr, Value, int]] = field(default_factory=list)


class WhenEquation:
    """Translates one when-equation.

    Parameters
    ----------
    context : where it stands, with columns of its own
    """

    def __init__(self, drafts: Drafts, node: Instance, context: Context, e: tree.When) -> None:
        self.drafts, self.node, self.context, self.e = drafts, node, context, e
        self.rows = prod(context.space.shape)
        self.targets: dict[tuple, _Target] = {}
        self.branch = 0

    def add(self) -> None:
        """Draft everything that it does."""
        earlier: list[Expr] = []
        for k, (condition, body) in enumerate(self.e.branches):
            active = self.active(condition, earlier, bool(body))
            earlier.append(active)
            self.branch = k
            inner = self.context.within(self.context.space, {})
            inner.quiet, inner.in_when = 1, True
            self._body(inner, body, active)
        for target in self.targets.values():
            self._draft(target)

    def at_start(self) -> None:
        """Draft only what it assigns at the start, which nothing changes any more: parameters."""
        inner = self.context.within(self.context.space, {})
        inner.quiet, inner.in_when = 1, True
        self._body(inner, self.e.branches[0][1], phase(self.context, "initial()").expr)
        for target in self.targets.values():
            self._draft(target)

    # --------------------------------------------------------------------- conditions

    def active(self, condition: tree.Expression, earlier: list[Expr], has_body: bool) -> Expr:
        """Return the helper that is true where a branch is carried out; `earlier` are those of the branches before."""
        if not has_body:
            self.context.model.say_once("W0318", "this branch of a 'when' does nothing", condition.span)
        rising: Expr = dag.ZERO
        at_start = False
        for part in _parts(condition):
            if isinstance(part, tree.Call) and str(part.function) == "initial" and not part.arguments:
                at_start = True
                continue
            for value in self._scalars(part):
                rising = _or(rising, self._rises(value, part))
        if not _parts(condition):
            raise Wrong("E0301", "this 'when' has no condition", condition.span)
        start = phase(self.context, "initial()").expr
        fires = _or(start, rising) if at_start else rising
        if not at_start:
            fires = both(dag.function("not", start), fires)
        elif rising is not dag.ZERO:  # what is true from the start on does not rise there
            fires = _or(start, both(dag.function("not", start), rising))
        for other in earlier:
            fires = both(dag.function("not", other), fires)
        active = self._helper(f"active when {condition.span.text}", fires, condition.span)
        columns = {"active": self._column(active)}
        text = condition.span.text.strip()
        self.drafts.whens.append(ActionDraft(columns, dag.ZERO, (), self.rows, condition.span, self.node, text))
        return active

    def _scalars(self, part: tree.Expression) -> Iterator[Value]:
        value = self.context.value(part)
        if value.type != "Boolean":
            raise Wrong("E0301", "a condition must be true or false", part.span, found=value.type)
        for scalar in self.context.arrays.scalars(value):
            if continuous(self.context, scalar):
                raise Wrong("E0251", "the condition of a 'when' must change at events only", part.span,
                            hint="leave out noEvent(…)" if "noEvent" in part.span.text else "")  # fmt: skip
            yield scalar

    def _rises(self, value: Value, part: tree.Expression) -> Expr:
        if not changes(self.context, value):
            self.context.model.say_once(
                "W0318", "this 'when' does nothing: its condition does not change", part.span,
                hint="a 'when' is executed when its condition becomes true; 'if' applies while it is true",
            )  # fmt: skip
            return dag.const(False)
        slot = value.expr
        if slot.op != "slot":
            slot = self._helper(part.span.text, value.expr, part.span)
        leaf = self.context.leaves[slot.value[0]]
        return rises(slot, self.context.leaves.slot(self.drafts.helpers.pre(leaf.variable), leaf.index))

    def _helper(self, name: str, value: Expr, span: Span) -> Expr:
        """A discrete Boolean variable with an equation of its own."""
        context = self.context
        _, _, slot = self.drafts.helpers.add(
            context.node, context.space, context.leaves, name, Kind.DISCRETE, "Boolean"
        )
        boolean = [Value(e, (), "Boolean") for e in (slot, value)]
        self.drafts.groups.extend(equality(context, *boolean, span, self.node, CONDITION))  # type: ignore[call-arg]
        return slot

    def _column(self, slot: Expr):
        return flat_column(self.context.leaves[slot.value[0]], self.context.space.shape)

    # --------------------------------------------------------------------------- bodies

    def _body(self, context: Context, body: tuple[tree.Equation, ...], guard: Expr) -> None:
        for e in body:
            if isinstance(e, tree.Equality):
                self._equality(context, e, guard)
            elif isinstance(e, tree.CallEquation):
                self.statement(context, e, guard)
            elif isinstance(e, tree.For):
                self._loop(context, e, guard, 0)
            elif isinstance(e, tree.IfEquation):
                self._if(context, e, guard)
            else:
                what = "'connect'" if isinstance(e, tree.Connect) else "another 'when'"
                raise Wrong("E0252", f"{what} is not allowed in a 'when'", e.span)

    def _loop(self, context: Context, e: tree.For, guard: Expr, k: int) -> None:
        if k == len(e.indices):
            self._body(context, e.body, guard)
            return
        index = e.indices[k]
        numbers, type_ = iteration(context, index, e.body)
        if len(numbers) > MAX_UNROLLED:
            raise Wrong("E0222", f"the loop over '{index.name}' is too long to unroll", index.span)
        for x in numbers:
            self._loop(context.within(context.space, {index.name: number(x, type_)}), e, guard, k + 1)

    def _if(self, context: Context, e: tree.IfEquation, guard: Expr) -> None:
        left = guard
        for condition_tree, body in e.branches:
            condition = context.value(condition_tree)
            if condition.type != "Boolean" or condition.dims:
                raise Wrong("E0301", "a condition must be true or false", condition_tree.span, found=condition.type)
            self._body(context, body, both(left, condition.expr))
            left = both(left, dag.function("not", condition.expr))
        self._body(context, e.otherwise, left)

    # ---------------------------------------------------------------------- assignments

    def _equality(self, context: Context, e: tree.Equality, guard: Expr) -> None:
        self.drafts.guard = Guard(guard, e.span, any(isinstance(n, tree.If) for n in walk(e.right)))
        try:
            self._assignment(context, e, guard)
        finally:
            self.drafts.guard = None

    def _assignment(self, context: Context, e: tree.Equality, guard: Expr) -> None:
        if isinstance(e.left, tree.Tuple):
            if not isinstance(e.right, tree.Call):
                raise Wrong("E0301", "only a function call can give values to several variables", e.span)
            for item, value in zip(e.left.items, call_all(context, e.right)):
                if item is not None:
                    self._assign(context, item, value, guard, e.span)
            return
        self._assign(context, e.left, context.value(e.right), guard, e.span)

    def _assign(self, context: Context, left: tree.Expression, value: Value, guard: Expr, span: Span) -> None:
        if not isinstance(left, tree.Ref):
            raise Wrong("E0253", "in a 'when' a variable is alone on the left", left.span,
                        expected="variable = expression", found=left.span.text)  # fmt: skip
        target = context.value(left)
        self._equate(context, target, value, left.span, guard, span)

    def _equate(self, context: Context, target: Value, value: Value, place: Span, guard: Expr, span: Span) -> None:
        """One assignment, of a record field by field; `place` is where its target is written."""
        if target.dims != value.dims:
            raise sizes_differ("the two sides", target.dims, value.dims, span)
        if target.fields is not None and value.fields is not None and set(target.fields) == set(value.fields):
            for name, field in target.fields.items():
                self._equate(context, field, value.fields[name], place, guard, span)
            return
        if target.fields or value.fields or target.type != value.type and (
            target.type, value.type) != ("Real", "Integer"):  # fmt: skip
            raise Wrong("E0301", f"{target.type} cannot equal {value.type}", span, expected=target.type,
                        found=value.type)  # fmt: skip
        for t, v in _pairs(context, target, value):
            self._case(context, t, v, guard, place)

    def _case(self, context: Context, target: Value, value: Value, guard: Expr, span: Span) -> None:
        leaf = context.leaves[target.expr.value[0]] if target.expr.op == "slot" else None
        if leaf is None or leaf.variable is None or leaf.variable.kind != Kind.DISCRETE:
            kind = "a parameter" if leaf and leaf.variable and leaf.variable.known else "no discrete variable"
            raise Wrong("E0253", f"'{span.text}' is {kind} and cannot be assigned in a 'when'", span)
        key = (id(leaf.variable), target.expr.value[0], target.dims)
        entry = self.targets.setdefault(key, _Target(target, span))
        if any(branch == self.branch and g is guard for g, _, branch in entry.cases):
            raise Wrong("E0254", f"'{span.text}' is assigned twice in this branch of the 'when'", span)
        entry.cases.append((guard, value, self.branch))

    def _draft(self, target: _Target) -> None:
        """The discrete equation of one variable."""
        missing = set(range(len(self.e.branches))) - {branch for _, _, branch in target.cases}
        if missing:
            where = self.e.branches[min(missing)][0].span
            name = target.span.text
            raise Wrong("E0255", f"the branches of a 'when' assign different variables: '{name}' is missing here",
                        where, hint=f"write {name} = pre({name})")  # fmt: skip
        context = self.context
        leaf = context.leaves[target.value.expr.value[0]]
        self._claim("assigned", leaf, target.span)
        result = context.leaves.slot(self.drafts.helpers.pre(leaf.variable), leaf.index)
        for guard, value, _ in reversed(target.cases):
            result = dag.if_(guard, value.expr, result)
        right = Value(result, target.value.dims, target.value.type)
        self.drafts.groups.extend(equality(context, target.value, right, target.span, self.node, ASSIGNED))

    # ----------------------------------------------------------------------- statements

    def statement(self, context: Context, e: tree.CallEquation, guard: Expr) -> None:
        """Draft ``reinit``, ``terminate`` or ``assert`` under a guard."""
        name = str(e.call.function)
        if name == "reinit":
            self._reinit(context, e, guard)
        elif name == "terminate":
            self.drafts.terminations.append(termination(context, e, guard, self.node))
        elif name == "assert":
            self.drafts.checks.append(guarded_check(context, e, guard))
        elif law_function(context, e.call) is not None:
            raise misplaced("a 'when'", e.span)
        else:
            raise Wrong("E0203", f"there is no statement '{name}'", e.call.function.span,
                        hint=nearest(name, STATEMENTS))  # fmt: skip

    def _reinit(self, context: Context, e: tree.CallEquation, guard: Expr) -> None:
        if len(e.call.arguments) != 2 or e.call.named:
            raise Wrong("E0217", "'reinit' takes a variable and its new value", e.span, expected="reinit(x, value)")
        target, value = (context.value(a) for a in e.call.arguments)
        place = e.call.arguments[0].span
        if target.dims != value.dims:
            raise sizes_differ("the arguments of 'reinit'", target.dims, value.dims, e.span)
        for t, v in _pairs(context, target, value):
            leaf = context.leaves[t.expr.value[0]] if t.expr.op == "slot" and not t.expr.value[1] else None
            if leaf is None or leaf.variable is None or leaf.variable.kind != Kind.UNKNOWN or t.type != "Real":
                raise Wrong("E0256", f"'{place.text}' is no continuous variable: 'reinit' sets states", place)
            self._claim("given a new value by 'reinit'", leaf, place)
            shape = context.space.shape + t.dims
            active = self._guard(guard, e.span)
            leaves, (expr,) = compact(context.leaves.items, v.expr)
            columns = {"guard": flat_column(context.leaves[active.value[0]], shape), "target": flat_column(leaf, shape)}
            slots = tuple(flat_column(one, shape) for one in leaves)
            self.drafts.reinits.append(ActionDraft(columns, expr, slots, prod(shape), e.span, self.node))

    def _claim(self, what: str, leaf: Leaf, span: Span) -> None:
        """A variable changes in one `when` only (8.3.5.3, 8.3.6)."""
        index = np.asarray(leaf.index)
        key = what, id(leaf.variable), index.shape, index.tobytes()
        owner, earlier = self.drafts.assigned.setdefault(key, (self.e, span))
        if owner is not self.e:
            raise Wrong("E0254", f"'{span.text}' is {what} in two 'when's", span, labels=(Label(earlier, "also here"),),
                        hint="one 'when' with 'elsewhen' says which of them counts where both happen")  # fmt: skip

    def _guard(self, guard: Expr, span: Span) -> Expr:
        return guard if guard.op == "slot" else self._helper(f"guard of {span.text}", guard, span)


def termination(context: Context, e: tree.CallEquation, guard: Expr, node: Instance) -> ActionDraft:
    """The draft of ``terminate(message)``; its shape is the guard."""
    (message,) = [context.value(a) for a in e.call.arguments] if len(e.call.arguments) == 1 else [number(0)]
    if message.type != "String":
        raise Wrong("E0217", "'terminate' takes a message", e.span, expected='terminate("…")')
    leaves, (shape,) = compact(context.leaves.items, guard)
    slots = tuple(flat_column(leaf, context.space.shape) for leaf in leaves)
    return ActionDraft({}, shape, slots, prod(context.space.shape), e.span, node, message.text)


def guarded_check(context: Context, e: tree.CallEquation, guard: Expr | None = None) -> CheckDraft:
    """The draft of ``assert(condition, message, level)``, which holds where the guard does.

    With a guard it is looked at when an event happens.
    """
    given = dict(zip(("condition", "message", "level"), e.call.arguments)) | dict(e.call.named)
    if "condition" not in given or "message" not in given:
        raise Wrong("E0217", "'assert' needs a condition and a message", e.span)
    condition = context.value(given["condition"])
    if condition.type != "Boolean" or condition.dims:
        found = dims_text(condition.dims) if condition.dims else condition.type
        raise Wrong("E0301", "a condition must be true or false", given["condition"].span, found=found)
    message = context.value(given["message"])
    if message.type != "String":
        raise Wrong("E0301", "the message of 'assert' must be a String", given["message"].span)
    error = True
    if "level" in given:
        level = context.value(given["level"])
        error = context.scalar(level, given["level"].span, "the level") == 1
    holds = condition.expr if guard is None else _or(dag.function("not", guard), condition.expr)
    leaves, (shape,) = compact(context.leaves.items, holds)
    columns = tuple(flat_column(leaf, context.space.shape) for leaf in leaves)
    rows = prod(context.space.shape)
    return CheckDraft(shape, message.text, error, columns, rows, e.span, guard is not None, context.node.owner)


def _parts(condition: tree.Expression) -> tuple[tree.Expression, ...]:
    """The conditions in ``{a, b, …}``, or the only one."""
    return condition.items if isinstance(condition, tree.Array) else (condition,)


def _pairs(context: Context, left: Value, right: Value) -> Iterator[tuple[Value, Value]]:
    """Both sides, element by element where one of them differs between the elements."""
    if left.uniform and right.uniform:
        yield left, right
        return
    for a, b in zip(context.arrays.elements(left), context.arrays.elements(right)):
        yield from _pairs(context, a, b)


def both(a: Expr, b: Expr) -> Expr:
    """Return the logical and; the second alone where the first is always true."""
    return b if a.is_const and a.value else dag.function("and", a, b)


def _or(a: Expr, b: Expr) -> Expr:
    return b if a.is_const and not a.value else dag.function("or", a, b)


def mark(context: Context, equations: tuple[tree.Equation, ...], find) -> Iterator[tuple[str, Variable]]:
    """The variables that when-equations assign ("discrete") or reinit ("state"); `find` gives those of a reference."""
    for e in equations:
        if isinstance(e, tree.When):
            for _, body in e.branches:
                yield from _marks(context, body, find)
        elif isinstance(e, tree.For):
            yield from mark(context, e.body, find)
        elif isinstance(e, tree.IfEquation):
            for body in (*(b for _, b in e.branches), e.otherwise):
                yield from mark(context, body, find)


def _marks(context: Context, body: tuple[tree.Equation, ...], find) -> Iterator[tuple[str, Variable]]:
    for e in body:
        if isinstance(e, tree.Equality):
            items = e.left.items if isinstance(e.left, tree.Tuple) else (e.left,)
            pairs = [("discrete", item) for item in items]
        elif isinstance(e, tree.CallEquation) and str(e.call.function) == "reinit":
            pairs = [("state", argument) for argument in e.call.arguments[:1]]
        elif isinstance(e, tree.For):
            yield from _marks(context, e.body, find)
            continue
        elif isinstance(e, tree.IfEquation):
            for inner in (*(b for _, b in e.branches), e.otherwise):
                yield from _marks(context, inner, find)
            continue
        else:
            continue
        for what, item in pairs:
            if isinstance(item, tree.Ref):
                for variable in find(context, item):
                    yield what, variable
