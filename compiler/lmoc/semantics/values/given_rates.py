"""Derivatives that a function gives itself: ``derivative(noDerivative = u) = f_der`` (Modelica specification, 12.7.1).

With `noDerivative`, the derivative function is more than a faster way to the same result: what an argument does in time
is left to it (the forced motions of libraries take position, speed and acceleration from three signals). A call then is
a value with a rate of its own, `given` of the expression DAG. Without `noDerivative` the expression is differentiated,
and where the argument is a record, too: the fields of one (an orientation and its speed) are tied by equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from lmoc.expression.calculus import total_derivative
from lmoc.expression.dag import TIME, function, slots
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.formals import LocalVariable
from lmoc.semantics.values.translate import changes
from lmoc.semantics.values.value import Value, stack
from lmoc.syntax import tree

Caller = Callable[[Scope, list[Value]], list[Value]]  # the results of a function for the values of its inputs


def with_rates(
    context: Context,
    of: Scope,
    declared: Mapping[str, LocalVariable],
    inputs: Mapping[str, Value],
    outputs: list[Value],
    call: Caller,
) -> list[Value]:
    """Return the results of a call, each with the rate that the function's annotation gives it, where it does so."""
    real = [name for name, v in declared.items() if v.role == "input" and v.type == "Real" and v.record is None]
    for argument, order, held, constant in _annotations(of):
        free = [name for name in real if name not in held | constant]
        still = not any(changes(context, inputs[name]) for name in real if name in held)
        if held.isdisjoint(real) or (still and any(_moved(context, inputs[name]) for name in free)):
            continue
        if any(changes(context, inputs[name]) for name in constant & inputs.keys()):
            continue  # the derivative holds for other calls
        newest = free[len(free) - len(free) // order :]  # of a first derivative, its inputs' rates alone
        rates = [_rate(context, of, name, inputs[name], argument) for name in newest]
        found = call(of.find_class(argument.modification.value), [*inputs.values(), *rates])
        return [context.arrays.map(lambda v, r: function("given", v, r, TIME), *pair) for pair in zip(outputs, found)]
    return outputs


def _annotations(of: Scope) -> Iterator[tuple[tree.ElementModification, int, set[str], set[str]]]:
    """Yield each ``derivative(noDerivative = u, zeroDerivative = k, order = n) = f``, its order, those u, those k."""
    annotation = of.definition.annotation
    for argument in annotation.arguments if annotation else ():
        if not isinstance(argument, tree.ElementModification) or argument.name != ("derivative",):
            continue
        entries = argument.modification.arguments if argument.modification else ()
        said = [(e.name[0], e.modification.value) for e in entries if e.modification]
        held, constant = (
            {str(value) for name, value in said if name == kind} for kind in ("noDerivative", "zeroDerivative")
        )
        if held and isinstance(argument.modification.value, tree.Ref):
            yield argument, next((int(v.value) for name, v in said if name == "order"), 1), held, constant


def _moved(context: Context, value: Value) -> bool:
    """Return whether variables move a value, not time alone."""
    columns = {leaf.value[0] for _, piece in context.arrays.pieces(value) for leaf in slots(piece.expr)}
    return bool(columns - set(context.leaves.held(columns)))


def _rate(context: Context, of: Scope, name: str, value: Value, annotation: tree.ElementModification) -> Value:
    """The derivative of an argument that time alone moves."""
    if value.items is not None:
        items = [_rate(context, of, name, item, annotation) for item in value.items]
        return stack(items, value.dims[1:], "Real")
    if _moved(context, value):
        message = f"the derivative that '{of.name}' gives itself needs arguments that time alone moves so far"
        raise Wrong("E0230", message, annotation.span, found=f"'{name}', which changes")
    return Value(total_derivative(value.expr, {leaf.value[0] for leaf in slots(value.expr)}), value.dims)
