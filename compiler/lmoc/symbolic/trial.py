"""Numbers for all symbols of a scene that fit together: what an expression is at a random point of the motion.

An identity that holds at a random point holds everywhere, up to a set of measure zero (J. T. Schwartz, J. ACM 27 (1980)
701); so equations that were derived in one way are checked against the rates that the numeric system gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.symbolic.numeric import NumericSystem
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import SymbolicInterpreter, jet_symbol

if TYPE_CHECKING:
    import sympy

ROUNDING = 1e-8  # of the sum of the terms' sizes


class Trial:
    """A random point: states, inputs and parameters without a value at random, rates by the numeric system.

    Parameters
    ----------
    interpreter : Interpreter
        Its parameters' symbols get the values in force.
    values : (flat.count,) parameter values
    onto : (states, parameter values) -> states, where these have to satisfy something
    """

    def __init__(
        self,
        interpreter: SymbolicInterpreter,
        values: np.ndarray,
        onto: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    ):
        self._onto = onto
        self._interpreter = interpreter
        self._generator = np.random.default_rng(7)
        self._values = with_all_values(interpreter.reduced.flat, values, self._generator)
        self._point = self._moving()

    def _moving(self) -> dict[sympy.Symbol, sympy.Float]:
        import sympy as sp

        reduced, flat = self._interpreter.reduced, self._interpreter.reduced.flat
        system = NumericSystem(reduced, self._values, ())
        x = self._generator.uniform(0.2, 0.9, len(reduced.states))
        if self._onto is not None:
            x = self._onto(x, self._values)
        jets = self._generator.uniform(0.2, 0.9, reduced.inputs.shape[1])
        rates = system.rates_with(x, jets, 0.4)
        point = {sp.Symbol("time"): 0.4}
        for (_, variable, order), value in zip(reduced.inputs.T.tolist(), jets, strict=True):
            point[jet_symbol(flat.variable_name(variable), order)] = value
        for q, v in self._interpreter.outline().coordinates:
            name = self._interpreter.w[int(reduced.states[q])].name
            numbers = [x[q], x[v], rates[v]] if v >= 0 else [x[q], rates[q]]
            point |= {jet_symbol(name, n): value for n, value in enumerate(numbers)}
        return {s: sp.Float(float(value), 17) for s, value in point.items()}

    def number(self, value: sympy.Expr) -> float:
        """Return the value of an expression at the point; symbols that are met first get numbers."""
        import sympy as sp

        for s in sorted(value.free_symbols - self._point.keys(), key=lambda s: s.name):
            self._point[s] = sp.Float(float(self._met_first(s)), 17)
        found = sp.sympify(value).xreplace(self._point).evalf(17)
        return float(found) if found.is_real else float("nan")

    def _met_first(self, symbol: sympy.Symbol) -> float:
        curves, variable = self._interpreter.curves, self._interpreter.parameters.variable
        if curves is not None and symbol in curves.derivative_of:
            at = self.number(self._interpreter.argument(curves.derivative_of[symbol][0]))
            return curves.number(symbol, at, self._values)
        return self._values[variable[symbol]] if symbol in variable else self._generator.uniform(0.2, 0.9)

    def vanishes(self, value: sympy.Expr) -> bool:
        """Return whether an expression is zero but for the rounding of its terms."""
        terms = np.array([self.number(term) for term in value.as_ordered_terms()])
        return bool(abs(terms.sum()) <= ROUNDING * np.abs(terms).sum())

    def slopes(self, value: sympy.Expr, symbols: Sequence[sympy.Symbol]) -> np.ndarray:
        """Return (n,) derivatives by some symbols, of which the largest is 1 unless all vanish."""
        row = np.array([self.number(slope(value, x)) if x in value.free_symbols else 0.0 for x in symbols])
        largest = np.abs(row).max(initial=0.0)
        return row / largest if largest > 0 else row


def with_all_values(flat: FlatDAE, values: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Return parameter values with random ones where there are none, and what is bound to them."""
    values = values.copy()
    bound = np.concatenate([a.target for a in flat.bindings]) if flat.bindings else np.zeros(0, int)
    free = np.isnan(values) & np.isin(flat.kind, (Kind.CONSTANT, Kind.PARAMETER))
    free[bound.astype(int)] = False
    values[free] = generator.uniform(0.5, 1.5, int(free.sum()))
    for a in flat.bindings:
        if flat.kind[a.target[0]] in (Kind.CONSTANT, Kind.PARAMETER):
            values[a.target] = np.where(np.isnan(values[a.target]), a.values(values), values[a.target])
    return values
