"""Calls: predefined functions, and the user's own, whose algorithms become shapes (specification, chapters 11 and 12).

The body of a function is run once, with shapes for values: an assignment renames, a loop over known numbers is
unrolled, an `if` over a variable becomes an if-expression for every variable that its branches assign.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from lmoc.diagnostics import Label, nearest
from lmoc.semantics.builtins import BUILTIN_FUNCTIONS
from lmoc.semantics.context import Context, translates
from lmoc.semantics.records import argument_fields, leaf_fields
from lmoc.semantics.scope import Builtin, Member, Scope, resolve
from lmoc.semantics.translate import choose, dims_text, iteration, sizes_differ, warn_kink
from lmoc.semantics.unit_check import has_unit
from lmoc.semantics.value import Arrays, Value, number, stack
from lmoc.semantics.wrong import Wrong
from lmoc.source import Span
from lmoc.syntax import tree

# what other languages have, and how it is written here
FOREIGN_FUNCTIONS = {
    "range": "a range is written '1:n'",
    "pow": "a power is written 'x^y'",
    "ln": "the natural logarithm is 'log(x)'",
    "len": "the length of an array is 'size(x, 1)'",
    "round": "the nearest integer is 'floor(x + 0.5)'",
    "arcsin": "it is called 'asin'",
    "arccos": "it is called 'acos'",
    "arctan": "it is called 'atan'",
    "pi": "it is a number: 'constant Real pi = 3.141592653589793;'",
}
MAX_ITERATIONS = 10_000
MAX_DEPTH = 50


@translates(tree.Call)
def call(context: Context, e: tree.Call) -> Value:
    """The (first) result of a call."""
    outputs = call_all(context, e)
    if not outputs:
        raise Wrong("E0217", f"'{e.function}' has no result", e.span)
    return outputs[0]


def call_all(context: Context, e: tree.Call) -> list[Value]:
    """All results of a call."""
    name = e.function.parts[0].name
    simple = len(e.function.parts) == 1
    own = context.scope.find(name) if simple and not e.function.absolute else None
    if not isinstance(own, Scope) and simple and name in BUILTIN_FUNCTIONS:
        return [BUILTIN_FUNCTIONS[name](context, e)]
    function = _find(context, e)
    return _Body(context, function, e).run()


def _find(context: Context, e: tree.Call) -> Scope:
    try:
        found = resolve(context.scope.find_class(e.function)).base
    except Wrong as wrong:
        if wrong.code == "E0223":
            raise Wrong("E0203", f"'{e.function}' is no function", e.function.span,
                        hint=f"subscripts stand in brackets: '{e.function}[…]'") from None  # fmt: skip
        if wrong.code != "E0202":
            raise
        name = str(e.function)
        functions = [n for n in context.scope.visible() if _is_function(context.scope.find(n))]
        last = e.function.parts[-1].name
        known = f"it is called '{last}'" if last in BUILTIN_FUNCTIONS else FOREIGN_FUNCTIONS.get(last)
        hint = known or nearest(last, [*functions, *BUILTIN_FUNCTIONS])
        raise Wrong("E0203", f"there is no function '{name}'", e.function.span, hint=hint) from None
    if not _is_function(found):
        kind = found.kind if isinstance(found, Scope) else "type"
        raise Wrong("E0203", f"'{e.function}' is a {kind}, not a function", e.function.span)
    if found.definition.partial:
        raise Wrong("E0209", f"the function '{found.name}' is partial", e.function.span)
    return found


def _is_function(found) -> bool:
    return isinstance(found, Scope) and found.kind == "function"


@dataclass(frozen=True)
class _Variable:
    """A declared variable of a function."""

    member: Member
    type: str
    role: str  # input, output, "" for a local one


class _Leave(Exception):
    """`return` or `break`."""


class _Return(_Leave):
    pass


class _Break(_Leave):
    pass


class _Body:
    """One call of a function in the making."""

    def __init__(self, context: Context, function: Scope, e: tree.Call):
        self.function = function
        self.call = e
        equations = function.definition.equations or function.definition.initial_equations
        if equations:
            raise Wrong("E0226", f"the function '{function.name}' cannot have equations", equations[0].span,
                        hint="write 'algorithm' instead of 'equation', and ':=' instead of '='")  # fmt: skip
        self.values: dict[str, Value] = {}
        self.records: dict[str, Scope] = {}  # inputs that are records: what they are
        self.declared: dict[str, _Variable] = {}
        for name, member in function.table.items():
            if isinstance(member, Member):
                self._declare(name, member)
        self.caller = context
        self.context = context.inside_function(function, self.values)
        self.context.depth = context.depth + 1
        if self.context.depth > MAX_DEPTH:
            raise Wrong("E0222", f"the function '{function.name}' calls itself without end", e.span)

    def _declare(self, name: str, member: Member) -> None:
        """A variable; a record that is an input becomes one for each of its fields."""
        base = resolve(member.scope.find_class(member.component.type)).base
        role = member.component.causality
        if isinstance(base, Builtin):
            self.declared[name] = _Variable(member, base.name, role)
            return
        if base.kind != "record" or role != "input" or member.component.dimensions:
            raise Wrong("E0230", "functions take records, but work with numbers and arrays so far",
                        member.component.span)  # fmt: skip
        self.records[name] = base
        for field, inner, type_ in leaf_fields(base):
            self.declared[f"{name}.{field}"] = _Variable(inner, type_.name, role)

    def run(self) -> list[Value]:
        """Bind the arguments, run the algorithm, collect the results."""
        inputs = self._inputs()
        lead = self._lead(inputs)
        for name, value in inputs.items():
            self.values[name] = Value(value.expr, value.dims[len(lead) :], value.type) if lead else value
        for name, variable in self.declared.items():
            if variable.role != "input":
                self._initialize(name, variable)
        try:
            for scope in self.function.lineage():
                self._statements(scope.definition.statements)
        except _Return:
            pass
        outputs = []
        for name, variable in self.declared.items():
            if variable.role == "output":
                if name not in self.values or self._has_gap(self.values[name]):
                    raise Wrong("E0222", f"the function '{self.function.name}' gives '{name}' no value",
                                variable.member.component.span)  # fmt: skip
                value = self.values[name]
                outputs.append(Value(value.expr, lead + value.dims, value.type, value.items) if lead else value)
        return outputs

    def _has_gap(self, value: Value) -> bool:
        """Whether an element of an array has never been assigned."""
        if value.items is not None:
            return any(self._has_gap(item) for item in value.items)
        return value.expr is not None and value.expr.is_const and math.isnan(value.expr.value)

    # ------------------------------------------------------------------ arguments

    def _inputs(self) -> dict[str, Value]:
        e, given = self.call, {}
        for name, argument in self._arguments():
            if name in given:
                raise Wrong("E0217", f"the argument '{name}' is given twice", e.span)
            value = self.caller.value(argument)
            self._check_type(name, value, argument.span)
            given[name] = value if self._has_unit(name) else self._of_any_unit(value)
        names = [n for n, v in self.declared.items() if v.role == "input"]
        for name in names:
            if name not in given:
                default = self.declared[name].member.component.modification
                if default is None or default.value is None:
                    raise Wrong("E0217", f"the argument '{name}' of '{self.function.name}' is missing", e.span,
                                expected=", ".join(self._formal()))  # fmt: skip
                self.values.update(given)
                given[name] = self.context.value(default.value)
        return {name: given[name] for name in names}

    def _formal(self) -> list[str]:
        """The names of the inputs, in their order."""
        members = self.function.table.items()
        return [n for n, m in members if isinstance(m, Member) and m.component.causality == "input"]

    def _arguments(self) -> Iterator[tuple[str, tree.Expression]]:
        """What the call gives to each input, records field by field."""
        names, e = self._formal(), self.call
        if len(e.arguments) > len(names):
            raise Wrong("E0217", f"'{self.function.name}' is called with {len(e.arguments)} arguments", e.span,
                        expected=", ".join(names) or "none", found=str(len(e.arguments)))  # fmt: skip
        for name, argument in [*zip(names, e.arguments), *e.named]:
            if name not in names:
                raise Wrong("E0217", f"'{self.function.name}' has no argument '{name}'", e.span,
                            hint=nearest(name, names))  # fmt: skip
            if name in self.records:
                yield from argument_fields(name, self.records[name], argument)
            else:
                yield name, argument

    def _has_unit(self, name: str) -> bool:
        component = self.declared[name].member.component
        arguments = component.modification.arguments if component.modification else ()
        return str(component.type) != "Real" or any(getattr(a, "name", ()) == ("unit",) for a in arguments)

    def _of_any_unit(self, value: Value) -> Value:
        """The argument for an input without unit: the factor of a literal makes its unit unknown."""
        leaves = self.caller.leaves
        if not value.uniform or value.type != "Real" or not has_unit(value.expr, [v.variable for v in leaves.items]):
            return value
        return Value(value.expr * leaves.slot(None, 1.0), value.dims, value.type)

    def _check_type(self, name: str, value: Value, span: Span) -> None:
        expected = self.declared[name].type
        if value.type != expected and {value.type, expected} - {"Real", "Integer"}:
            raise Wrong("E0301", f"the argument '{name}' of '{self.function.name}' must be of type {expected}", span,
                        expected=expected, found=value.type)  # fmt: skip

    def _lead(self, inputs: dict[str, Value]) -> tuple[int, ...]:
        """Dimensions by which arguments exceed the declared ones: the call is then made element by element (12.4.6)."""
        lead: tuple[int, ...] = ()
        for name, value in inputs.items():
            more = len(value.dims) - len(self.declared[name].member.component.dimensions)
            if more < 0 or (more and lead and value.dims[:more] != lead):
                raise Wrong("E0302", f"the argument '{name}' of '{self.function.name}' has the wrong size",
                            self.call.span, found=dims_text(value.dims))  # fmt: skip
            lead = value.dims[:more] or lead
        if not lead:
            return ()
        if any(not v.uniform or (v.dims and v.dims[: len(lead)] != lead) for v in inputs.values()):
            raise Wrong("E0230", "a function is applied to arrays of variables so far, not to arrays of expressions",
                        self.call.span, hint="write {f(x[i]) for i in 1:n}")  # fmt: skip
        space = self.caller.space
        for n in lead:
            space = space.with_axis(n)
        self.context.space = space
        self.context.arrays = Arrays(self.context.leaves, space.rank)
        return lead

    def _initialize(self, name: str, variable: _Variable) -> None:
        component = variable.member.component
        default = component.modification.value if component.modification else None
        if default is not None:
            self.values[name] = self.context.value(default)
        elif component.dimensions:
            sizes = [self.context.value(d) for d in component.dimensions if not isinstance(d, tree.Colon)]
            value = number(float("nan"), variable.type)  # used before it is assigned: found where it is used
            for size in reversed(sizes):
                value = stack([value] * int(self.context.scalar(size, component.span, "a size")))
            self.values[name] = value

    # ----------------------------------------------------------------- statements

    def _statements(self, statements: tuple[tree.Statement, ...]) -> None:
        for statement in statements:
            self._statement(statement)

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
            raise _Break
        elif isinstance(s, tree.CallStatement) and str(s.call.function) == "assert":
            self._assert(s)
        else:
            raise Wrong("E0230", "this statement is not available in functions yet", s.span)

    def _assert(self, s: tree.CallStatement) -> None:
        """Looked at here where the condition is known; what changes while it runs is not."""
        given = dict(zip(("condition", "message"), s.call.arguments)) | dict(s.call.named)
        if "condition" not in given or "message" not in given:
            raise Wrong("E0217", "'assert' needs a condition and a message", s.span)
        condition, message = (self.context.value(given[name]) for name in ("condition", "message"))
        if condition.type != "Boolean" or condition.dims:
            raise Wrong("E0301", "a condition must be true or false", given["condition"].span, found=condition.type)
        if not condition.expr.is_const:
            self.context.model.say_once("W0229", "this assertion is not looked at while it runs", s.span,
                                        hint="write it in the model that calls the function")  # fmt: skip
        elif not condition.expr.value:
            raise Wrong("E0222", f"'{self.function.name}' does not take this: {message.text}", self.call.span,
                        labels=(Label(s.span, "this assertion does not hold"),))  # fmt: skip

    def _assign(self, s: tree.Assignment) -> None:
        if isinstance(s.target, tree.Ref):
            self._store(s.target, self.context.value(s.value), s.span)
            return
        if not isinstance(s.value, tree.Call):
            raise Wrong("E0301", "several variables are assigned from a function call only", s.span)
        results = call_all(self.context, s.value)
        if len(s.target.items) > len(results):
            raise Wrong("E0217", f"'{s.value.function}' has {len(results)} results", s.span)
        for target, value in zip(s.target.items, results):
            if target is not None:
                self._store(target, value, s.span)

    def _store(self, target: tree.Ref, value: Value, span: Span) -> None:
        name = target.parts[0].name
        variable = self.declared.get(name)
        if variable is None or len(target.parts) > 1:
            raise Wrong("E0201", f"'{target}' is not a variable of the function", target.span,
                        hint=nearest(name, self.declared))  # fmt: skip
        if variable.role == "input":
            raise Wrong("E0222", f"the input '{name}' cannot be assigned", span)
        if value.type != variable.type and {value.type, variable.type} - {"Real", "Integer"}:
            raise Wrong("E0301", f"'{name}' is of type {variable.type}", span, expected=variable.type, found=value.type)
        subscripts = target.parts[0].subscripts
        if not subscripts:
            old = self.values.get(name)
            if old is not None and old.dims != value.dims and not _open_size(variable):
                raise sizes_differ(f"'{name}' and what is assigned", old.dims, value.dims, span)
            self.values[name] = value
            return
        if name not in self.values:
            raise Wrong("E0216", f"'{name}' is not an array that has been given a size", target.span)
        places = []
        for subscript in subscripts:
            places.append(int(self.context.scalar(self.context.value(subscript), subscript.span, "a subscript")) - 1)
        self.values[name] = self._replaced(self.values[name], places, value, target)

    def _replaced(self, array: Value, places: list[int], value: Value, target: tree.Ref) -> Value:
        if not places:
            return value
        if not array.dims:
            raise Wrong("E0216", f"'{target.parts[0].name}' has fewer dimensions", target.span)
        if not 0 <= places[0] < array.dims[0]:
            raise Wrong("E0215", f"index {places[0] + 1} of '{target.parts[0].name}' is out of range", target.span,
                        expected=f"1 … {array.dims[0]}")  # fmt: skip
        items = self.context.arrays.elements(array)
        items[places[0]] = self._replaced(items[places[0]], places[1:], value, target)
        return stack(items)

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
            warn_kink(self.context, "this if-statement", condition_tree.span, condition)
            rest = tree.IfStatement(s.branches[k + 1 :], s.otherwise, s.span)
            self._branch(condition, body, (rest,) if rest.branches else s.otherwise, condition_tree.span)
            return
        self._statements(s.otherwise)

    def _branch(self, condition: Value, then: tuple, otherwise: tuple, span: Span) -> None:
        before = dict(self.values)
        results = []
        for body in (then, otherwise):
            self.values.clear()
            self.values.update(before)
            try:
                self._statements(body)
            except _Leave:
                raise Wrong(
                    "E0222", "'return' and 'break' need a condition that is known when compiling", span
                ) from None
            results.append(dict(self.values))
        first, second = results
        self.values.clear()
        for name in first:
            if name in second:
                same = first[name] is second[name]
                self.values[name] = (
                    first[name] if same else choose(self.context, condition, first[name], second[name], span)
                )

    def _for(self, s: tree.ForStatement, k: int) -> None:
        if k == len(s.indices):
            self._statements(s.body)
            return
        index = s.indices[k]
        numbers, type_ = iteration(self.context, index, s.body)
        if len(numbers) > MAX_ITERATIONS:
            raise Wrong("E0222", f"the loop over '{index.name}' is too long to unroll", index.span)
        hidden = self.values.get(index.name)
        for x in numbers:
            self.values[index.name] = number(x, type_)
            try:
                self._for(s, k + 1)
            except _Break:
                break
        self.values.pop(index.name, None)
        if hidden is not None:
            self.values[index.name] = hidden

    def _while(self, s: tree.WhileStatement) -> None:
        for _ in range(MAX_ITERATIONS):
            condition = self.context.value(s.condition)
            if not self.context.scalar(condition, s.condition.span, "the condition of 'while'"):
                return
            try:
                self._statements(s.body)
            except _Break:
                return
        raise Wrong("E0222", f"this 'while' does not end within {MAX_ITERATIONS} rounds", s.condition.span)


def _open_size(variable: _Variable) -> bool:
    return any(isinstance(d, tree.Colon) for d in variable.member.component.dimensions)
