"""Equation sections: equalities, loops, branches, checks and connects (Modelica specification, chapter 8)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import prod

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import nearest
from lmoc.semantics.assembly.laws import add_law, law_function, misplaced
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.connections.hints import connector_of_hint, connectors_hint, no_such_port, unguessed_port
from lmoc.semantics.connections.overdetermined import GRAPH_STATEMENTS, overdetermined_record
from lmoc.semantics.drafts.draft import ConnectDraft, Drafts, GroupDraft, RootDraft, equality
from lmoc.semantics.events.branches import conditional
from lmoc.semantics.events.whens import STATEMENTS, WhenEquation, guarded_check
from lmoc.semantics.mistakes.wrong import (
    Exhausted,
    NoElement,
    NotAlike,
    NotOneGroup,
    NotThere,
    RowsDiffer,
    Wrong,
    check_size,
)
from lmoc.semantics.nodes.instance import Instance, InstanceNode, Variable
from lmoc.semantics.values.constructors import iteration
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.functions import call_all
from lmoc.semantics.values.reference import element_index, find_start, locate, unknown_name
from lmoc.semantics.values.translate import MAX_UNROLLED, changes, dims_text, sizes_differ
from lmoc.semantics.values.value import Value, number
from lmoc.support.sizes import WRITTEN_OUT
from lmoc.syntax import tree
from lmoc.syntax.node import walk


class EquationSection:
    """Translates the equations of one instance into drafts."""

    def __init__(self, drafts: Drafts, node: Instance, initial: bool = False):
        self.drafts = drafts
        self.node = node
        self.groups = drafts.initial if initial else drafts.groups
        self.initial = initial
        self.quiet = int(initial)  # relations at the start make no events
        self.topology_only = False  # what says how parts are connected; mistakes are passed over
        self.noted: list[tuple[Context, tree.Connect]] | None = None  # takes connects that are not translated yet
        self.trying = 0  # loops around that can be unrolled if their rows do not make one group

    def add(self, context: Context, equation: tree.Equation) -> None:
        """Translate one equation; what is wrong with it is reported, and it is left out."""
        if self.topology_only and not _says_topology(equation):
            return
        try:
            _KINDS[type(equation)](self, context, equation)
        except NotOneGroup as wrong:
            if self.trying:
                raise
            if not self.topology_only:
                wrong.put_into(context.model.report)
        except Exhausted:
            raise
        except Wrong as wrong:
            if not self.topology_only:
                wrong.put_into(context.model.report)

    def _fresh(self, context: Context) -> Context:
        """The same place with columns of its own, the iteration variables among them."""
        fresh = Context(context.model, context.node, context.scope, context.space)
        fresh.choices = context.choices
        fresh.quiet = self.quiet
        for name, value in context.names.items():
            if value.expr.op == "slot":
                leaf = context.leaves[value.expr.value[0]]
                value = Value(fresh.leaves.slot(leaf.variable, leaf.index), (), value.type)
            fresh.names[name] = value
        return fresh

    # ------------------------------------------------------------------- equalities

    def equality(self, outer: Context, e: tree.Equality) -> None:
        """``left = right``, of numbers, arrays or records."""
        context = self._fresh(outer)
        if isinstance(e.left, tree.Tuple):
            self._several(context, e)
            return
        self._refuse_connectors(outer, e)
        try:
            left, right = context.value(e.left), context.value(e.right)
        except RowsDiffer as differ:
            for k, rows in enumerate(differ.rows):
                if len(rows):
                    inner = self._selected(outer, rows)
                    inner.choices = {**outer.choices, id(differ.expression): k}
                    self.equality(inner, e)
            return
        for one, value, sides in ((left, right, e), (right, left, replace(e, left=e.right, right=e.left))):
            if self.initial and _is_switch(context, one) and changes(context, value):
                at_start = tree.When(((sides.right, (sides,)),), e.span)
                WhenEquation(self.drafts, self.node, self._fresh(outer), at_start).at_start()
                return
        self._equate(context, left, right, e)

    def _refuse_connectors(self, context: Context, e: tree.Equality) -> None:
        """Two connectors are no records that could be equal."""
        refs = [ref for ref in (e.left, e.right) if isinstance(ref, tree.Ref)]
        starts = [(ref, start) for ref in refs if isinstance(start := find_start(context, ref), Instance)]
        nodes = [locate(context, ref, start).node for ref, start in starts]
        if len(nodes) == 2 and all(isinstance(n, Instance) and n.connector for n in nodes):
            raise Wrong("E0301", "connectors are connected, not equated", e.span,
                        hint=f"write connect({e.left}, {e.right})")  # fmt: skip

    def _equate(self, context: Context, left: Value, right: Value, e: tree.Equality) -> None:
        if left.dims != right.dims:
            raise sizes_differ("the two sides", left.dims, right.dims, e.span)
        if left.fields is not None and right.fields is not None:
            if set(left.fields) != set(right.fields):
                raise Wrong("E0301", "the two records have different fields", e.span,
                            expected=", ".join(left.fields), found=", ".join(right.fields))  # fmt: skip
            for name, field in left.fields.items():
                self._equate(context, field, right.fields[name], e)
            return
        numbers = {"Real", "Integer"}
        if left.type != right.type and not {left.type, right.type} <= numbers or left.fields or right.fields:
            raise Wrong("E0301", f"{left.type} cannot equal {right.type}", e.span,
                        expected=left.type, found=right.type)  # fmt: skip
        self.groups.extend(equality(context, left, right, e.span, self.node))

    def _several(self, context: Context, e: tree.Equality) -> None:
        if not isinstance(e.right, tree.Call):
            raise Wrong("E0301", "only a function call can give values to several variables", e.span)
        results = call_all(context, e.right)
        if len(e.left.items) > len(results):
            raise Wrong("E0217", f"'{e.right.function}' has {len(results)} results", e.span)
        for item, value in zip(e.left.items, results):
            if item is not None:
                self._equate(context, context.value(item), value, e)

    # ------------------------------------------------------------- loops and branches

    def loop(self, context: Context, e: tree.For) -> None:
        """``for`` over one or several indices."""
        self._loop(context, e, 0)

    def _loop(self, context: Context, e: tree.For, k: int) -> None:
        if k == len(e.indices):
            for equation in e.body:
                self.add(context, equation)
            return
        index = e.indices[k]
        try:
            numbers, type_ = iteration(context, index, e.body)
        except NotAlike as wrong:
            self._element_by_element(context, e, k, wrong)
            return
        if len(numbers) <= WRITTEN_OUT:
            self._unrolled(context, e, k, numbers, type_)
            return
        try:
            self._at_once(context, e, k, numbers, type_)
        except NotOneGroup as wrong:
            if len(numbers) > MAX_UNROLLED:
                wrong.put_into(context.model.report)
                return
            self._unrolled(context, e, k, numbers, type_)

    def _element_by_element(self, context: Context, e: tree.For, k: int, wrong: NotAlike) -> None:
        """The range differs between the elements of an array of parts: each goes through its own."""
        rows = prod(context.space.shape)
        if self.trying or not 1 < rows <= MAX_UNROLLED:  # the loops around are unrolled first
            raise wrong
        for row in range(rows):
            self._loop(self._selected(context, np.array([row])), e, k)

    def _unrolled(self, context: Context, e: tree.For, k: int, numbers: np.ndarray, type_: str) -> None:
        context.model.rounds.spend(len(numbers), e.indices[k].span)
        for x in numbers:
            self._loop(context.within(context.space, {e.indices[k].name: number(x, type_)}), e, k + 1)

    def _at_once(self, context: Context, e: tree.For, k: int, numbers: np.ndarray, type_: str) -> None:
        """All rounds of a loop as rows of the same groups; nothing is left behind where that fails."""
        drafts, report = self.drafts, context.model.report
        lists = [drafts.groups, drafts.initial, drafts.checks, drafts.connects, report.diagnostics]
        lists += [context.model.long_sums.sums, context.model.long_sums.variables]
        lists += [drafts.laws, drafts.helpers.variables, drafts.branches]
        lists += [drafts.whens, drafts.samples, drafts.reinits, drafts.terminations, drafts.bindings]
        before = [len(items) for items in lists]
        check_size(prod(context.space.shape) * len(numbers), "this loop", e.indices[k].span)
        axis = numbers.reshape((1,) * context.space.rank + numbers.shape)
        value = Value(context.leaves.slot(None, axis), (), type_)
        self.trying += 1
        try:
            self._loop(context.within(context.space.with_axis(len(numbers)), {e.indices[k].name: value}), e, k + 1)
        except NotOneGroup:
            for items, length in zip(lists, before):
                del items[length:]  # type: ignore[attr-defined]
            raise
        finally:
            self.trying -= 1

    def branch(self, outer: Context, e: tree.IfEquation) -> None:
        """Split the rows by conditions that are known when compiling and differ between them."""
        context = self._fresh(outer)
        conditions, e = self._open_branches(context, e)
        if any(changes(context, c) for c in conditions):
            self.groups += conditional(self.drafts, self.node, context, conditions, e, partial(self._apart, outer))
            return
        left: np.ndarray | None = None  # rows for which no condition has held so far; None: all
        for (condition_tree, body), condition in zip(e.branches, conditions):
            holds = np.asarray(context.known(condition, condition_tree.span, "the condition of an if-equation"))
            if holds.ndim < outer.space.rank:
                holds = holds.reshape(holds.shape + (1,) * (outer.space.rank - holds.ndim))
            holds = np.broadcast_to(holds, outer.space.shape).reshape(-1).astype(bool)
            left = np.ones(holds.shape, bool) if left is None else left
            self._rows(outer, np.flatnonzero(left & holds), body)
            left = left & ~holds
        if left is None:
            self._all(outer, e.otherwise)
        else:
            self._rows(outer, np.flatnonzero(left), e.otherwise)

    def _open_branches(self, context: Context, e: tree.IfEquation) -> tuple[list[Value], tree.IfEquation]:
        """The conditions up to one that is known to hold for all rows, and the branches that are left."""
        conditions: list[Value] = []
        branches = []
        for condition_tree, body in e.branches:
            condition = self._condition(context, condition_tree)
            if not changes(context, condition):
                holds = np.asarray(context.known(condition, condition_tree.span, "the condition of an if-equation"))
                if holds.ndim == 0:
                    if holds:
                        return conditions, replace(e, branches=tuple(branches), otherwise=body)
                    continue
            conditions.append(condition)
            branches.append((condition_tree, body))
        return conditions, replace(e, branches=tuple(branches))

    def _condition(self, context: Context, condition_tree: tree.Expression) -> Value:
        condition = context.value(condition_tree)
        if condition.type != "Boolean" or condition.dims:
            found = condition.type if not condition.dims else f"an array {dims_text(condition.dims)}"
            raise Wrong("E0301", "a condition must be true or false", condition_tree.span, found=found)
        return condition

    def _apart(self, context: Context, body: tuple[tree.Equation, ...]) -> list[GroupDraft]:
        """The drafts of some equations, in a list of their own."""
        around, self.groups = self.groups, []
        laws = len(self.drafts.laws)
        try:
            self._all(context, body)
            found = self.groups
        finally:
            self.groups = around
        if len(self.drafts.laws) > laws:
            raise misplaced("a branch whose condition changes in time", self.drafts.laws[-1].span)
        return found

    def _all(self, context: Context, body: tuple[tree.Equation, ...]) -> None:
        for equation in body:
            self.add(context, equation)

    def _rows(self, context: Context, rows: np.ndarray, body: tuple[tree.Equation, ...]) -> None:
        if not len(rows) or not body:
            return
        if len(rows) == prod(context.space.shape):
            self._all(context, body)
            return
        self._all(self._selected(context, rows), body)

    def _selected(self, context: Context, rows: np.ndarray) -> Context:
        """The same place, for the rows with these flat positions only."""
        inner = Context(context.model, context.node, context.scope, context.space.selected(rows), quiet=self.quiet)
        inner.choices = context.choices
        for name, value in context.names.items():
            if value.expr.op == "slot":
                leaf = context.leaves[value.expr.value[0]]
                value = Value(inner.leaves.slot(leaf.variable, context.space.pick(leaf.index, rows)), (), value.type)
            inner.names[name] = value
        return inner

    # ------------------------------------------------------------------------- connect

    def connect(self, outer: Context, e: tree.Connect) -> None:
        """``connect(a, b)``: noted for later, when all connections are known."""
        if self.initial:
            raise Wrong("E0305", "connect is not possible in an initial equation", e.span)
        context = self._fresh(outer)
        if self.noted is not None:
            self.noted.append((context, e))
            return
        ends = [self._end(context, ref) for ref in (e.left, e.right)]
        if None in ends:
            return  # one end is a conditional part that is absent: so is the connection (4.4.5)
        (left, left_index, left_dims), (right, right_index, right_dims) = ends
        if left_dims != right_dims:
            raise sizes_differ("the ends of a connect", left_dims, right_dims, e.span)
        shape = context.space.shape + left_dims
        pair = [_spread_rows(i, shape) for i in (left_index, right_index)]
        if left is right and np.any(pair[0] == pair[1]) and not self.topology_only:
            found = _round(context, int(np.flatnonzero(pair[0] == pair[1])[0]) // prod(left_dims))
            context.model.report.warning("W0314", f"'{e.left}' is connected to itself", e.span, found=found,
                                         hint="this joins nothing: perhaps another one is meant")  # fmt: skip
        self.drafts.connects.append(ConnectDraft(left, pair[0], right, pair[1], self.node, e.span))

    def _end(self, context: Context, ref: tree.Ref) -> tuple[Instance | Variable, object, tuple[int, ...]] | None:
        start = find_start(context, ref)
        if start is None and str(ref) != "time":
            raise unknown_name(context, ref)
        if not isinstance(start, InstanceNode):
            raise Wrong("E0305", f"'{ref}' is not a connector of this model", ref.span)
        try:
            located = locate(context, ref, start)
        except NotThere:
            return None
        except NoElement as wrong:
            if unguessed_port(ref, wrong):
                raise no_such_port(context, ref, start, wrong) from None
            raise
        node = located.node
        signal = isinstance(node, Variable) and (node.connector or node.causality in ("input", "output"))
        if not signal and not (isinstance(node, Instance) and node.connector):
            what = "a variable" if isinstance(node, Variable) else f"a part ({node.cls.name})"
            raise Wrong("E0305", f"'{ref}' is {what}, not a connector", ref.span, expected="a connector",
                        hint=connectors_hint(node) or connector_of_hint(node, ref))  # fmt: skip
        return node, element_index(context, located), located.dims

    # --------------------------------------------------------------------------- checks

    def check(self, outer: Context, e: tree.CallEquation) -> None:
        """``assert(condition, message, level)``, or a law."""
        function = law_function(outer, e.call)
        if function is not None:
            self._law(outer, function, e)
            return
        name = str(e.call.function)
        if name in GRAPH_STATEMENTS:
            self._graph_statement(outer, e.call)
            return
        if name in ("reinit", "terminate"):
            raise Wrong("E0252", f"'{name}' happens at an instant: it belongs in a 'when'", e.span,
                        expected=f"when … then {name}(…); end when;")  # fmt: skip
        if name != "assert":
            raise Wrong("E0203", f"there is no statement '{name}'", e.call.function.span,
                        hint=nearest(name, ("connect", *STATEMENTS)))  # fmt: skip
        context = self._fresh(outer)
        context.quiet = 1  # a check is not integrated over
        self.drafts.checks.append(guarded_check(context, e))

    def _graph_statement(self, outer: Context, call: tree.Call) -> None:
        """``Connections.root(a.R)``, ``Connections.potentialRoot(a.R, priority)``, ``Connections.branch(a.R, b.R)``."""
        kind = call.function.parts[-1].name
        context, arguments = self._fresh(outer), list(call.arguments)
        priority, given = 0, dict(call.named)
        if kind == "potentialRoot" and (len(arguments) == 2 or "priority" in given):
            second = arguments.pop() if len(arguments) == 2 else given.pop("priority")
            priority = context.whole(context.value(second), second.span, "the priority of a root")
        if given or len(arguments) != (2 if kind == "branch" else 1):
            takes = "two records" if kind == "branch" else "a record"
            raise Wrong("E0217", f"'{call.function}' takes {takes}", call.span)
        ends = [self._overdetermined(context, one, call) for one in arguments]
        (left, at), (right, there) = ends[0], ends[-1]
        self.drafts.roots.append(
            RootDraft(kind, left, at, right if kind == "branch" else None, there, priority, call.span)
        )

    def _overdetermined(self, context: Context, e: tree.Expression, call: tree.Call) -> tuple[Instance, np.ndarray]:
        node, index = overdetermined_record(context, e, call)
        return node, _spread_rows(index, context.space.shape)

    def _law(self, outer: Context, function: Scope, e: tree.CallEquation) -> None:
        if self.initial:
            raise misplaced("an initial equation", e.span)
        add_law(self.drafts, self._fresh(outer), function, e)

    def when(self, outer: Context, e: tree.When) -> None:
        """``when condition then … elsewhen … end when``."""
        if self.initial:
            raise Wrong("E0252", "'when' is not allowed in an initial equation: it acts after the start", e.span)
        WhenEquation(self.drafts, self.node, self._fresh(outer), e).add()


def _is_switch(context: Context, value: Value) -> bool:
    """Return whether a value is a parameter that is no real number and gets its value from the start."""
    if value.expr is None or value.expr.op != "slot" or value.expr.value[1]:
        return False
    variable = context.leaves[value.expr.value[0]].variable
    return variable is not None and variable.from_start and variable.kind == Kind.DISCRETE


def _says_topology(equation: tree.Equation) -> bool:
    """Return whether an equation says, or has one inside that says, how parts are connected."""
    return any(
        isinstance(n, tree.Connect) or (isinstance(n, tree.CallEquation) and str(n.call.function) in GRAPH_STATEMENTS)
        for n in walk((equation,))
    )


_KINDS = {
    tree.Equality: EquationSection.equality,
    tree.For: EquationSection.loop,
    tree.IfEquation: EquationSection.branch,
    tree.Connect: EquationSection.connect,
    tree.CallEquation: EquationSection.check,
    tree.When: EquationSection.when,
}


def _spread_rows(index, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(index)
    if array.ndim < len(shape):
        array = array.reshape(array.shape + (1,) * (len(shape) - array.ndim))
    return np.broadcast_to(array, shape).reshape(-1)


def _round(context: Context, row: int) -> str:
    """``i = 1, j = 2``: the values of the iteration variables in a row; empty outside of loops."""
    values = []
    for name, value in context.names.items():
        index = context.leaves[value.expr.value[0]].index if value.expr.op == "slot" else value.expr.value
        values.append(f"{name} = {np.ravel(context.space.pick(index, np.array([row])))[0]:g}")
    return ", ".join(values)
