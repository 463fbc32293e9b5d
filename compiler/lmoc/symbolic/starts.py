"""Start values of a run by an equilibrium: `initial="equilibrium"`, or one that `equilibria` has found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.evaluate import evaluate
from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.numerics.signals.signals import Constant, Formula, bind_signals, sample
from lmoc.symbolic import places
from lmoc.symbolic.places import Point

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.equilibria import Equilibria

EQUILIBRIUM = "equilibrium"


def in_symbols(initial: object) -> bool:
    """Return whether start values are to be worked out: a word, or a mapping with expressions."""
    return isinstance(initial, str) or (
        isinstance(initial, Mapping)
        and any(hasattr(value, "free_symbols") for _, value in initial.items())  # its own `values` are others
    )


Find = Callable[[Prepared, Mapping[str, float]], "Equilibria"]


def start_values(
    prepared: Prepared, initial: str | Point, inputs: Mapping[str, object] | None, time: float, find: Find
) -> dict[str, float]:
    """Return {name: number} to start from.

    Where the equilibrium is a family, its free states are left to the model's own start values; of a set that friction
    holds, the member is taken at which it has most to spare.

    Parameters
    ----------
    find : the states of rest for constant inputs
    initial : "equilibrium", an `Equilibrium`, or {name: number or expression in parameters and inputs}
    inputs : as for a run; the equilibrium is that for their values at `time`
    time : s, where the run starts

    Raises
    ------
    ModelError
        E0663 there is no equilibrium, or there are several; E0621 another word; E0662 a parameter without a value.
    """
    loads = _values_at(prepared, inputs, time)
    if isinstance(initial, str):
        if initial != EQUILIBRIUM:
            expected = f"{{name: value}} or '{EQUILIBRIUM}'"
            raise ModelError([Diagnostic("E0621", "the start is not understood", expected=expected, found=initial)])
        initial = places.only(find(prepared, loads), places.START)
    return _numbers(prepared, initial, loads)


def _numbers(prepared: Prepared, point: Point, loads: Mapping[str, float]) -> dict[str, float]:
    """A point in numbers, without the states that may have any value, unless others follow from them."""
    free = {s.name for s in getattr(point, "free", ())}
    point = getattr(point, "member", point)
    free = {name for name in free if _symbols(point[name])}
    needed = {s.name for name, value in point.items() if name not in free for s in _symbols(value)}
    found = {}
    for name, value in point.items():
        if name in free - needed or (prepared.flat.find(name) is None and value == 0):
            continue  # a derivative without a name of its own starts at zero anyway
        if hasattr(value, "free_symbols"):
            value = value.xreplace({s: _exact(loads[s.name]) for s in value.free_symbols if s.name in loads})
        found[name] = places.number(prepared, value, free)
    return found


def _symbols(value: object) -> set[sympy.Symbol]:
    return getattr(value, "free_symbols", set())


def _exact(value: float) -> sympy.Expr:
    from lmoc.expression.to_sympy import exact

    return exact(value)


def _values_at(prepared: Prepared, inputs: Mapping[str, object] | None, time: float) -> dict[str, float]:
    """The inputs' values at a time, zero for one without a signal."""
    report = Report()
    signals = bind_signals(prepared.flat, inputs, report)
    report.check()
    found = dict.fromkeys(prepared.inputs, 0.0)
    for variable, signal in signals.items():
        if isinstance(signal, Constant):
            value = signal.value
        elif isinstance(signal, Formula):
            value = evaluate(signal.shape, lambda k, _, s=signal: prepared.values[s.variables[k]], time)
        else:
            value = sample(signal, 0, np.array([time]))
        found[prepared.flat.variable_name(variable)] = float(np.ravel(value)[0])
    return found
