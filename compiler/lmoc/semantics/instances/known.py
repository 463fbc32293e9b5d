"""Values that are needed while the model is made: of parameters and constants that decide about its structure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.drafts.draft import decision
from lmoc.semantics.mistakes.wrong import NotKnown, Wrong
from lmoc.semantics.nodes.instance import Binding, Variable
from lmoc.semantics.nodes.overrides import element_positions, other_type
from lmoc.semantics.values.context import Context, Model
from lmoc.semantics.values.value import Value, from_numbers, record
from lmoc.syntax import tree

ElementValues = Mapping[tuple[str, ...], Sequence[tuple[tuple, float]]]


class KnownValues:
    """Computes each value when it is first requested, and keeps it.

    Parameters
    ----------
    elements : (subscripts, value) that the caller gave to single elements of arrays, by the array's path

    Attributes
    ----------
    undetermined : variables of whose values it has been said that they are wrong
    """

    def __init__(self, model: Model, elements: ElementValues):
        self._model = model
        self._elements = elements
        self._numbers: dict[Variable, np.ndarray] = {}
        self._evaluating: list[Variable] = []
        self._deciding = False  # the values looked for decide about a condition alone
        self._constants: dict[tuple[int, Scope], Value] = {}  # by the expression and the class that it is meant for
        self._open_constants: list[tuple[int, Scope]] = []
        self.undetermined: set[Variable] = set()

    def numbers(self, variable: Variable) -> np.ndarray:
        """The values of a parameter or constant, needed to shape the flat model: one for each of its elements."""
        found = self._numbers.get(variable)
        if found is not None and (self._deciding or variable.shaping):
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
                f"'{variable.label}' determines the structure of the model and needs a value",
                variable.name_span,
            )
        self._evaluating.append(variable)
        try:
            found = self._evaluate(variable, variable.value)
        except NotKnown:
            if variable.computed:
                raise at_events_only(variable, found="a value that changes") from None
            raise
        finally:
            self._evaluating.pop()
        variable.structural = variable.kind == Kind.PARAMETER
        variable.shaping = not self._deciding
        self._numbers[variable] = found
        return found

    def decided(
        self, context: Context, condition: Value, evaluate: Callable[[], np.ndarray | float]
    ) -> np.ndarray | float:
        """The numbers of a condition: with other values the flat model is the same as long as the condition is."""
        inner, self._deciding = self._deciding, True
        try:
            found = evaluate()
        finally:
            self._deciding = inner
        if not inner and not np.any(np.isnan(found)):
            self._model.drafts.decisions += decision(context, condition, found)
        return found

    def _evaluate(self, variable: Variable, binding: Binding) -> np.ndarray:
        if binding.node is None and binding.scope is None:
            numbers = np.asarray(binding.expression, float)
            if numbers.shape not in ((), variable.total) or other_type(variable.type.name, numbers):
                raise Wrong()  # reported with the values from outside
            return np.broadcast_to(numbers, variable.total).ravel()
        context, value = self.binding(binding)
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
        for subscripts, value in self._elements.get(tuple(n for n, _ in variable.path), ()):
            where = element_positions(variable, subscripts)
            if where is not None:
                found = found.copy()
                found[where] = value
        return found

    def binding(self, binding: Binding) -> tuple[Context, Value]:
        """The meaning of a binding where it is written."""
        context = Context(self._model, binding.node, binding.scope)
        return context, context.value(binding.expression)

    def constant(self, component: tree.Component, expression: tree.Expression, scope: Scope) -> Value:
        """The value of a constant of a class, as numbers."""
        key = id(expression), scope
        found = self._constants.get(key)
        if found is None:
            if key in self._open_constants:
                raise Wrong("E0207", f"the constant '{component.name}' depends on itself", component.span)
            self._open_constants.append(key)
            try:
                context = Context(self._model, None, scope)
                value = _in_numbers(context, context.value(expression), expression, component.name)
            finally:
                self._open_constants.pop()
            found = self._constants[key] = value
        return found


def _in_numbers(context: Context, value: Value, expression: tree.Expression, name: str) -> Value:
    """The value of a constant, as numbers that do not depend on where it was computed."""
    if value.fields is not None:
        fields = {n: _in_numbers(context, field, expression, name) for n, field in value.fields.items()}
        return record(fields, value.dims, value.type)
    if value.type == "String":
        return value
    return from_numbers(context.alike(value, expression.span, f"the constant '{name}'"), value.type)


def at_events_only(variable: Variable, hint: str = "", found: str = "") -> NotKnown:
    """Return the mistake for a discrete variable whose value would have to be known when compiling."""
    message = f"'{variable.name}' determines the structure of the model, but changes while it runs"
    return NotKnown("E0211", message, variable.span, hint=hint, found=found)
