"""Calls of functions, predefined or the user's own: arguments and results (Modelica specification, chapter 12)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial, reduce

import numpy as np

from lmoc.expression import dag
from lmoc.messages.diagnostics import Diagnostic, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.hints import visible
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import CallsItself, NoClass, NotAClass, OutOfRange, TooDeep, Wrong
from lmoc.semantics.nodes.instance import Instance, InstanceNode
from lmoc.semantics.values.algorithms import Algorithm
from lmoc.semantics.values.builtins import BUILTIN_FUNCTIONS
from lmoc.semantics.values.context import Context, translates
from lmoc.semantics.values.dimensions import DimensionType, dimension_type
from lmoc.semantics.values.formals import declared_in, has_gap, in_order_of_use, mismatch, sizes, widened
from lmoc.semantics.values.given_rates import with_rates
from lmoc.semantics.values.reference import find_start, step
from lmoc.semantics.values.translate import changes, choose, dims_text
from lmoc.semantics.values.unit_inference import has_unit, unit_of, unit_of_value
from lmoc.semantics.values.value import Arrays, Value, number, record, stack
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
    dotted = ".".join(part.name for part in e.function.parts)
    if not isinstance(own, Scope) and (simple or name == "Connections") and dotted in BUILTIN_FUNCTIONS:
        return [BUILTIN_FUNCTIONS[dotted](context, e)]
    enumeration = dimension_type(context, e.function) if own is None or isinstance(own, Scope) else None
    if enumeration is not None and enumeration.first == 1:
        return [_literal(context, e, enumeration)]
    home = _part_with_function(context, e.function)
    return _Body(context, _find(context, e, home), e, home).run()


def apply(context: Context, function: Scope, values: list[Value], e: tree.Call) -> list[Value]:
    """All results of a function for the values of all of its inputs, as if it were called by `e`."""
    return _Body(context, function, e).applied(values)


def _literal(context: Context, e: tree.Call, enumeration: DimensionType) -> Value:
    """``E(2)``: the second literal of an enumeration (4.9.5.3); no value where a number that changes is beyond them."""
    if len(e.arguments) != 1 or e.named:
        raise Wrong("E0217", f"'{e.function}' takes the number of a literal", e.span)
    x, place = context.value(e.arguments[0]), e.arguments[0].span
    if x.type != "Integer" or x.dims:
        raise Wrong("E0301", "the number of a literal is an Integer", place, found=x.type)
    if changes(context, x):
        own = (dag.function("eq", x.expr, dag.const(k + 1)) for k in range(enumeration.length))
        there = Value(reduce(partial(dag.function, "or"), own), (), "Boolean")
        return choose(context, there, Value(x.expr, (), enumeration.name), number(np.nan, enumeration.name), e.span)
    n = context.whole(x, place, "the number of a literal", 1)
    if n > enumeration.length:
        raise OutOfRange("E0215", f"'{e.function}' has no literal {n}", place, expected=f"1 … {enumeration.length}")
    return number(n, enumeration.name)


def _part_with_function(context: Context, name: tree.Ref) -> Instance | None:
    """``world.gravity(…)``: the part in whose class a function stands (5.3.2); None where the name begins otherwise."""
    if len(name.parts) < 2 or name.absolute or context.node is None:
        return None
    node = find_start(context, name)
    if not isinstance(node, InstanceNode):
        return None
    for part in name.parts[1:-1]:
        node = step(context, node, part)
    if not isinstance(node, Instance):
        raise Wrong("E0203", f"'{name}' is not a function", name.span)
    if node.total:
        raise Wrong("E0230", f"'{node.label}' is in an array: functions of such parts are not available yet", name.span)
    return node


def _find(context: Context, e: tree.Call, home: Instance | None) -> Scope:
    try:
        last = replace(e.function, parts=e.function.parts[-1:])
        found = context.scope.find_class(e.function) if home is None else home.cls.find_class(last)
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
    if not _is_function(base) and not (isinstance(base, Scope) and base.kind == "record"):
        kind = base.kind if isinstance(base, Scope) else "type"
        raise Wrong("E0203", f"'{e.function}' is a {kind}, not a function", e.function.span)
    if base.definition.partial:
        raise Wrong("E0209", f"the function '{base.name}' is partial", e.function.span)
    return found


def _is_function(found) -> bool:
    return isinstance(found, Scope) and found.kind == "function"


def _with_lead(value: Value, lead: tuple[int, ...]) -> Value:
    """A result of a call that was made for all elements of arrays at once, with the dimensions of these."""
    if not lead:
        return value
    if value.fields is not None:
        fields = {name: _with_lead(field, lead) for name, field in value.fields.items()}
        return record(fields, lead + value.dims, value.type)
    return Value(value.expr, lead + value.dims, value.type, value.items)


class _Body:
    """One call of a function in the making."""

    def __init__(self, context: Context, function: Scope, e: tree.Call, home: Instance | None = None):
        context.model.rounds.spend(5, e.span)  # a call costs about as much
        self.function = function
        self.call = e
        equations = function.definition.equations or function.definition.initial_equations
        if equations:
            raise Wrong("E0226", f"the function '{function.name}' cannot have equations", equations[0].span,
                        hint="write 'algorithm' instead of 'equation', and ':=' instead of '='")  # fmt: skip
        self.values: dict[str, Value] = {}
        self.makes_record = resolve(function).base.kind == "record"
        self.declared = declared_in(function)
        self.caller = context
        self.home = home if home is not None else context.node
        self.context = context.inside_function(function, self.values)
        self.context.depth = context.depth + 1
        self._enter()

    def _enter(self) -> None:
        """Refuse a recursion that does not end, or that stands in branches of which parameters choose one."""
        name, text, around = self.function.name, id(self.function.definition), self.context.entered
        last = around.get(text)
        if self.context.depth > MAX_DEPTH:
            what = f"'{name}' calls itself" if last is not None else f"calls of functions within '{name}' go on"
            raise TooDeep("E0222", f"{what} more than {MAX_DEPTH} deep", self.call.span,
                          hint="constants and parameters must decide where a recursion ends")  # fmt: skip
        if last is not None and self.context.known_ifs > last:
            message = f"how often '{name}' calls itself differs between the elements of an array"
            raise CallsItself(last, message, self.call.span)
        self.context.entered = {**around, text: self.context.known_ifs}

    def run(self) -> list[Value]:
        """Bind the arguments, run the algorithm, collect the results."""
        return self._applied(self._inputs())

    def applied(self, values: list[Value]) -> list[Value]:
        """As `run`, for these arguments."""
        return self._applied(dict(zip(self._formal(), values, strict=True)))

    def _applied(self, inputs: dict[str, Value]) -> list[Value]:
        lead = self._lead(inputs)
        if lead and any(not v.uniform or v.fields is not None for v in inputs.values()):
            return self._one_by_one(inputs, lead[0])
        self.values.clear()
        for name, value in inputs.items():
            self.values[name] = Value(value.expr, value.dims[len(lead) :], value.type) if lead else value
        for name in inputs:
            self._check_size(name)
        Algorithm(self.function, self.call, self.declared, self.values, self.context, call_all,
                  self._default).run()  # fmt: skip
        if self.makes_record:
            found = record({name: self.values[name] for name in self.declared}, (), resolve(self.function).base.name)
            return [_with_lead(found, lead)]
        outputs = [self._output(n) for n, v in self.declared.items() if v.role == "output"]
        given = {name: self.values[name] for name in inputs}
        outputs = with_rates(self.context, self.function, self.declared, given, outputs, self._again)
        return [_with_lead(output, lead) for output in outputs]

    def _again(self, function: Scope, values: list[Value]) -> list[Value]:
        return _Body(self.context, function, self.call, self.home).applied(values)

    def _one_by_one(self, inputs: dict[str, Value], count: int) -> list[Value]:
        """Results of a call with arrays whose elements are different expressions, for each element by itself."""
        arrays, results = self.caller.arrays, []
        longer = {n for n, v in inputs.items() if len(v.dims) > len(self.declared[n].dimensions)}
        for k in range(count):
            self.caller.model.rounds.spend(5, self.call.span)
            results.append(self._applied({n: arrays.element(v, k) if n in longer else v for n, v in inputs.items()}))
        return [stack(items) for items in zip(*results)]

    def _output(self, name: str) -> Value:
        if name not in self.values or has_gap(self.values[name]):
            raise Wrong("E0222", f"the function '{self.function.name}' gives '{name}' no value",
                        self.declared[name].member.component.span)  # fmt: skip
        value = self.values[name]
        return self._of_any_unit(value) if self._has_unit(name) else value  # in the declared unit: from_degC gives K

    # ------------------------------------------------------------------ arguments

    def _inputs(self) -> dict[str, Value]:
        e, given = self.call, {}
        for name, argument in self._arguments():
            if name in given:
                raise Wrong("E0217", f"the argument '{name}' is given twice", e.span)
            value = self.caller.value(argument)
            self._check_type(name, value, argument.span)
            self._check_unit(name, value, argument.span)
            value = widened(self.declared[name], value)
            given[name] = value if self._has_unit(name) else self._of_any_unit(value)
        self.values.update(given)
        for name in in_order_of_use(self.function):
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
        node = self.home.around(scope) if self.home else None
        return Context(caller.model, node, scope, caller.space, caller.leaves).value(expression)

    def _formal(self) -> list[str]:
        """The names of the inputs, in their order."""
        return [name for name, variable in self.declared.items() if variable.role == "input"]

    def _arguments(self) -> Iterator[tuple[str, tree.Expression]]:
        """Return the argument for each input that is given one."""
        names, e = self._formal(), self.call
        if len(e.arguments) > len(names):
            raise Wrong("E0217", f"'{self.function.name}' is called with {len(e.arguments)} arguments", e.span,
                        expected=", ".join(names) or "none", found=str(len(e.arguments)))  # fmt: skip
        for name, argument in [*zip(names, e.arguments), *e.named]:
            if name not in names:
                if name in self.declared and self.makes_record:
                    kind = "final" if self.declared[name].member.component.final else "a constant"
                    raise Wrong("E0206", f"'{name}' is {kind} in the record '{self.function.name}' and cannot be given",
                                argument.span)  # fmt: skip
                raise Wrong("E0217", f"'{self.function.name}' has no argument '{name}'", e.span,
                            hint=nearest(name, names))  # fmt: skip
            yield name, argument

    def _has_unit(self, name: str) -> bool:
        if self.declared[name].record is not None:
            return True
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
        wrong = mismatch(self.declared[name], value)
        if wrong is not None:
            raise Wrong("E0301", f"the argument '{name}' of '{self.function.name}' must be of type {wrong[0]}", span,
                        expected=wrong[0], found=wrong[1])  # fmt: skip

    def _check_unit(self, name: str, value: Value, span: Span) -> None:
        """An argument must be in the unit of its input, where that has one."""
        variable, caller = self.declared[name], self.caller
        if not variable.unit or not value.uniform or value.expr is None or caller.scope.library:
            return
        found = unit_of_value(caller, value)
        expected = found and unit_of(variable)
        if found is None or expected is None or found.same_as(expected):
            return
        message = f"the argument '{name}' of '{self.function.name}' has another unit"
        if all(d.span != span for d in caller.model.drafts.arguments):
            caller.model.drafts.arguments.append(
                Diagnostic("E0303", message, span, expected=variable.unit, found=str(found)))  # fmt: skip

    def _check_size(self, name: str) -> None:
        """An array must be as large as its input is declared, where that is not left open."""
        found = self.values[name].dims
        declared = sizes(self.context, self.declared[name], self.function)
        expected = tuple(n if size is None else size for size, n in zip(declared, found))
        if found != expected:
            raise Wrong("E0302", f"the argument '{name}' of '{self.function.name}' has the wrong size", self.call.span,
                        expected=dims_text(expected), found=dims_text(found))  # fmt: skip

    def _lead(self, inputs: dict[str, Value]) -> tuple[int, ...]:
        """Dimensions by which arguments exceed the declared ones: the call is then made element by element (12.4.6)."""
        lead: tuple[int, ...] = ()
        for name, value in inputs.items():
            more = len(value.dims) - len(self.declared[name].dimensions)
            if more < 0 or (more and lead and value.dims[:more] != lead):
                raise Wrong("E0302", f"the argument '{name}' of '{self.function.name}' has the wrong size",
                            self.call.span, found=dims_text(value.dims))  # fmt: skip
            lead = value.dims[:more] or lead
        if not lead:
            return ()
        if any(not v.uniform or v.fields is not None for v in inputs.values()):
            return lead
        if any(v.dims and v.dims[: len(lead)] != lead for v in inputs.values()):
            message = "a function is applied element by element: its other arguments are single values so far"
            raise Wrong("E0230", message, self.call.span, hint="write {f(x[i], y) for i in 1:n}")
        space = self.caller.space
        for n in lead:
            space = space.with_axis(n)
        self.context.space = space
        self.context.arrays = Arrays(self.context.leaves, space.rank)
        return lead
