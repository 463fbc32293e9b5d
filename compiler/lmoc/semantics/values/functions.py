"""Calls of functions, predefined or the user's own: arguments and results (Modelica specification, chapter 12)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.hints import visible
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import NoClass, NotAClass, OutOfRange, Wrong
from lmoc.semantics.nodes.records import argument_fields, leaf_fields
from lmoc.semantics.values.algorithms import Algorithm, LocalVariable, in_order_of_use
from lmoc.semantics.values.builtins import BUILTIN_FUNCTIONS
from lmoc.semantics.values.context import Context, translates
from lmoc.semantics.values.dimensions import DimensionType, dimension_type, length
from lmoc.semantics.values.translate import dims_text
from lmoc.semantics.values.unit_inference import has_unit
from lmoc.semantics.values.value import Arrays, Value, number
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
    enumeration = dimension_type(context, e.function) if own is None or isinstance(own, Scope) else None
    if enumeration is not None and enumeration.first == 1:
        return [_literal(context, e, enumeration)]
    function = _find(context, e)
    return _Body(context, function, e).run()


def _literal(context: Context, e: tree.Call, enumeration: DimensionType) -> Value:
    """``E(2)``: the second literal of an enumeration (4.9.5.3)."""
    if len(e.arguments) != 1 or e.named:
        raise Wrong("E0217", f"'{e.function}' takes the number of a literal", e.span)
    x, place = context.value(e.arguments[0]), e.arguments[0].span
    if x.type != "Integer" or x.dims:
        raise Wrong("E0301", "the number of a literal is an Integer", place, found=x.type)
    n = context.whole(x, place, "the number of a literal", 1)
    if n > enumeration.length:
        raise OutOfRange("E0215", f"'{e.function}' has no literal {n}", place, expected=f"1 … {enumeration.length}")
    return number(n, enumeration.name)


def _find(context: Context, e: tree.Call) -> Scope:
    try:
        found = context.scope.find_class(e.function)
        base = resolve(found).base
    except NotAClass:
        raise Wrong("E0203", f"'{e.function}' is not a function", e.function.span,
                    hint=f"subscripts are written in brackets: '{e.function}[…]'") from None  # fmt: skip
    except NoClass:
        name = str(e.function)
        functions = [n for n in visible(context.scope) if _is_function(context.scope.find(n))]
        last = e.function.parts[-1].name
        known = f"it is called '{last}'" if last in BUILTIN_FUNCTIONS else FOREIGN_FUNCTIONS.get(last)
        hint = known or nearest(last, [*functions, *BUILTIN_FUNCTIONS])
        raise Wrong("E0203", f"there is no function '{name}'", e.function.span, hint=hint) from None
    if not _is_function(base):
        kind = base.kind if isinstance(base, Scope) else "type"
        raise Wrong("E0203", f"'{e.function}' is a {kind}, not a function", e.function.span)
    if base.definition.partial:
        raise Wrong("E0209", f"the function '{base.name}' is partial", e.function.span)
    return found


def _is_function(found) -> bool:
    return isinstance(found, Scope) and found.kind == "function"


class _Body:
    """One call of a function in the making."""

    def __init__(self, context: Context, function: Scope, e: tree.Call):
        context.model.rounds.spend(5, e.span)  # a call costs about as much
        self.function = function
        self.call = e
        equations = function.definition.equations or function.definition.initial_equations
        if equations:
            raise Wrong("E0226", f"the function '{function.name}' cannot have equations", equations[0].span,
                        hint="write 'algorithm' instead of 'equation', and ':=' instead of '='")  # fmt: skip
        self.values: dict[str, Value] = {}
        self.records: dict[str, Scope] = {}  # inputs that are records: what they are
        self.declared: dict[str, LocalVariable] = {}
        for name, member in function.table.items():
            if isinstance(member, Member):
                self._declare(name, member)
        self.caller = context
        self.context = context.inside_function(function, self.values)
        self.context.depth = context.depth + 1
        if self.context.depth > MAX_DEPTH:
            raise Wrong("E0222", f"the function '{function.name}' calls itself endlessly", e.span)

    def _declare(self, name: str, member: Member) -> None:
        """A variable; a record that is an input becomes one for each of its fields."""
        base = resolve(member.scope.find_class(member.component.type)).base
        role = member.component.causality
        if isinstance(base, Builtin):
            self.declared[name] = LocalVariable(member, base.name, role)
            return
        if base.kind != "record" or role != "input" or member.component.dimensions:
            raise Wrong("E0230", "functions take records, but work with numbers and arrays so far",
                        member.component.span)  # fmt: skip
        self.records[name] = base
        for field, inner, type_ in leaf_fields(base):
            self.declared[f"{name}.{field}"] = LocalVariable(inner, type_.name, role)

    def run(self) -> list[Value]:
        """Bind the arguments, run the algorithm, collect the results."""
        inputs = self._inputs()
        lead = self._lead(inputs)
        for name, value in inputs.items():
            self.values[name] = Value(value.expr, value.dims[len(lead) :], value.type) if lead else value
        for name in inputs:
            self._check_size(name)
        Algorithm(self.function, self.call, self.declared, self.values, self.context, call_all,
                  self._default).run()  # fmt: skip
        outputs = []
        for name, variable in self.declared.items():
            if variable.role == "output":
                if name not in self.values or self._has_gap(self.values[name]):
                    raise Wrong("E0222", f"the function '{self.function.name}' gives '{name}' no value",
                                variable.member.component.span)  # fmt: skip
                value = self.values[name]
                if name not in self.records and self._has_unit(name):
                    value = self._of_any_unit(value)  # in the declared unit: from_degC gives K
                outputs.append(Value(value.expr, lead + value.dims, value.type, value.items) if lead else value)
        return outputs

    def _has_gap(self, value: Value) -> bool:
        """Return whether an element of an array has never been assigned."""
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
        self.values.update(given)
        for name in in_order_of_use(self.function, self.declared):
            variable = self.declared[name]
            if variable.role == "input" and name not in given:
                value = self._default(variable.member)
                if value is None:
                    raise Wrong("E0217", f"the argument '{name}' of '{self.function.name}' is missing", e.span,
                                expected=", ".join(self._formal()))  # fmt: skip
                given[name] = self.values[name] = value
        return {name: given[name] for name, variable in self.declared.items() if variable.role == "input"}

    def _default(self, member: Member) -> Value | None:
        """The value with which a variable is declared; one that a modification gives is written at another place."""
        expression, scope = member.value
        if expression is None:
            return None
        if self.function.is_made_of(scope):
            return self.context.value(expression)
        caller = self.caller
        node = caller.node.around(scope) if caller.node else None
        return Context(caller.model, node, scope, caller.space, caller.leaves).value(expression)

    def _formal(self) -> list[str]:
        """The names of the inputs, in their order."""
        members = self.function.table.items()
        return [n for n, m in members if isinstance(m, Member) and m.component.causality == "input"]

    def _arguments(self) -> Iterator[tuple[str, tree.Expression]]:
        """Return the argument for each input, records field by field."""
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
        if value.type != expected and (expected, value.type) != ("Real", "Integer"):
            raise Wrong("E0301", f"the argument '{name}' of '{self.function.name}' must be of type {expected}", span,
                        expected=expected, found=value.type)  # fmt: skip

    def _check_size(self, name: str) -> None:
        """An array must be as large as its input is declared, where that is not left open."""
        declared = self.declared[name].member.component.dimensions
        found = self.values[name].dims
        what = f"the size of '{name}'"
        expected = tuple(
            n if isinstance(d, tree.Colon) else length(self.context, d, what)
            for d, n in zip(declared, found)
        )
        if found != expected:
            raise Wrong("E0302", f"the argument '{name}' of '{self.function.name}' has the wrong size", self.call.span,
                        expected=dims_text(expected), found=dims_text(found))  # fmt: skip

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
