"""From classes to the instance tree: what each declaration makes (Modelica specification, 4.4, 5.4, 7.2).

Children are made when first asked for, because dimensions and conditions use other declarations in any order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from lmoc.diagnostics import Report, nearest
from lmoc.semantics import modification as mods
from lmoc.semantics.context import Context
from lmoc.semantics.flat import Kind
from lmoc.semantics.instance import Absent, Broken, Instance, Node, Variable
from lmoc.semantics.modification import Binding, Modifier
from lmoc.semantics.overrides import element_positions, other_type
from lmoc.semantics.records import record_fields
from lmoc.semantics.scope import Builtin, Member, Resolved, Scope, redeclared_class, resolve
from lmoc.semantics.value import Value, from_numbers
from lmoc.semantics.wrong import Wrong, check_size
from lmoc.source import Span
from lmoc.syntax import tree

if TYPE_CHECKING:
    from lmoc.semantics.long_sums import LongSums

ATTRIBUTES = frozenset("start fixed nominal min max unit displayUnit quantity stateSelect unbounded".split())
ElementValues = Mapping[tuple[str, ...], Sequence[tuple[tuple, float]]]
PART_KINDS = frozenset({"model", "block", "connector", "record", "class"})


class Elaboration:
    """Makes and keeps the instance tree of one model.

    Attributes
    ----------
    root : the model
    elements : values that the caller gave to single elements of arrays
    long_sums : sums that get a variable of their own
    said : places warned of already
    undetermined : variables of whose values it has been said that they are wrong
    """

    def __init__(self, root: Instance, report: Report, elements: ElementValues, long_sums: LongSums):
        self.root = root
        self.elements = elements
        self.long_sums = long_sums
        self.report = report
        self._open: set[tuple[int, str]] = set()
        self._numbers: dict[Variable, np.ndarray] = {}
        self._evaluating: list[Variable] = []
        self._constants: dict[int, Value] = {}
        self._short_modifiers: dict[tuple[int, int], Modifier] = {}
        self._open_constants: list[tree.Expression] = []
        self.said: set[tuple[str, int, int]] = set()
        self.undetermined: set[Variable] = set()

    # ----------------------------------------------------------------------- children

    def populate(self, instance: Instance) -> None:
        """Make all children, and theirs."""
        self._check_names(instance)
        for name, found in instance.cls.table.items():
            if not isinstance(found, Member):
                continue
            try:
                child = self.child(instance, name)
            except Wrong as wrong:
                wrong.put_into(self.report)
                continue
            if isinstance(child, Instance) and child.parent is instance:
                self.populate(child)
        # children are made when first used; the table's order is that of the declarations
        order = [name for name in instance.cls.table if name in instance.children]
        instance.children = {name: instance.children[name] for name in order}

    def _check_names(self, instance: Instance) -> None:
        table = instance.cls.table
        for name, modifier in instance.modifier.inside.items():
            found = table.get(name)
            if found is None and modifier.span is not None:
                self.report.error(
                    "E0205",
                    f"'{instance.cls.name}' has no element '{name}' to modify",
                    modifier.span,
                    hint=nearest(name, table) or _elements_hint(table),
                )
            elif isinstance(found, Member) and found.protected:
                self.report.error(
                    "E0210", f"'{name}' is protected in '{instance.cls.name}' and cannot be modified", modifier.span
                )

    def child(self, instance: Instance, name: str) -> Node:
        """The child of that name, which the class must have."""
        made = instance.children.get(name)
        if made is not None:
            return made
        member = instance.cls.table[name]
        key = (id(instance), name)
        if key in self._open:
            raise Wrong("E0207", f"the size or condition of '{name}' depends on itself", member.component.span)
        self._open.add(key)
        try:
            made = self._make(instance, member)
        except Wrong as wrong:
            wrong.put_into(self.report)
            made = Broken(name, instance, member.component, member.scope)
        finally:
            self._open.discard(key)
        instance.children[name] = made
        return made

    def _make(self, instance: Instance, member: Member) -> Node:
        component, scope = member.component, member.scope
        if component.outer and not component.inner:
            return self._inner(instance, component)
        modifier = self._modifier(instance, member)
        if modifier.redeclaration is not None:
            if not component.replaceable:
                raise Wrong("E0206", f"'{component.name}' is not replaceable", modifier.span)
            argument, scope = modifier.redeclaration
            if not isinstance(argument.element, tree.Component):
                raise Wrong("E0223", f"'{component.name}' is a part, not a class", argument.span)
            component = argument.element
        if component.condition is not None and not self._present(instance, component, scope):
            return Absent(component.name, instance, (), component, scope)
        resolved = self._type_of(instance, component, scope)
        for short, where in resolved.steps:
            node = instance if where in instance.cls.lineage() else None
            modifier = mods.merge(modifier, self._of_short_class(short, node, where), component.name)
        dims = self._dimensions(instance, component, scope, resolved, modifier)
        if isinstance(resolved.base, Builtin):
            return self._variable(instance, component, member, resolved, modifier, dims)
        return self._instance(instance, component, member, resolved, modifier, dims)

    def _of_short_class(self, short: tree.ShortClass, node: Instance | None, where: Scope) -> Modifier:
        key = (id(short), id(node))
        found = self._short_modifiers.get(key)
        if found is None:
            found = mods.of_class(mods.from_tree(short.modification, node, where))
            self._short_modifiers[key] = found
        return found

    def _type_of(self, instance: Instance, component: tree.Component, scope: Scope) -> Resolved:
        """The class of a component: one that the instance has redeclared, or what its type means where it stands."""
        first = component.type.parts[0].name
        own = instance.cls.table.get(first)
        if isinstance(own, Scope) and not component.type.absolute and len(component.type.parts) == 1:
            if scope is instance.cls or scope in instance.cls.lineage():
                modifier = instance.modifier.inside.get(first)
                if modifier is not None and modifier.redeclaration is not None:
                    own = redeclared_class(own, *modifier.redeclaration)
                return resolve(own)
        return scope.type_of(component)

    def _modifier(self, instance: Instance, member: Member) -> Modifier:
        """All that is given to a component: by the part around it, by `extends`, by its declaration."""
        name = member.component.name
        modifier = mods.descend(instance.modifier, name, len(instance.dims))
        for argument, scope in member.outer:
            modifier = mods.merge(modifier, mods.from_argument(argument, instance, scope), name)
        declared = mods.from_tree(member.component.modification, instance, member.scope)
        if member.component.final:
            declared = Modifier(declared.value, declared.inside, True, None, member.component.name_span)
        return mods.merge(modifier, declared, name)

    def _inner(self, instance: Instance, component: tree.Component) -> Node:
        around = instance.parent
        while around is not None:
            found = around.cls.table.get(component.name)
            if isinstance(found, Member) and found.component.inner:
                return self.child(around, component.name)
            around = around.parent
        raise Wrong(
            "E0214",
            f"'outer {component.name}' finds no 'inner {component.name}' in the parts around it",
            component.span,
            hint=f"declare 'inner {component.type} {component.name};' in the model",
        )

    def _present(self, instance: Instance, component: tree.Component, scope: Scope) -> bool:
        context = Context(self, instance, scope)
        condition = context.value(component.condition)
        require_boolean(condition, component.condition)
        what = f"the condition of '{component.name}'"
        return bool(context.scalar(condition, component.condition.span, what))

    # --------------------------------------------------------------------- dimensions

    def _dimensions(
        self, instance: Instance, component: tree.Component, scope: Scope, resolved: Resolved, modifier: Modifier
    ) -> tuple[int, ...]:
        if not component.dimensions and not any(short.dimensions for short, _ in resolved.steps):
            return ()
        given = [(e, Context(self, instance, scope)) for e in component.dimensions]
        for short, where in resolved.steps:
            node = instance if where in instance.cls.lineage() else None
            given += [(e, Context(self, node, where)) for e in short.dimensions]
        dims: list[int] = []
        for axis, (expression, context) in enumerate(given):
            if isinstance(expression, tree.Colon):
                dims.append(self._size_of_binding(component, modifier.value, axis))
                continue
            what = f"the size of '{component.name}'"
            dims.append(context.whole(context.value(expression), expression.span, what))
            check_size(prod((*instance.total, *dims)), f"'{component.name}'", expression.span)
        return tuple(dims)

    def _size_of_binding(self, component: tree.Component, binding: Binding | None, axis: int) -> int:
        if binding is None:
            raise Wrong("E0212", f"the size of '{component.name}' is open: it needs a value", component.span)
        dims = self.binding_value(binding)[1].dims if binding.node else np.shape(binding.expression)
        at = axis + sum(not a for a in binding.alike)
        if at >= len(dims):
            raise Wrong("E0302", f"'{component.name}' needs an array as value", binding.span)
        return dims[at]

    # ------------------------------------------------------------------ variables, parts

    def _variable(self, instance, component, member: Member, resolved: Resolved, modifier: Modifier, dims) -> Variable:
        for name, inner in modifier.inside.items():
            if name not in ATTRIBUTES:
                raise Wrong(
                    "E0205",
                    f"'{component.name}' is a {resolved.base.name} and has no attribute '{name}'",
                    inner.span or component.span,
                    hint=nearest(name, ATTRIBUTES),
                )
        made = Variable(
            component.name, instance, dims, component, member.scope, member.protected, resolved.base, modifier
        )
        made.connector = resolved.kind == "connector" or _in_connector(instance)
        causality = component.causality or next((s.causality for s, _ in resolved.steps if s.causality), "")
        made.causality = causality
        made.flow = component.flow
        made.output = causality == "output" and instance.parent is None
        variability = component.variability or _of_record(instance)
        if variability == "constant":
            made.kind = Kind.CONSTANT
        elif variability == "parameter":
            made.kind = Kind.PARAMETER
        elif causality == "input" and instance.parent is None:
            made.kind = Kind.INPUT
        elif variability == "discrete" or resolved.base.name != "Real":
            if variability or causality or modifier.value is None:
                plain = not variability and not causality
                raise at_events_only(made, "give it a value here that depends on parameters only" if plain else "")
            made.kind, made.computed = Kind.PARAMETER, True
        return made

    def _instance(self, instance, component, member: Member, resolved: Resolved, modifier: Modifier, dims) -> Instance:
        cls = resolved.base
        if resolved.kind not in PART_KINDS or cls.kind not in PART_KINDS:
            raise Wrong("E0223", f"'{resolved.name}' is a {cls.kind} and cannot be used as a part", component.type.span)
        if cls.definition.partial:
            raise Wrong(
                "E0209",
                f"'{resolved.name}' is partial: a model must extend it before there can be a part of it",
                component.type.span,
            )
        around: Instance | None = instance
        while around is not None:
            if around.cls is cls:
                raise Wrong("E0208", f"'{cls.name}' contains itself as '{component.name}'", component.span,
                            hint="a class cannot be made of itself; an array has many parts of a kind")  # fmt: skip
            around = around.parent
        if modifier.value is not None:
            modifier = record_fields(component.name, cls, modifier)
        return Instance(
            component.name, instance, dims, component, member.scope, member.protected, cls, cls.kind, modifier
        )

    # ---------------------------------------------------------------------- known numbers

    def numbers(self, variable: Variable) -> np.ndarray:
        """The values of a parameter or constant, needed to shape the flat model: one for each of its elements."""
        found = self._numbers.get(variable)
        if found is not None:
            return found
        if variable in self._evaluating:
            cycle = self._evaluating[self._evaluating.index(variable) :] + [variable]
            raise Wrong(
                "E0207", f"the value of '{variable.label}' depends on itself", variable.span,
                found=" → ".join(v.label for v in cycle),
            )  # fmt: skip
        if variable in self.undetermined:
            raise Wrong()
        if variable.value is None:
            raise Wrong(
                "E0212",
                f"'{variable.label}' decides about the structure of the model and needs a value",
                variable.name_span,
            )
        self._evaluating.append(variable)
        try:
            found = self._evaluate(variable, variable.value)
        except Wrong as wrong:
            if variable.computed and wrong.code == "E0211":
                raise at_events_only(variable, found="a value that changes") from None
            raise
        finally:
            self._evaluating.pop()
        variable.structural = variable.kind == Kind.PARAMETER
        self._numbers[variable] = found
        return found

    def _evaluate(self, variable: Variable, binding: Binding) -> np.ndarray:
        if binding.node is None and binding.scope is None:
            numbers = np.asarray(binding.expression, float)
            if numbers.shape not in ((), variable.total) or other_type(variable.type.name, numbers):
                raise Wrong()  # reported with the values from outside
            return np.broadcast_to(numbers, variable.total).ravel()
        context, value = self.binding_value(binding)
        numbers = np.asarray(context.known(value, binding.span, f"the value of '{variable.label}'"), float)
        rank = context.space.rank
        extra = variable.total[rank:]
        alike = (*binding.alike, *(False,) * (len(extra) - len(binding.alike)))
        open_axes = tuple(n for n, same in zip(extra, alike) if not same)
        if value.dims not in ((), open_axes):
            raise Wrong()  # reported with the declaration
        numbers = numbers.reshape(numbers.shape + (1,) * (rank + len(value.dims) - numbers.ndim))
        if value.dims:
            at = tuple(np.newaxis if a else slice(None) for a in alike)
            numbers = numbers[(slice(None),) * rank + at]
        else:
            numbers = numbers.reshape(numbers.shape + (1,) * len(extra))
        found = np.broadcast_to(numbers, variable.total).ravel()
        for subscripts, value in self.elements.get(tuple(n for n, _ in variable.path), ()):
            where = element_positions(variable, subscripts)
            if where is not None:
                found = found.copy()
                found[where] = value
        return found

    def binding_value(self, binding: Binding) -> tuple[Context, Value]:
        """The meaning of a binding where it is written."""
        context = Context(self, binding.node, binding.scope)
        return context, context.value(binding.expression)

    def constant(self, component: tree.Component, expression: tree.Expression, scope: Scope) -> Value:
        """The value of a constant of a class, as numbers."""
        found = self._constants.get(id(expression))
        if found is None:
            if any(expression is e for e in self._open_constants):
                raise Wrong("E0207", f"the constant '{component.name}' depends on itself", component.span)
            self._open_constants.append(expression)
            try:
                context = Context(self, None, scope)
                value = context.value(expression)
                if value.type != "String":
                    numbers = context.alike(value, expression.span, f"the constant '{component.name}'")
                    value = from_numbers(numbers, value.type)
            finally:
                self._open_constants.pop()
            found = self._constants[id(expression)] = value
        return found

    # ------------------------------------------------------------------------- messages

    def say_once(self, code: str, message: str, span, **more) -> None:
        """A warning that is given once for each place."""
        if self.not_said(code, span):
            self.report.warning(code, message, span, **more)

    def not_said(self, code: str, span: Span) -> bool:
        """Whether this is the first time that something is to be said of a place; from now on it counts as said."""
        key = (code, id(span.source), span.start)
        first = key not in self.said
        self.said.add(key)
        return first


def at_events_only(variable: Variable, hint: str = "", found: str = "") -> Wrong:
    """What to say of a variable that only an event could change."""
    message = f"'{variable.name}' changes at events only, and events are not available yet"
    return Wrong("E0230", message, variable.span, hint=hint, found=found)


def _elements_hint(table: Mapping[str, object]) -> str:
    names = [n for n, m in table.items() if isinstance(m, Member) and m.component.variability == "parameter"]
    return f"its parameters are {', '.join(names)}" if names else ""


def _in_connector(instance: Instance | None) -> bool:
    while instance is not None:
        if instance.connector:
            return True
        instance = instance.parent if instance.kind == "record" else None
    return False


def _of_record(instance: Instance | None) -> str:
    """The variability that a record gives to its fields: `parameter` before a record makes all of them parameters."""
    while instance is not None and instance.kind == "record":
        if instance.component.variability:
            return instance.component.variability
        instance = instance.parent
    return ""


def require_boolean(value: Value, expression: tree.Expression) -> None:
    """A condition must be a Boolean scalar."""
    if value.type != "Boolean" or value.dims:
        found = f"an array of {value.type}" if value.dims else value.type
        raise Wrong("E0301", "a condition must be true or false", expression.span, expected="Boolean", found=found)
