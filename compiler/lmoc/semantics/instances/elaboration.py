"""From classes to the instance tree: what each declaration makes (Modelica specification, 4.4, 5.4, 7.2).

Children are created on first access, because dimensions and conditions use other declarations in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import prod

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.place import Member, Resolved
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.redeclare import constraint_of, merged_component
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.classes.subtype import check_subtype
from lmoc.semantics.drafts.long_sums import LongSums
from lmoc.semantics.instances.known import ElementValues, KnownValues
from lmoc.semantics.mistakes.wrong import Budget, Exhausted, OutOfRange, Wrong, check_size
from lmoc.semantics.nodes import modification as mods
from lmoc.semantics.nodes.instance import (
    ATTRIBUTES,
    NOTHING,
    Absent,
    Binding,
    Broken,
    Instance,
    InstanceNode,
    Modifier,
    Variable,
)
from lmoc.semantics.nodes.records import record_fields
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.dimensions import length
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree

PART_KINDS = frozenset({"model", "block", "connector", "record", "class"})


class Elaboration:
    """Makes and keeps the instance tree of one model.

    Attributes
    ----------
    root : the model
    long_sums : sums that get a variable of their own
    drafts : what the equations have become so far
    known : numbers that shape the model
    said : places warned of already
    """

    def __init__(self, root: Instance, report: Report, elements: ElementValues, long_sums: LongSums):
        self.root = root
        self.long_sums = long_sums
        self.drafts = long_sums.drafts
        self.topology: object = None  # set when all parts are made
        self.report = report
        self.known = KnownValues(self, elements)
        self._open: set[tuple[int, str]] = set()
        self._sizes: dict[tuple[int, str], Callable[[int], int]] = {}  # of declarations being made: those of their axes
        self._defaults: dict[str, Instance] = {}  # `inner` parts that nobody declared
        self._short_modifiers: dict[tuple[int, int], Modifier] = {}
        self.rounds = Budget("LMOC_MAX_ROUNDS", "rounds of loops and calls of functions that are written out", 100_000)
        self.parts = Budget("LMOC_MAX_PARTS", "parts and variables, those of an array counted once", 100_000)
        self.said: set[tuple[str, int, int]] = set()

    # ----------------------------------------------------------------------- children

    def populate(self, instance: Instance) -> None:
        """Make all children, and theirs."""
        self._check_names(instance)
        for name, found in [*instance.cls.table.items()]:
            if not isinstance(found, Member):
                self._check_redeclared(instance.cls, name, found)
                continue
            try:
                child = self.child(instance, name)
            except Exhausted:
                raise
            except Wrong as wrong:
                wrong.put_into(self.report)
                continue
            if isinstance(child, Instance) and child.parent is instance:
                self.populate(child)
        # children are made when first used; the table's order is that of the declarations, before what `outer` added
        order = [name for name in instance.cls.table if name in instance.children]
        instance.children = {name: instance.children[name] for name in order} | instance.children
        if instance is self.root:
            for child in self._defaults.values():
                self.populate(child)

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

    def _check_redeclared(self, cls: Scope, name: str, found: Scope) -> None:
        """A class in the place of another one must be a subtype of it; where it is none, the other one stays."""
        if found.replaces is not None:
            try:
                base, _ = constraint_of(found.replaces.definition)
                old = resolve(found.replaces if base is None else found.replaces.parent.find_class(base))
                check_subtype(resolve(found), old, found.definition.name_span)
            except Wrong as wrong:
                wrong.put_into(self.report)
                cls.table[name] = found.replaces

    def child(self, instance: Instance, name: str) -> InstanceNode:
        """The child of that name, which the class must have."""
        made = instance.children.get(name)
        if made is not None:
            return made
        member = instance.cls.table[name]
        key = (id(instance), name)
        if key in self._open:
            raise Wrong("E0207", f"the size or condition of '{name}' depends on itself", member.component.span)
        self._open.add(key)
        self.parts.spend(1, member.component.span)
        try:
            made = self._make(instance, member)
        except Exhausted:
            raise
        except Wrong as wrong:
            wrong.put_into(self.report)
            made = Broken(name, instance, member.component, member.scope)
        finally:
            self._open.discard(key)
            self._sizes.pop(key, None)
        instance.children[name] = made
        return made

    def in_the_making(self, instance: Instance, name: str) -> bool:
        """Return whether the sizes of a declaration are being found out."""
        return (id(instance), name) in self._sizes

    def open_size(self, instance: Instance, name: str, axis: int) -> int:
        """The size of an axis (from 0) of a declaration that is being made, as in ``Real A[:, size(A, 1)]``."""
        return self._sizes[id(instance), name](axis)

    def _make(self, instance: Instance, member: Member) -> InstanceNode:
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
            component = merged_component(component, argument.element)
        if component.condition is not None and not self._present(instance, component, scope):
            return Absent(component.name, instance, (), component, scope)
        resolved = scope.type_of(component)
        self._check_constraint(member, component, resolved)
        for short, where in resolved.steps:
            modifier = mods.merge(modifier, self._of_short_class(short, instance, where), component.name)
        dims = self._dimensions(instance, component, scope, resolved, modifier)
        if isinstance(resolved.base, Builtin):
            return self._variable(instance, component, member, resolved, modifier, dims)
        return self._instance(instance, component, member, resolved, modifier, dims)

    def _of_short_class(self, short: tree.ShortClass, instance: Instance, where: Scope) -> Modifier:
        """Return the modification by a short class definition for a component of `instance`, equal in all elements."""
        node = instance.around(where)
        between = len(instance.total) - (len(node.total) if node else 0)
        key = (id(short), id(where), id(node), between)
        found = self._short_modifiers.get(key)
        if found is None:
            found = mods.of_class(mods.from_tree(short.modification, node, where), between)
            self._short_modifiers[key] = found
        return found

    def _modifier(self, instance: Instance, member: Member) -> Modifier:
        """All that is given to a component: by the part around it, by `extends`, by its declaration.

        What `constrainedby` gives holds under its declaration; after a redeclaration, in its place.
        """
        name, component = member.component.name, member.component
        modifier = mods.descend(instance.modifier, name, len(instance.dims))
        for argument, scope in member.outer:
            modifier = mods.merge(modifier, mods.from_argument(argument, instance, scope), name)
        declared = mods.from_tree(component.modification, instance, member.scope)
        constraint = mods.from_tree(component.constraint, instance, member.scope)
        if modifier.redeclaration is not None and component.constrained_by is not None:
            declared = constraint
        elif component.constraint is not None:
            declared = mods.merge(declared, constraint, name)
        for modification, scope in member.under:
            declared = mods.merge(declared, mods.from_tree(modification, instance, scope), name)
        if component.final:
            declared = Modifier(declared.value, declared.inside, True, None, component.name_span)
        return mods.merge(modifier, declared, name)

    def _check_constraint(self, member: Member, component: tree.Component, resolved: Resolved) -> None:
        """A redeclared component must be a subtype of what it stands for."""
        if component.type is not member.component.type:
            base, _ = constraint_of(member.component)
            check_subtype(resolved, resolve(member.scope.find_class(base)), component.type.span)
        if member.constraint is not None:
            base, where = member.constraint
            check_subtype(resolved, resolve(where.find_class(base)), component.type.span)

    def _inner(self, instance: Instance, component: tree.Component) -> InstanceNode:
        around = instance.parent
        while around is not None:
            found = around.cls.table.get(component.name)
            if isinstance(found, Member) and found.component.inner:
                wanted = instance.cls.table[component.name].scope.type_of(component)
                check_subtype(found.scope.type_of(found.component), wanted, component.type.span)
                return self.child(around, component.name)
            around = around.parent
        default = self._default_inner(instance, component)
        if default is not None:
            return default
        raise Wrong(
            "E0214",
            f"'outer {component.name}' has no matching 'inner {component.name}' in the enclosing parts",
            component.span,
            hint=f"declare 'inner {component.type} {component.name};' in the model",
        )

    def _default_inner(self, instance: Instance, component: tree.Component) -> Instance | None:
        """The `inner` element that nobody declared: the class as it stands, at the top of the model (5.4).

        A variable, a partial class, or a name that stands for something else there has none.
        """
        name = component.name
        if name in self._defaults:
            return self._defaults[name]
        resolved = instance.cls.table[name].scope.type_of(component)
        if isinstance(resolved.base, Builtin) or name in self.root.cls.table:
            return None
        scope = instance.cls.table[name].scope
        member = Member(component, scope, (), False)
        made = self._instance(self.root, component, member, resolved, NOTHING, ())
        self.root.children[name] = self._defaults[name] = made
        values = _parameters_text(made.cls)
        self.report.note(
            "N0241",
            f"there is no 'inner {component.type} {name}': one with {values or 'default values'} is added",
            self.root.cls.definition.name_span,
            hint=f"declare 'inner {component.type} {name}(…);' to set other values",
        )
        return made

    def _present(self, instance: Instance, component: tree.Component, scope: Scope) -> bool:
        context = Context(self, instance, scope)
        condition = context.value(component.condition)
        _require_boolean(condition, component.condition)
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
            node = instance.around(where)
            given += [(e, Context(self, node, where)) for e in short.dimensions]
        found: dict[int, int] = {}

        def size(axis: int) -> int:
            if axis in found or axis >= len(given):
                return found[axis] if axis in found else _no_axis(component, axis, len(given))
            if axis in waiting:
                raise Wrong("E0207", f"the size or condition of '{component.name}' depends on itself", component.span)
            waiting.add(axis)
            expression, context = given[axis]
            if isinstance(expression, tree.Colon):
                found[axis] = self._size_of_binding(component, modifier.value, axis)
            else:
                found[axis] = length(context, expression, f"the size of '{component.name}'")
            return found[axis]

        waiting: set[int] = set()
        self._sizes[id(instance), component.name] = size
        for axis, (expression, _) in enumerate(given):
            size(axis)
            if not isinstance(expression, tree.Colon):
                elements = (*instance.total, *(found[k] for k in range(axis + 1)))
                check_size(prod(elements), f"'{component.name}'", expression.span)
        return tuple(found[axis] for axis in range(len(given)))

    def _size_of_binding(self, component: tree.Component, binding: Binding | None, axis: int) -> int:
        if binding is None:
            raise Wrong("E0212", f"the size of '{component.name}' is open: it needs a value", component.span)
        dims = self.known.binding(binding)[1].dims if binding.node else np.shape(binding.expression)
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
        made.connector = resolved.kind == "connector" or instance.inside_connector
        causality = component.causality or next((s.causality for s, _ in resolved.steps if s.causality), "")
        made.causality = causality
        made.flow = component.flow
        made.output = causality == "output" and instance.parent is None
        variability = component.variability or instance.record_variability
        if variability == "constant":
            made.kind = Kind.CONSTANT
        elif variability == "parameter":
            made.kind = Kind.PARAMETER
            if self._is_found_at_start(made):
                made.kind = Kind.UNKNOWN if resolved.base.name == "Real" else Kind.DISCRETE
                made.from_start = True
        elif causality == "input" and instance.parent is None:
            made.kind = Kind.INPUT
        elif variability == "discrete" or causality or modifier.value is None:
            made.kind = Kind.UNKNOWN if resolved.base.name == "Real" and variability != "discrete" else Kind.DISCRETE
        elif resolved.base.name != "Real":
            made.kind, made.computed = Kind.PARAMETER, True
        return made

    def _is_found_at_start(self, variable: Variable) -> bool:
        """Return whether ``fixed = false`` leaves a parameter to the equations of the start (8.6)."""
        binding = variable.attributes.get("fixed")
        if binding is None or binding.scope is None:
            return False
        context, value = self.known.binding(binding)
        if value.type != "Boolean":
            raise Wrong("E0301", f"'fixed' of '{variable.label}' must be a Boolean", binding.span, found=value.type)
        fixed = np.asarray(context.known(value, binding.span, "'fixed'"), bool)
        if fixed.all():
            return False
        what = "" if not fixed.any() else "in some elements of an array"
        what = what or ("that is a text" if variable.type.name == "String" else "")
        what = what or ("with a value of its own" if variable.value is not None else "")
        if what:
            raise Wrong("E0230", f"'{variable.label}': a parameter {what} is not found at the start yet", binding.span)
        return True

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
            if around.cls.definition is cls.definition:
                raise Wrong("E0208", f"'{cls.name}' contains itself as '{component.name}'", component.span,
                            hint="a class cannot contain itself; an array holds many parts of one kind")  # fmt: skip
            around = around.parent
        if modifier.value is not None:
            modifier = record_fields(component.name, cls, modifier)
        redeclared = {
            name: inner.redeclaration
            for name, inner in modifier.inside.items()
            if isinstance(cls.table.get(name), Scope) and self._is_redeclaration(cls, name, inner)
        }
        if redeclared:
            cls = cls.specialized(redeclared)
        return Instance(
            component.name, instance, dims, component, member.scope, member.protected, cls, cls.kind, modifier
        )

    def _is_redeclaration(self, cls: Scope, name: str, modifier: Modifier) -> bool:
        if modifier.redeclaration is None:
            message = f"'{name}' is a class of '{cls.name}': it can be redeclared, but not modified"
            raise Wrong("E0205", message, modifier.span)
        return True

    # ------------------------------------------------------------------------- messages

    def say_once(self, code: str, message: str, span, **more) -> None:
        """A warning that is given once for each place."""
        if self.not_said(code, span):
            self.report.warning(code, message, span, **more)

    def not_said(self, code: str, span: Span) -> bool:
        """Return whether this is the first report of a code at a place, and record it."""
        key = (code, id(span.source), span.start)
        first = key not in self.said
        self.said.add(key)
        return first


def _no_axis(component: tree.Component, axis: int, count: int) -> int:
    raise OutOfRange("E0215", f"'{component.name}' has no axis {axis + 1}", component.span, expected=f"1 … {count}")


def _elements_hint(table: Mapping[str, object]) -> str:
    names = [n for n, m in table.items() if isinstance(m, Member) and m.component.variability == "parameter"]
    return f"its parameters are {', '.join(names)}" if names else ""


def _parameters_text(cls: Scope) -> str:
    """The parameters of a class with their values, for a message."""
    declared = [m.component for m in cls.table.values() if isinstance(m, Member)]
    found = [c for c in declared if c.variability == "parameter" and c.modification]
    given = [(c.name, c.modification.value) for c in found if c.modification.value]
    return ", ".join(f"{name} = {value.span.text}" for name, value in given)


def _require_boolean(value: Value, expression: tree.Expression) -> None:
    """Raise E0301 unless a condition is a Boolean scalar."""
    if value.type != "Boolean" or value.dims:
        found = f"an array of {value.type}" if value.dims else value.type
        raise Wrong("E0301", "a condition must be true or false", expression.span, expected="Boolean", found=found)
