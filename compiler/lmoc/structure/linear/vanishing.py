"""Terms whose coefficient is zero for the present parameter values: they are taken out of their equations.

``J·der(omega) = tau`` with J = 0 is the equation ``0 = tau``: another structure, not a small number. Every such
decision is a guard, to be checked for each further parameter set.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import cache

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.evaluate import evaluate
from lmoc.expression.text import to_text
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.reduced import Guard
from lmoc.structure.linear.coefficients import (
    ROUNDOFF,
    compound_coefficients,
    factors_of,
    linear_form,
    linear_sum,
    renumbered,
    signed,
    value_and_size,
    without_factors,
)
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.structure.linear.generic import spread
from lmoc.structure.linear.substitution import Rows, partition
from lmoc.support.records import dataclass


class Missing(IntEnum):
    """The value assumed for a parameter without one."""

    ANYTHING = 0  # a number that nothing cancels
    EQUAL = 1  # equal to the others: gears in a loop are meant to agree
    FITTING = 2  # whatever makes the sum vanish: lengths in a loop are meant to add up


@dataclass(frozen=True, eq=False)
class Vanishing:
    """The test ``|expr(slots[i])| ≤ roundoff`` row by row, with what came out."""

    expr: Expr
    slots: np.ndarray
    zero: np.ndarray  # (n,) bool
    derived: DerivedParameters
    missing: Missing

    def __call__(self, values: np.ndarray) -> bool:
        return not self.changed(values).any()

    def of_runs(self, values: np.ndarray) -> np.ndarray | None:
        """Return what this says of values (variables, runs); None where runs have to be asked for one by one."""
        zero, unclear = _judged(self.expr, self.slots, self._known(values), self.derived)
        return None if unclear.any() else ~(zero != self.zero[:, None]).any(axis=0)

    def changed(self, values: np.ndarray) -> np.ndarray:
        """The rows that come out otherwise for other parameter values; one bool a row."""
        known = self._known(values)
        result: np.ndarray = vanishes(self.expr, self.slots, known, self.derived, self.missing) != self.zero
        return result

    def _known(self, values: np.ndarray) -> np.ndarray:
        """Return the values of all variables that the test reads."""
        beyond = self.slots.size > 0 and int(self.slots.max()) >= self.derived.base
        return self.derived.extended(values) if beyond else values


@dataclass(frozen=True, eq=False)
class _Changed:
    """For other parameter values: the first row that comes out otherwise, as it was assumed."""

    flat: FlatDAE
    group: Rows
    expr: Expr
    test: Vanishing

    def __call__(self, values: np.ndarray) -> str:
        row = int(np.argmax(self.test.changed(values)))
        return row_text(self.flat, self.test.derived, self.group, self.expr, row) + _outcome(self.test.zero[row])


def vanishes(
    expr: Expr, table: np.ndarray, known: np.ndarray, derived: DerivedParameters, missing: Missing
) -> np.ndarray:
    """Return where the value is zero to within the roundoff of its terms; one bool a row."""
    zero, unclear = _judged(expr, table, known, derived)
    if unclear.any():
        if missing == Missing.FITTING:
            fitting: np.ndarray = zero | unclear
            return fitting
        values = known[: derived.base]
        lacking = np.isnan(values)
        stand_in = 1.0 + (missing == Missing.ANYTHING) * spread(len(values))
        filled = derived.extended(np.where(lacking, stand_in, values))
        zero = np.where(unclear, _judged(expr, table, filled, derived)[0], zero)
    return zero


def _judged(
    expr: Expr, table: np.ndarray, known: np.ndarray, derived: DerivedParameters
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the value vanishes, and where it is undefined, by rows (and runs)."""
    if _rounds(expr) or (table.size and table.max() >= derived.base):
        value, size = value_and_size(expr, known[table], derived.sizes(known, table))
        zero = np.abs(value) <= ROUNDOFF * size
    else:
        value = evaluate(expr, lambda k, _: known[table[:, k]])
        zero = np.equal(value, 0.0)
    none = np.zeros((len(table), *known.shape[1:]), bool)  # where the value is one number for all rows
    return zero | none, np.isnan(value) | none


@cache
def _rounds(expr: Expr) -> bool:
    """Return whether the value of an expression that vanishes may differ from 0 by rounding."""
    return any(n.op in ("add", "sub", "sin", "cos", "tan") for n in postorder(expr))


class Splitter:
    """Splits groups by vanishing coefficients and keeps the guards."""

    def __init__(self, flat: FlatDAE, derived: DerivedParameters):
        self.flat = flat
        self.derived = derived
        self.guards: list[Guard] = []
        self._tested: dict[tuple[Expr, Missing, bytes], np.ndarray] = {}

    def by_factors(self, group: Rows) -> list[Rows]:
        """Parts of the group in which no factor that is a parameter expression is zero."""
        tests = factors_of(group.shape, group.kinds)
        result = self._split(group, tests, lambda g, zero: g.with_shape(without_factors(g.shape, zero)))
        return [part for g in result for part in self.by_coefficients(g)]

    def by_coefficients(self, group: Rows) -> list[Rows]:
        """The same for coefficients of linear equations in which terms cancel, as N1 - N2 in a loop of gears."""
        compound = compound_coefficients(group.shape, group.kinds)
        form = linear_form(group.shape, group.kinds)
        if not compound or form is None:
            return [group]
        coefficients, rest = form

        def without(g: Rows, zero: tuple[Expr, ...]) -> Rows:
            kept = {leaf: c for leaf, c in coefficients.items() if c not in zero}
            return g.with_shape(linear_sum(kept, rest))

        return self._split(group, tuple(dict.fromkeys(c for _, c in compound)), without)

    def _split(
        self, group: Rows, tests: tuple[Expr, ...], without: Callable[[Rows, tuple[Expr, ...]], Rows]
    ) -> list[Rows]:
        if not tests:
            return [group]
        # where one coordinate only is left in a row, its coefficient is the difference of two ratios
        missing = Missing.EQUAL if group.looped == 2 else Missing.ANYTHING
        outcome = np.stack([self.vanishing(group, test, missing) for test in tests], axis=1)
        parts = []
        for pattern, rows in partition(outcome):
            part = group if rows is None else group.take(rows)
            zero = tuple(t for t, z in zip(tests, pattern, strict=True) if z)
            parts.append(without(part, zero) if zero else part)
        return parts

    def vanishing(self, group: Rows, expr: Expr, missing: Missing) -> np.ndarray:
        """The test for all rows, recorded as a guard."""
        expr = signed(expr)[1]
        shape, columns = renumbered(expr)
        table = group.slots[:, list(columns)]
        key = (shape, missing, table.tobytes())
        if key not in self._tested:
            zero = vanishes(shape, table, self.derived.known, self.derived, missing)
            self._tested[key] = zero
            if not all(i < self.flat.count and self.flat.kind[i] == Kind.CONSTANT for i in table[0].tolist()):
                holds = Vanishing(shape, table, zero, self.derived, missing)
                self.guards.append(Guard(holds, self._text(group, expr, zero), _Changed(self.flat, group, expr, holds)))
        return self._tested[key]

    def _text(self, group: Rows, expr: Expr, zero: np.ndarray) -> str:
        """Return the assumption in words, for the first row that vanishes, or for the first of all."""
        some = bool(zero.any())
        row = int(np.argmax(zero)) if some else 0
        count = int(zero.sum()) if some else len(zero)
        text = self.text(group, expr, row) + _outcome(zero[row])
        return text if count == 1 else f"{text} (and {count - 1} more)"

    def text(self, group: Rows, expr: Expr, row: int) -> str:
        return row_text(self.flat, self.derived, group, expr, row)


def _outcome(zero: bool) -> str:
    return " = 0" if zero else " <> 0"


def row_text(flat: FlatDAE, derived: DerivedParameters, group: Rows, expr: Expr, row: int) -> str:
    """Return an expression over one row of a group in the user's names."""
    names = group.slots[row].tolist()

    def name(column: int, order: int) -> str:
        text = derived.text(names[column], flat.variable_name)
        for _ in range(order):
            text = f"der({text})"
        return text

    return to_text(expr, name)
