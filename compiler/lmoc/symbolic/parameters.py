"""The symbol or number for each parameter.

A person writes ``J1``, not ``rotor.J``: bindings are followed to the parameters that are not bound to others. Numbers
that the user did not set (an unchanged library default, like ``g = 0`` of a mass) and zeros are inserted as numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.dag import Expr, postorder, slots
from lmoc.expression.evaluate import evaluate
from lmoc.expression.to_sympy import exact, lower
from lmoc.ir.flat import FlatDAE, Kind

if TYPE_CHECKING:
    import sympy


_CASES = frozenset(("if", "min", "max", "abs", "sign"))


class ParameterSymbols:
    """Expressions for the constants and parameters of a flat model, made on demand.

    Parameters
    ----------
    flat : FlatDAE
    values : (flat.count,)
        The values in force.

    Attributes
    ----------
    used : {Symbol: value}
        The independent parameters met so far; NaN for one without a value.
    variable : {Symbol: flat variable}
        Where they stand.
    """

    def __init__(self, flat: FlatDAE, values: np.ndarray):
        self.flat = flat
        self.values = values
        self.used: dict[sympy.Symbol, float] = {}
        self.variable: dict[sympy.Symbol, int] = {}
        self._known: dict[int, sympy.Expr] = {}
        self._row: dict[int, tuple[int, int]] = {}
        for b, assignments in enumerate(flat.bindings):
            for row, target in enumerate(assignments.target.tolist()):
                self._row[target] = (b, row)

    def __getitem__(self, variable: int) -> sympy.Expr:
        if variable not in self._known:
            self._known[variable] = self._expression(variable)
        return self._known[variable]

    def _expression(self, variable: int) -> sympy.Expr:
        import sympy as sp

        value = float(self.values[variable])
        block = self.flat.block_at(variable)
        if value == 0.0 or block.structural or block.quantity in ("Boolean", "Integer", "String"):
            return exact(value)
        place = self._row.get(variable)
        if place is not None:
            binding = self.flat.bindings[place[0]]
            columns = binding.slots[place[1]]
            bound = float(np.ravel(evaluate(binding.shape, lambda k, _: self.values[columns[k]]))[0])
            untouched = bound == value or (np.isnan(bound) and np.isnan(value))
            if untouched and slots(binding.shape) and not (_from_library(binding.span) and _has_cases(binding.shape)):
                return lower(binding.shape, lambda k, _: self[int(columns[k])])
            if untouched and (block.kind == Kind.CONSTANT or _from_library(binding.span)):
                return exact(value)
        symbol = sp.Symbol(self.flat.variable_name(variable))
        self.used[symbol] = value
        self.variable[symbol] = variable
        return symbol


def _has_cases(shape: Expr) -> bool:
    """Return whether an expression is not a single formula (slopes of a table, say): only its name is printed."""
    return any(node.op in _CASES for node in postorder(shape))


def _from_library(span) -> bool:
    """A number written in the library and not in the user's file."""
    return span is not None and span.source.name.startswith("stdlib/")
