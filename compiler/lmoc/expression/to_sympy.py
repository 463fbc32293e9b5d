"""Shapes as SymPy expressions, for what a person reads and for oracles; never on the way of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, Any

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, resolve

if TYPE_CHECKING:
    import sympy

_SMALL_DENOMINATOR = 10_000
_MOST_PARTS = 24  # of a turn's half that are recognized: π/24
_AS_WRITTEN = 2e-15  # relative: people write 3.14159265358979


def exact(value: float) -> sympy.Expr:
    """Return the number a person meant: 0.5 → 1/2, 0.0833333333333333 → 1/12, 9.81 → 981/100, 3.14159265358979 → π."""
    import sympy

    if not math.isfinite(value):
        return sympy.sympify(value)
    simple = Fraction(value).limit_denominator(_SMALL_DENOMINATOR)
    if float(simple) == value:
        return sympy.Rational(simple.numerator, simple.denominator)
    turns = Fraction(value / math.pi).limit_denominator(_MOST_PARTS)
    if 0 < abs(turns.numerator) <= 1000 and abs(float(turns) * math.pi - value) <= _AS_WRITTEN * abs(value):
        return sympy.Rational(turns.numerator, turns.denominator) * sympy.pi
    return sympy.Rational(repr(float(value)))


def lower(root: Expr, column: Callable[[int, int], sympy.Expr], time: sympy.Expr | None = None) -> sympy.Expr:
    """A shape with ``column(k, order)`` in its slots.

    Parameters
    ----------
    root : Expr
    column : callable
        The content of a slot.
    time : expression, optional
        The symbol of time; ``Symbol("time")`` without it.

    Returns
    -------
    sympy.Expr
        Not simplified, numbers exact. Relations inside `if` become conditions of a `Piecewise`; logical values that
        are known numbers (Boolean parameters) select a branch at once.
    """
    return lower_with(root, column, {}, time)


def lower_with(
    root: Expr,
    column: Callable[[int, int], sympy.Expr],
    others: Mapping[str, Callable[..., Any]],
    time: sympy.Expr | None = None,
) -> sympy.Expr:
    """As `lower`, with other meanings of some operators."""
    import sympy

    operations = {**_operations(), **others}
    values: dict[int, sympy.Basic] = {}
    for node in postorder(root):
        if node.op == "const":
            value = exact(node.value)
        elif node.op == "slot":
            value = column(*node.value)
        elif node.op == "time":
            value = sympy.Symbol("time") if time is None else time
        else:
            value = operations[node.op](*(values[id(a)] for a in node.args))
        values[id(node)] = value
    return values[id(root)]


@cache
def _operations() -> dict[str, Callable[..., Any]]:
    """The operators of the DAG in SymPy; made on first use, because SymPy takes long to import."""
    import sympy

    return {name: resolve(f.sympy, sympy) for name, f in FUNCTIONS.items()}
