"""Bindings and attributes given by declarations, such as start, fixed, unit (Modelica specification, 4.4 and 4.9)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf

import numpy as np

from lmoc.expression import dag
from lmoc.ir.flat import Kind, StateSelect
from lmoc.messages.source import Span
from lmoc.semantics.drafts.draft import AssignmentDraft, CheckDraft, Column, Drafts, GroupDraft, compact, spread
from lmoc.semantics.instances.elaboration import Elaboration
from lmoc.semantics.instances.known import at_events_only
from lmoc.semantics.mistakes.wrong import Exhausted, Wrong
from lmoc.semantics.nodes.instance import Binding, Variable
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.rows import positions
from lmoc.semantics.values.translate import changes
from lmoc.semantics.values.value import Value
from lmoc.support.distinct import distinct


def declare(model: Elaboration, drafts: Drafts, variable: Variable) -> None:
    """Add what the declaration of a variable and its modifications say."""
    if variable.type.name == "String":
        _guarded(model, lambda: _check_text(model, variable))
        return
    if variable.value is not None:
        if not _guarded(model, lambda: _value(model, drafts, variable, variable.value)):
            model.known.undetermined.add(variable)
    elif variable.kind == Kind.CONSTANT:
        model.report.error("E0212", f"the constant '{variable.label}' has no value", variable.name_span)
    if variable.from_start and variable.value is None and variable.kind == Kind.UNKNOWN:
        drafts.groups.append(_constant(variable))
    if getattr(variable.type, "literals", ()) and variable.kind > Kind.PARAMETER and "start" not in variable.attributes:
        target = positions(variable.total).reshape(-1) if variable.total else 0
        drafts.starts.append(AssignmentDraft(variable, target, dag.ONE, (), None, True, inf))  # the first one (4.9.5)
    for name, binding in variable.attributes.items():
        _guarded(model, lambda name=name, binding=binding: _attribute(model, drafts, variable, name, binding))


def settle_computed(model: Elaboration, variables: list[Variable]) -> None:
    """Find out which variables that jump are parameters after all, since they follow from parameters alone (4.5)."""
    waiting = [v for v in variables if v.computed]
    changed = True
    while changed:
        changed = False
        for variable in [v for v in waiting if v.computed]:
            if variable.value.scope is not None and _changes(model, variable.value):
                variable.kind, variable.computed, changed = Kind.DISCRETE, False, True


def _constant(variable: Variable) -> GroupDraft:
    """``der(p) = 0``: a parameter that the equations of the start determine."""
    own: Column = (variable, positions(variable.total).reshape(-1) if variable.total else 0)
    place = variable.span
    return GroupDraft(dag.slot(0, 1), dag.ZERO, (own,), variable.size, place, variable.parent.owner, "constant", True)


def settle_from_start(model: Elaboration, variables: list[Variable]) -> None:
    """Parameters that follow from those which the start determines are found there as well."""
    if not any(v.from_start for v in variables):
        return
    changed = True
    while changed:
        changed = False
        for variable in variables:
            if variable.kind == Kind.PARAMETER and variable.type.name != "String" and variable.value is not None:
                if variable.value.scope is not None and _changes(model, variable.value):
                    variable.kind = Kind.UNKNOWN if variable.type.name == "Real" else Kind.DISCRETE
                    variable.from_start = changed = True


def settle_explicit(drafts: Drafts) -> None:
    """Make those parameters that the start gives as a formula of known ones parameters with a value, in their order.

    ``p = 2*q`` as an initial equation, or ``p := 2*q`` in an initial algorithm, is no equation to be solved.
    """
    while found := _formulas(drafts):
        for group, binding in found:
            variable = binding.variable
            drafts.bindings.append(binding)
            variable.kind, variable.from_start, variable.computed = Kind.PARAMETER, False, True
            drafts.initial[:] = [g for g in drafts.initial if g is not group]
            constant = [g for g in drafts.groups if g.origin == "constant" and g.columns[0][0] is variable]
            drafts.groups[:] = [g for g in drafts.groups if g is not group and g not in constant]


def _formulas(drafts: Drafts) -> list[tuple[GroupDraft, AssignmentDraft]]:
    """Return the equations that give a parameter from known values; none of one that several of them give."""
    groups = [*drafts.initial, *(g for g in drafts.groups if g.origin == "binding")]
    found = [(group, binding) for group in groups if (binding := _formula(group)) is not None]
    given = [id(binding.variable) for _, binding in found]
    return [one for one, variable in zip(found, given, strict=True) if given.count(variable) == 1]


def _formula(group: GroupDraft) -> AssignmentDraft | None:
    """Return what an equation says of a whole parameter that the start determines, from known values alone."""
    for left, right in ((group.left, group.right), (group.right, group.left)):
        if left.op != "slot" or left.value[1] or dag.depends_on_time(right):
            continue
        variable, target = group.columns[left.value[0]]
        leaves = dag.slots(right)
        columns = sorted({leaf.value[0] for leaf in leaves})
        whole = variable is not None and variable.from_start and group.rows == variable.size
        known = all((v := group.columns[k][0]) is None or v.known for k in columns)
        if whole and known and not any(leaf.value[1] for leaf in leaves):
            place = {k: n for n, k in enumerate(columns)}
            shape = dag.transform(right, lambda e, to=place: dag.slot(to[e.value[0]]) if e.op == "slot" else e)
            own = tuple(group.columns[k] for k in columns)
            return AssignmentDraft(variable, target, shape, own, group.span, group.library)
    return None


def _changes(model: Elaboration, binding: Binding) -> bool:
    try:
        return changes(*model.known.binding(binding))
    except Wrong:
        return False  # which is reported with the declaration


def _check_text(model: Elaboration, variable: Variable) -> None:
    """A text has no place in the flat model: its value only has to be one."""
    binding = variable.value
    if binding is None or binding.scope is None:
        return
    value = model.known.binding(binding)[1]
    if value.type != "String":
        raise Wrong("E0301", f"the value of '{variable.label}' must be of type String", binding_span(binding),
                    expected="String", found=value.type)  # fmt: skip


def _guarded(model: Elaboration, work: Callable[[], None]) -> bool:
    """Do it, and report what is wrong; whether all went well."""
    try:
        work()
    except Exhausted:
        raise
    except Wrong as wrong:
        wrong.put_into(model.report)
        return False
    return True


def _value(model: Elaboration, drafts: Drafts, variable: Variable, binding: Binding) -> None:
    rows = list(_rows(model, variable, binding))
    equation = variable.kind in (Kind.UNKNOWN, Kind.DISCRETE)
    if not equation:
        _require_constant(rows, variable, binding, "the value", variable.kind == Kind.INPUT)
    library = binding.scope is not None and binding.scope.library
    if not equation:
        drafts.bindings += [AssignmentDraft(variable, *row, binding_span(binding), library) for row in rows]
        return
    node = variable.parent.owner
    for target, shape, columns in rows:
        moved = _behind_own(shape)
        size = target.size if isinstance(target, np.ndarray) else 1
        own: Column = (variable, target)
        drafts.groups.append(
            GroupDraft(
                dag.slot(0),
                moved,
                (own, *columns),
                size,
                binding_span(binding) or variable.span,
                node,
                "binding",
                library,
            )
        )


def binding_span(binding: Binding) -> Span | None:
    """Return the place where a value is written."""
    return getattr(binding.expression, "span", binding.span)


def _rows(
    model: Elaboration, variable: Variable, binding: Binding, lenient: bool = False, type_: str | None = None
) -> Iterator[tuple[np.ndarray | int, dag.Expr, tuple[Column, ...]]]:
    """Targets, shapes and columns of a value given to a variable (or to an attribute of it)."""
    if binding.scope is None:
        yield _numbers_row(variable, binding)
        return
    context, value = model.known.binding(binding)
    expected = type_ or variable.type.name
    if value.type != expected and (expected, value.type) != ("Real", "Integer"):
        raise Wrong("E0301", f"the value of '{variable.label}' must be of type {expected}", binding_span(binding),
                    expected=expected, found=value.type, hint=_other_type_hint(expected, value))  # fmt: skip
    if not value.dims and not variable.total and value.uniform:
        leaves, (shape,) = compact(context.leaves.items, value.expr)
        yield 0, shape, tuple((leaf.variable, leaf.index) for leaf in leaves)
        return
    yield from spread(context, value, binding, variable, lenient)


def _other_type_hint(expected: str, value: Value) -> str:
    if (expected, value.type) == ("Integer", "Real"):
        return "div(a, b) divides whole numbers, integer(x) rounds down"
    if (expected, value.type) == ("Real", "String"):
        return "a number stands without quotation marks and without its unit: write 50, in SI units"
    return ""


def _require_constant(rows: list, variable: Variable, binding: Binding, what: str, signal: bool) -> None:
    """Parameters and attributes use parameters only; the signal of an input may use time as well.

    A constant uses constants only (4.5), which also holds where the value comes from a modification.
    """
    for _, shape, columns in rows:
        if variable.kind == Kind.CONSTANT and what == "the value":
            open_ones = [v for v, _ in columns if v is not None and v.kind == Kind.PARAMETER]
            if open_ones:
                raise Wrong("E0224", f"the constant '{variable.label}' depends on the parameter '{open_ones[0].label}'",
                            binding_span(binding), expected="an expression in constants",
                            hint="declare it as a parameter; 'final' if it cannot be given another value")  # fmt: skip
        changing = [v for v, _ in columns if v is not None and not v.known]
        if changing or (dag.depends_on_time(shape) and not signal):
            found = f"'{changing[0].label}'" if changing else "time"
            if variable.computed and what == "the value":
                raise at_events_only(variable, found="a value that changes")
            use = "time, parameters and constants" if signal else "parameters and constants"
            raise Wrong("E0224", f"{what} of '{variable.label}' depends on {found}, which changes while it runs",
                        binding_span(binding), expected=f"an expression in {use}")  # fmt: skip


def _numbers_row(variable: Variable, binding: Binding) -> tuple[np.ndarray, dag.Expr, tuple[Column, ...]]:
    numbers = np.asarray(binding.expression, float)
    target = positions(variable.total).reshape(-1)
    if numbers.ndim == 0:
        return target, dag.const(float(numbers)), ()
    if numbers.shape != variable.total:
        raise Wrong()  # reported with the values from outside
    flat = numbers.reshape(-1)
    return target, dag.slot(0), ((None, flat),)


def _attribute(model: Elaboration, drafts: Drafts, variable: Variable, name: str, binding: Binding) -> None:
    span = binding_span(binding)
    if binding.scope is None:
        return  # from outside, where only parameters are given values: it is reported with these
    if name in ("min", "max") and variable.kind == Kind.PARAMETER:
        _limit(model, drafts, variable, name, binding)
    elif name == "fixed" and (variable.kind == Kind.PARAMETER or variable.from_start):
        return
    elif name in ("start", "nominal", "fixed"):
        if variable.kind <= Kind.PARAMETER:
            return  # a parameter's start value is a hint for forms to fill in
        type_ = {"fixed": "Boolean", "start": variable.type.name}.get(name, "Real")
        rows = _rows(model, variable, binding, True, type_)
        rows = list(rows)
        _require_constant(rows, variable, binding, f"'{name}'", False)
        into = {"start": drafts.starts, "nominal": drafts.nominals, "fixed": drafts.fixed}[name]
        depth = inf if binding.node is None else len(binding.node.path)  # else it is written in a package
        into += [AssignmentDraft(variable, *row, span, binding.scope.library, depth) for row in rows]
    elif name == "unit":
        variable.unit = _text(model, variable, name, binding)
    elif name == "stateSelect":
        variable.state_select = _state_select(model, binding)


def _limit(model: Elaboration, drafts: Drafts, variable: Variable, name: str, binding: Binding) -> None:
    """A parameter must keep its `min` and `max` (4.9.1)."""
    relation, words = {"min": ("ge", "at least"), "max": ("le", "at most")}[name]
    for target, shape, columns in _rows(model, variable, binding, True, "Real"):
        condition = dag.function(relation, dag.slot(0), _behind_own(shape))
        limit = getattr(binding.expression, "span", None)
        message = f"'{variable.label}' must be {words} {limit.text if limit else ''}".rstrip()
        rows = target.size if isinstance(target, np.ndarray) else 1
        place = _place(variable)
        drafts.checks.append(CheckDraft(condition, message, True, ((variable, target), *columns), rows, place))


def _place(variable: Variable) -> Span:
    """Return the place where a parameter got its value, in the user's text if possible."""
    value = variable.value
    if value is not None and value.scope is not None and not value.scope.library and binding_span(value) is not None:
        return binding_span(value)
    around = variable.parent.owner
    while around.parent is not None and around.parent.cls.library:
        around = around.parent
    return variable.span if around.parent is None or not variable.parent.cls.library else around.name_span


def _behind_own(shape: dag.Expr) -> dag.Expr:
    """The shape with its columns moved by one, behind that of the variable itself."""
    return dag.transform(shape, lambda leaf: dag.slot(leaf.value[0] + 1, leaf.value[1]) if leaf.op == "slot" else leaf)


def _text(model: Elaboration, variable: Variable, name: str, binding: Binding) -> str:
    """The text of an attribute; "" where elements of an array have different ones."""
    context = Context(model, binding.node, binding.scope)
    value = context.value(binding.expression)
    if value.type != "String":
        raise Wrong("E0301", f"'{name}' of '{variable.label}' must be a text in quotes", binding_span(binding),
                    expected="String", found=value.type)  # fmt: skip
    texts = {item.text for item in context.arrays.scalars(value)}
    return texts.pop() if len(texts) == 1 else ""


def _state_select(model: Elaboration, binding: Binding) -> StateSelect:
    context = Context(model, binding.node, binding.scope)
    value = context.value(binding.expression)
    span = binding_span(binding)
    if value.type != "StateSelect":
        raise Wrong("E0301", "stateSelect must be a literal of StateSelect", span, expected="StateSelect.prefer",
                    found=value.type)  # fmt: skip
    numbers = distinct(context.known(value, span, "stateSelect"))
    if len(numbers) > 1:
        raise Wrong("E0220", "stateSelect differs between the elements of an array", span)
    return StateSelect(int(numbers[0]) - 1)
