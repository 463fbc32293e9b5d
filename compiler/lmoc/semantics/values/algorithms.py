"""Algorithms of functions, carried out once with shapes for values (Modelica specification, chapter 11).

An assignment renames, a loop over known numbers is unrolled, an `if` over a variable becomes an if-expression for every
variable that its branches assign.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field

from lmoc.expression import dag
from lmoc.messages.diagnostics import Label, Subject, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import CallsItself, Exhausted, NotAlike, NotKnown, TooDeep, Wrong
from lmoc.semantics.values.assigned import check_type, with_part
from lmoc.semantics.values.builtins import BUILTIN_FUNCTIONS
from lmoc.semantics.values.constructors import iteration
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.formals import LocalVariable, in_order_of_use, mismatch, nothing, widened
from lmoc.semantics.values.translate import changes, choose, sizes_differ, warn_kink
from lmoc.semantics.values.value import Value, from_numbers, number, record, stack
from lmoc.support.records import dataclass
from lmoc.syntax import tree

MAX_ITERATIONS = 10_000
_RETURNED, _BROKEN = "return;", "break;"  # whether that has been met, beside the values: no variable has these names


class _Leave(Exception):
    """`return` or `break`."""


class _Return(_Leave):
    pass


class _Break(_Leave):
    pass


@dataclass(frozen=True, eq=False)
class Algorithm:
    """The statements of one call of a function.

    Attributes
    ----------
    function : its class
    call : where it is called
    declared : its variables, by name
    values : what they are so far: first the inputs, at the end the outputs as well
    context : where its statements stand
    call_all : gives all results of a call inside it
    default : gives the value with which a variable is declared, None where it has none
    """

    function: Scope
    call: tree.Call
    declared: dict[str, LocalVariable]
    values: dict[str, Value]
    context: Context
    call_all: Callable[[Context, tree.Call], list[Value]]

    default: Callable[[Member], Value | None]
    loops: list[tree.Statement] = field(default_factory=list)  # around the statement that is being carried out

    def run(self) -> None:
        """Carry it out, on `values`."""
        for name in in_order_of_use(self.function):
            if self.declared[name].role != "input":
                self._initialize(name, self.declared[name])
        try:
            for scope in self.function.lineage():
                self.context.scope = scope
                self._statements(scope.definition.statements)
                if scope.definition.external is not None:
                    self._builtin(scope.definition.external)
        except _Return:
            return
        finally:
            self.context.scope = self.function

    def _builtin(self, body: tree.External) -> None:
        """``external "builtin"``: the result is that of a function which lmo has itself (12.9)."""
        outputs = [name for name, variable in self.declared.items() if variable.role == "output"]
        inputs = [name for name, variable in self.declared.items() if variable.role == "input"]
        function = body.call.function if body.call is not None else name_ref(self.function.name, body.span)
        arguments = tuple(name_ref(name, body.span) for name in inputs)
        call = body.call or tree.Call(function, arguments, (), body.span)
        handler = BUILTIN_FUNCTIONS.get(str(function) if body.call is not None else self.function.name)
        if handler is None or len(outputs) != 1:
            what = "needs one output" if handler else f"there is no '{function.parts[-1].name}' in lmo"
            raise Wrong("E0203", f"'{self.function.name}' is not built in: {what}", body.span,
                        hint=nearest(function.parts[-1].name, BUILTIN_FUNCTIONS))  # fmt: skip
        self._store(body.target or name_ref(outputs[0], body.span), handler(self.context, call), body.span)

    def _initialize(self, name: str, variable: LocalVariable) -> None:
        value = self.default(variable.member)
        if value is None:
            value = nothing(self.context, variable, self.function)
        if value is not None:
            check_type(name, mismatch(variable, value), variable.member.component.span)
            self.values[name] = widened(variable, value)

    def _statements(self, statements: tuple[tree.Statement, ...]) -> None:
        for k, statement in enumerate(statements):
            self._statement(statement)
            for mark, leave in ((_RETURNED, _Return), (_BROKEN, _Break)):
                left = self.values.get(mark)
                if left is None:
                    continue
                if left.expr.is_const and left.expr.value:
                    raise leave
                if not left.expr.is_const and k + 1 < len(statements):  # the rest is for those who have not left
                    stays = Value(dag.function("not", left.expr), (), "Boolean")
                    self._either(stays, statements[k + 1 :], (), statement.span)
                    return

    def _statement(self, s: tree.Statement) -> None:
        if isinstance(s, tree.Assignment):
            self._assign(s)
        elif isinstance(s, tree.IfStatement):
            self._if(s)
        elif isinstance(s, tree.ForStatement):
            self._for(s, 0)
        elif isinstance(s, tree.WhileStatement):
            self._while(s)
        elif isinstance(s, tree.Return):
            raise _Return
        elif isinstance(s, tree.Break):
            if not self.loops:
                raise Wrong("E0252", "'break' ends a loop, and there is none around it", s.span)
            raise _Break
        elif isinstance(s, tree.CallStatement) and str(s.call.function) == "assert":
            self._assert(s)
        elif isinstance(s, tree.CallStatement):
            self._effect(s)
        else:
            raise Wrong("E0230", "this statement is not available in functions yet", s.span)

    def _effect(self, s: tree.CallStatement) -> None:
        """A function without results, which is called for its assertions."""
        if self.call_all(self.context, s.call):
            raise Wrong("E0203", f"'{s.call.function}' has no effect: its results are assigned to nothing", s.span)

    def _assert(self, s: tree.CallStatement) -> None:
        """Looked at here where the condition is known; what changes while it runs is not."""
        given = dict(zip(("condition", "message", "level"), s.call.arguments)) | dict(s.call.named)
        if "condition" not in given or "message" not in given:
            raise Wrong("E0217", "'assert' needs a condition and a message", s.span)
        condition, message = (self.context.value(given[name]) for name in ("condition", "message"))
        if condition.type != "Boolean" or condition.dims:
            raise Wrong("E0301", "a condition must be true or false", given["condition"].span, found=condition.type)
        if not condition.expr.is_const or (self.context.open_ifs and not condition.expr.value):
            self.context.model.say_once("W0229", "this assertion is not checked while it runs", s.span,
                                        hint="write it in the model that calls the function",
                                        subject=Subject.WRITING)  # fmt: skip
        elif not condition.expr.value and self._is_warning(given):
            self.context.model.say_once("W0229", message.text, s.span, hint=f"told of a call of '{self.function.name}'")
        elif not condition.expr.value:
            raise Wrong("E0222", f"'{self.function.name}' does not take this: {message.text}", self.call.span,
                        labels=(Label(s.span, "this assertion does not hold"),))  # fmt: skip

    def _is_warning(self, given: Mapping[str, tree.Expression]) -> bool:
        if "level" not in given:
            return False
        value = self.context.value(given["level"])
        return self.context.scalar(value, given["level"].span, "the level") != 1

    def _assign(self, s: tree.Assignment) -> None:
        if isinstance(s.target, tree.Ref):
            self._store(s.target, self.context.value(s.value), s.span)
            return
        if not isinstance(s.value, tree.Call):
            raise Wrong("E0301", "only a function call can assign several variables", s.span)
        results = self.call_all(self.context, s.value)
        if len(s.target.items) > len(results):
            raise Wrong("E0217", f"'{s.value.function}' has {len(results)} results", s.span)
        for target, value in zip(s.target.items, results):
            if target is not None:
                self._store(target, value, s.span)

    def _store(self, target: tree.Ref, value: Value, span: Span) -> None:
        name = target.parts[0].name
        variable = self.declared.get(name)
        if variable is None or (len(target.parts) > 1 and variable.record is None):
            raise Wrong("E0201", f"'{target}' is not a variable of the function", target.span,
                        hint=nearest(name, self.declared))  # fmt: skip
        if variable.role == "input":
            raise Wrong("E0222", f"the input '{name}' cannot be assigned", span)
        if len(target.parts) == 1 and not target.parts[0].subscripts:
            check_type(name, mismatch(variable, value), span)
            old = self.values.get(name)
            if old is not None and old.dims != value.dims and not variable.open_size:
                raise sizes_differ(f"'{name}' and what is assigned", old.dims, value.dims, span)
            self.values[name] = widened(variable, value)
            return
        if name not in self.values:
            raise Wrong("E0216", f"'{name}' is not an array that has been given a size", target.span)
        self.values[name] = with_part(self.context, self.values[name], target.parts, 0, value, span)

    def _if(self, s: tree.IfStatement) -> None:
        """Each branch runs on a copy of the values; where the condition is open, if-expressions join them."""
        for k, (condition_tree, body) in enumerate(s.branches):
            condition = self.context.value(condition_tree)
            if condition.type != "Boolean" or condition.dims:
                raise Wrong("E0301", "a condition must be true or false", condition_tree.span, found=condition.type)
            if condition.expr.is_const:
                if condition.expr.value:
                    self._statements(body)
                    return
                continue
            rest = tree.IfStatement(s.branches[k + 1 :], s.otherwise, s.span)
            otherwise = (rest,) if rest.branches else s.otherwise
            if changes(self.context, condition):
                self._warn(condition, condition_tree.span)
            self._either(condition, body, otherwise, condition_tree.span)
            return
        self._statements(s.otherwise)

    def _either(self, condition: Value, then: tuple, otherwise: tuple, span: Span) -> None:
        """Carry out what a condition chooses that is open."""
        if changes(self.context, condition):
            self._branch(condition, then, otherwise, span)
        else:
            self._known_branch(condition, then, otherwise, span)

    def _known_branch(self, condition: Value, then: tuple, otherwise: tuple, span: Span) -> None:
        """Parameters decide: both branches are kept where both make sense, else that which these values take.

        So it is where the function calls itself in one of them: that would have no end, or grow with each call.
        """
        before = dict(self.values)
        level = self.context.known_ifs
        self.context.known_ifs += 1
        try:
            self._branch(condition, then, otherwise, span)
        except (Exhausted, TooDeep):
            raise
        except Wrong as wrong:
            if isinstance(wrong, CallsItself) and wrong.level != level:
                raise
            self.context.known_ifs = level
            self.values.clear()
            self.values.update(before)
            holds = self.context.scalar(condition, span, "the condition of this 'if'")
            self._statements(then if holds else otherwise)
        finally:
            self.context.known_ifs = level

    def _branch(self, condition: Value, then: tuple, otherwise: tuple, span: Span) -> None:
        """Carry out both branches, and join their values; `return` and `break` in one of them are values as well."""
        before = dict(self.values)
        results = []
        left: set[str] = set()
        decided = int(changes(self.context, condition))  # by the run
        for body, holds in ((then, True), (otherwise, False)):
            self.values.clear()
            self.values.update(before)
            self.context.open_ifs += decided
            try:
                self._in_branch(condition, holds, body)
            except _Leave as leave:
                mark = _RETURNED if isinstance(leave, _Return) else _BROKEN
                self.values[mark] = number(True, "Boolean")
            finally:
                self.context.open_ifs -= decided
            results.append(dict(self.values))
            left |= {mark for mark in (_RETURNED, _BROKEN) if mark in self.values}
        for result in results:
            for mark in left:
                result.setdefault(mark, number(False, "Boolean"))
        first, second = results
        self.values.clear()
        for name in (*first, *(n for n in second if n not in first)):
            a, b = first.get(name), second.get(name)
            if a is None or b is None:
                if not left:
                    continue  # without a value in one of the branches, it has none
                a, b = (self._nothing_like(b) if a is None else a), (self._nothing_like(a) if b is None else b)
            self.values[name] = a if a is b else choose(self.context, condition, a, b, span)

    def _nothing_like(self, value: Value) -> Value:
        """No value, in the place of one that a branch has not given before it was left."""
        return self.context.arrays.map(lambda _: dag.const(math.nan), value, type=value.type)

    def _in_branch(self, condition: Value, holds: bool, body: tuple) -> None:
        """Carry out the statements of a branch whose condition is open."""
        self._statements(body)

    def _warn(self, condition: Value, span: Span) -> None:
        warn_kink(self.context, "this if-statement", span, condition)

    def _for(self, s: tree.ForStatement, k: int) -> None:
        if k == len(s.indices):
            self._statements(s.body)
            return
        index = s.indices[k]
        numbers, type_ = iteration(self.context, index, s.body)
        if len(numbers) > MAX_ITERATIONS:
            raise Wrong("E0222", f"the loop over '{index.name}' is too long to unroll", index.span)
        hidden = self.values.get(index.name)
        around = self.values.pop(_BROKEN, None)
        self.loops.append(s)
        for x in numbers:
            self.context.model.rounds.spend(1, index.span)
            self.values[index.name] = number(x, type_)
            try:
                self._round(s, k + 1)
            except _Break:
                break
        self.loops.pop()
        self.values.pop(_BROKEN, None)
        if around is not None:
            self.values[_BROKEN] = around
        self.values.pop(index.name, None)
        if hidden is not None:
            self.values[index.name] = hidden

    def _round(self, s: tree.ForStatement, k: int) -> None:
        """One round of a loop, for those who have not left it."""
        left = [v.expr for mark in (_BROKEN, _RETURNED) if (v := self.values.get(mark)) is not None]
        open_ones = [e for e in left if not e.is_const]
        if not open_ones:
            self._for(s, k)
            return
        gone = open_ones[0] if len(open_ones) == 1 else dag.function("or", *open_ones)
        inner = s.body if k == len(s.indices) else (tree.ForStatement(s.indices[k:], s.body, s.span),)
        self._either(Value(dag.function("not", gone), (), "Boolean"), inner, (), s.indices[0].span)

    def _while(self, s: tree.WhileStatement) -> None:
        self.values.update({name: self._in_numbers(value, s.condition.span) for name, value in self.values.items()})
        self.loops.append(s)
        try:
            self._repeat(s)
        finally:
            self.loops.pop()

    def _repeat(self, s: tree.WhileStatement) -> None:
        for _ in range(MAX_ITERATIONS):
            self.context.model.rounds.spend(1, s.condition.span)
            condition = self.context.value(s.condition)
            if not self.context.scalar(condition, s.condition.span, "the condition of 'while'"):
                return
            try:
                self._statements(s.body)
            except _Break:
                self.values.pop(_BROKEN, None)
                return
            if _BROKEN in self.values or _RETURNED in self.values:
                message = "'return' and 'break' in a 'while' need a condition that is known when compiling"
                raise Wrong("E0222", message, s.condition.span)
        raise Wrong("E0222", f"this 'while' does not end within {MAX_ITERATIONS} iterations", s.condition.span)

    def _in_numbers(self, value: Value, span: Span) -> Value:
        """What parameters decide, as numbers: how often a loop runs depends on it, and its branches do not pile up."""
        if value.fields is not None:
            fields = {name: self._in_numbers(field, span) for name, field in value.fields.items()}
            return record(fields, value.dims, value.type)
        if value.items is not None:
            return stack([self._in_numbers(item, span) for item in value.items], value.dims[1:], value.type)
        if value.type == "String" or value.expr.is_const:
            return value
        try:
            return from_numbers(self.context.alike(value, span), value.type)
        except (NotKnown, NotAlike):
            return value


def name_ref(name: str, span: Span) -> tree.Ref:
    """A reference to a name, in the place of something else."""
    return tree.Ref((tree.RefPart(name, (), span),), False, span)
