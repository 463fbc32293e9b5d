"""Algorithm sections of models (Modelica specification, 11.1.2): statements carried out once, with shapes for values.

All variables that a section assigns begin with what they had before: discrete ones with `pre`, the others with their
start value. What the statements make of that is one equation for each of them. A `when` becomes a choice between the
values that its branch assigns and those before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.messages.source import Span
from lmoc.semantics.assembly.laws import law_function, misplaced
from lmoc.semantics.drafts.draft import Drafts, equality
from lmoc.semantics.events.whens import ASSIGNED, WhenEquation, both, guarded_check
from lmoc.semantics.mistakes.wrong import Exhausted, Wrong
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.semantics.nodes.records import field_of
from lmoc.semantics.values.algorithms import Algorithm
from lmoc.semantics.values.assigned import replaced
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.formals import LocalVariable
from lmoc.semantics.values.functions import call_all
from lmoc.semantics.values.reference import all_subscripts, named_node, named_variables
from lmoc.semantics.values.translate import choose, continuous, sizes_differ
from lmoc.semantics.values.value import Value, number, stack
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

Statements = tuple[tree.Statement, ...]


def add_algorithm(drafts: Drafts, context: Context, statements: Statements, initial: bool) -> None:
    """Draft the equations of one section; what is wrong with it is reported, and it is left out.

    Parameters
    ----------
    context : of the class that the section is in
    initial : it holds at the start only
    """
    try:
        _Section.of(drafts, context, statements, initial).add()
    except Exhausted:
        raise
    except Wrong as wrong:
        wrong.put_into(context.model.report)


def assigned(statements: Statements) -> Iterator[tree.Ref]:
    """Yield what some statements assign."""
    for node in walk(statements):
        if isinstance(node, tree.Assignment):
            items = node.target.items if isinstance(node.target, tree.Tuple) else (node.target,)
            yield from (item for item in items if item is not None)


def assigned_at_events(context: Context, statements: Statements) -> Iterator[tuple[str, Variable]]:
    """Yield variables that are assigned in a `when` ("discrete"), or set by `reinit` ("state")."""
    for when in (n for n in walk(statements) if isinstance(n, tree.WhenStatement)):
        refs = [("discrete", ref) for ref in assigned((when,))]
        calls = [n.call for n in walk((when,)) if isinstance(n, tree.CallStatement)]
        refs += [("state", c.arguments[0]) for c in calls if str(c.function) == "reinit" and c.arguments]
        for what, ref in refs:
            for variable in named_variables(context, ref) if isinstance(ref, tree.Ref) else ():
                yield what, variable


@dataclass(frozen=True, eq=False)
class _Section(Algorithm):
    """One section.

    Attributes
    ----------
    drafts : what it adds to
    statements : its text
    initial : it holds at the start only
    targets : {name: reference to the whole variable}
    guards : conditions of the branches that are being carried out
    """

    drafts: Drafts = field(kw_only=True)
    statements: Statements = field(kw_only=True)
    initial: bool = field(kw_only=True)
    targets: dict[str, tree.Ref] = field(kw_only=True, default_factory=dict)
    guards: list[Expr] = field(kw_only=True, default_factory=list)

    @classmethod
    def of(cls, drafts: Drafts, outer: Context, statements: Statements, initial: bool) -> _Section:
        values: dict[str, Value] = {}
        context = Context(outer.model, outer.node, outer.scope, outer.space, names=values)
        context.quiet = int(initial)  # relations at the start make no events
        call = tree.Call(tree.Ref((), False, statements[0].span), (), (), statements[0].span)
        return cls(
            outer.scope, call, {}, values, context, call_all, lambda member: None,
            drafts=drafts, statements=statements, initial=initial,
        )  # fmt: skip

    @property
    def node(self) -> Instance:
        return self.context.node

    def add(self) -> None:
        """Carry it out, and draft the equations of what it assigns."""
        for ref in assigned(self.statements):
            self._begin(ref)
        self._statements(self.statements)
        plain = self.context.unassigned
        groups = self.drafts.initial if self.initial else self.drafts.groups
        for name, ref in self.targets.items():
            target, variable = plain.value(ref), self._variable(ref)
            origin = ASSIGNED if variable.kind == Kind.DISCRETE and not self.initial else "equation"
            groups.extend(equality(plain, target, self.values[name], ref.span, self.node, origin))

    # ------------------------------------------------------------------ what is assigned

    def _begin(self, ref: tree.Ref) -> None:
        """Give a variable, or those of a record, the value with which the section begins."""
        for one in self._fields(ref):
            self._begin(field_of(ref, one))
        name = _name(ref)
        if name in self.targets or self._fields(ref):
            return
        variable = self._variable(ref)
        if variable.known or variable.kind == Kind.INPUT:
            what = "a parameter" if variable.known else "an input"
            raise Wrong("E0222", f"'{name}' is {what} and cannot be assigned", ref.span)
        whole = replace(ref, parts=tuple(replace(part, subscripts=()) for part in ref.parts))
        value = self.context.value(whole)
        self.targets[name] = whole
        self.declared[name] = LocalVariable(None, value.type, "")
        self.values[name] = self._earlier(value, variable, ref.span)
        self.context.assigned = frozenset(self.targets)

    def _variable(self, ref: tree.Ref) -> Variable:
        variable = named_node(self.context, ref)
        if not isinstance(variable, Variable):
            raise Wrong("E0201", f"there is no variable '{_name(ref)}' here", ref.span)
        return variable

    def _fields(self, ref: tree.Ref) -> tuple[str, ...]:
        """The fields of the record that a reference names; none of what is no record."""
        node = named_node(self.context, ref)
        return tuple(node.children) if isinstance(node, Instance) and node.kind == "record" else ()

    def _earlier(self, value: Value, variable: Variable, span: Span) -> Value:
        """The value before the section: `pre` of a discrete variable, the start value of another one."""
        if value.items is not None:
            items = tuple(self._earlier(v, variable, span) for v in value.items)
            return Value(None, value.dims, value.type, items)
        if variable.kind == Kind.DISCRETE:
            leaf = self.context.leaves[value.expr.value[0]]
            pre = self.context.leaves.slot(self.drafts.helpers.pre(variable), leaf.index)
            return Value(pre, value.dims, value.type)
        start = number(self._start(variable), value.type)
        for size in reversed(value.dims):
            start = stack([start] * size)
        return start

    def _start(self, variable: Variable) -> float:
        binding = variable.attributes.get("start")
        if binding is None:
            return 1.0 if getattr(variable.type, "literals", ()) else 0.0
        value = self.context.model.known.binding(binding)[1]
        if value.dims or not value.expr.is_const:
            return float("nan")  # where it is used, the variable has no value
        return float(value.expr.value)

    def _store(self, target: tree.Ref, value: Value, span: Span) -> None:
        fields = self._fields(target)
        if fields:
            if set(value.fields or ()) != set(fields):
                raise Wrong("E0301", f"'{target}' is a record with other fields", span, expected=", ".join(fields),
                            found=", ".join(value.fields or (value.type,)))  # fmt: skip
            for one in fields:
                self._store(field_of(target, one), value.fields[one], span)
            return
        name = _name(target)
        variable = self.declared[name]
        if value.type != variable.type and (variable.type, value.type) != ("Real", "Integer"):
            raise Wrong("E0301", f"'{name}' is of type {variable.type}", span, expected=variable.type, found=value.type)
        if self._variable(target).kind == Kind.DISCRETE and not self.context.in_when and not self.initial:
            if any(continuous(self.context, one) for one in self.context.arrays.scalars(value)):
                raise Wrong("E0251", f"'{name}' changes at events only, but this would change it between them", span,
                            hint="assign it in a 'when', or leave out noEvent(…)")  # fmt: skip
        subscripts = all_subscripts(self.context, target)
        old = self.values[name]
        if any(isinstance(s, tree.Colon) for s in subscripts):
            raise Wrong("E0230", f"part of '{name}' is assigned: one element at a time is available", target.span,
                        hint="give every dimension a subscript, in a 'for' loop")  # fmt: skip
        if subscripts:
            value = replaced(self.context, old, subscripts, value, name, span, lambda _, new: new)
        if old.dims != value.dims:
            raise sizes_differ(f"'{name}' and what is assigned", old.dims, value.dims, span)
        self.values[name] = value

    # ------------------------------------------------------------------ statements

    def _statement(self, s: tree.Statement) -> None:
        if isinstance(s, tree.WhenStatement):
            self._when(s)
        elif isinstance(s, tree.CallStatement):
            self._call(s)
        elif isinstance(s, tree.Return):
            raise Wrong("E0230", "'return' ends a function, not the algorithm of a model", s.span)
        else:
            super()._statement(s)

    def _warn(self, condition: Value, span: Span) -> None:
        """Conditions of models are events: nothing is integrated across."""

    def _in_branch(self, condition: Value, holds: bool, body: tuple) -> None:
        self.guards.append(condition.expr if holds else dag.function("not", condition.expr))
        try:
            super()._in_branch(condition, holds, body)
        finally:
            self.guards.pop()

    def _when(self, s: tree.WhenStatement) -> None:
        """Each branch runs on the values before it; at its instants these are taken."""
        if self.initial or self.context.in_when or self.guards:
            where = "an initial algorithm" if self.initial else "an 'if' or another 'when'"
            raise Wrong("E0252", f"'when' is not allowed in {where}", s.span)
        branches = tuple((condition, ()) for condition, _ in s.branches)
        when = WhenEquation(self.drafts, self.node, self.context, tree.When(branches, s.span))
        before = dict(self.values)
        chosen: list[tuple[Expr, dict[str, Value]]] = []
        for condition, body in s.branches:
            active = when.active(condition, [a for a, _ in chosen], bool(body))
            self.values.update(before)
            self.context.in_when, self.context.quiet = True, 1
            self.guards.append(active)
            try:
                self._statements(body)
            finally:
                self.context.in_when, self.context.quiet = False, 0
                self.guards.pop()
            chosen.append((active, dict(self.values)))
        self.values.update(before)
        for active, found in reversed(chosen):
            held = Value(active, (), "Boolean")
            for name in self.targets:
                if found[name] is not before[name]:
                    self.values[name] = choose(self.context, held, found[name], self.values[name], s.span)

    def _call(self, s: tree.CallStatement) -> None:
        """``assert``, and in a `when` also ``reinit`` and ``terminate``."""
        name, context = str(s.call.function), self.context
        if law_function(context, s.call) is not None:
            raise misplaced("an algorithm", s.span)
        call = tree.CallEquation(s.call, s.description, s.span)
        guard: Expr | None = None
        for one in self.guards:
            guard = one if guard is None else both(guard, one)
        if name == "assert":
            check = guarded_check(context, call, guard)
            self.drafts.checks.append(replace(check, at_events=context.in_when))
        elif context.in_when:
            WhenEquation(self.drafts, self.node, context, tree.When((), s.span)).statement(context, call, guard)
        elif name in ("reinit", "terminate"):
            raise Wrong("E0252", f"'{name}' happens at an instant: it belongs in a 'when'", s.span,
                        expected=f"when … then {name}(…); end when;")  # fmt: skip
        else:
            self._effect(s)


def _name(ref: tree.Ref) -> str:
    return ".".join(part.name for part in ref.parts)
