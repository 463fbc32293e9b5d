"""Sliders that a page shows first: ``parameter Real k = 40 annotation(Slider(min = 10, max = 90, step = 5))``."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite

from lmoc.ir.flat import Kind, Slider
from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.vendor import entry_of
from lmoc.semantics.instances.elaboration import Elaboration
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.semantics.values.context import Context
from lmoc.syntax import tree

FIELDS = ("min", "max", "step")


def sliders_of(model: Elaboration, variables: Iterable[Variable], parts: Iterable[Instance]) -> dict[Variable, Slider]:
    """Return the sliders that the declarations of parameters ask for; mistakes there are warnings."""
    found = {}
    for node in (*variables, *parts):
        entry = entry_of(node.component.annotation, "Slider") if node.component else None
        if entry is None:
            continue
        if not (isinstance(node, Variable) and node.kind == Kind.PARAMETER and node.type.name == "Real"):
            expected = "a parameter of type Real"
            model.report.warning("W0248", f"'{node.label}' cannot have a slider", entry.span, expected=expected)
            continue
        try:
            found[node] = _slider(model, node, entry)
        except Wrong as wrong:
            wrong.put_into(model.report)
    return found


def _slider(model: Elaboration, variable: Variable, entry: tree.ElementModification) -> Slider:
    values: dict[str, float] = {}
    for argument in entry.modification.arguments if entry.modification else ():
        name = argument.name[0] if isinstance(argument, tree.ElementModification) else ""
        if name not in FIELDS:
            raise Wrong("W0248", f"'Slider' has no entry '{name}'", argument.span, hint=nearest(name, FIELDS))
        expression = argument.modification.value if argument.modification else None
        if expression is None:
            raise Wrong("W0248", f"'{name}' has no value", argument.span, expected=f"{name} = …")
        context = Context(model, variable.parent, variable.scope)
        values[name] = context.scalar(context.value(expression), expression.span, f"'{name}'")
    _check(values, entry.span)
    return Slider(values.get("min"), values.get("max"), values.get("step"))


def _check(values: dict[str, float], span: Span) -> None:
    """Refuse ranges that nobody could move a slider in."""
    low, high, step = (values.get(name) for name in FIELDS)
    told = ", ".join(f"{name} = {value:g}" for name, value in values.items())
    if not all(map(isfinite, values.values())):
        raise Wrong("W0248", "the range of a slider is finite", span, found=told)
    if (low is None) != (high is None):
        raise Wrong("W0248", "a slider has both ends or none", span, expected="min = …, max = …", found=told)
    if low is not None and high is not None and not low < high:
        raise Wrong("W0248", "the range of a slider is empty", span, expected="min < max", found=told)
    if step is not None and (low is None or high is None or not 0 < step <= high - low):
        raise Wrong("W0248", "the step of a slider cannot be used", span, expected="0 < step ≤ max − min", found=told)
