"""Derivatives of expressions in plain symbols, which stand for real numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import sympy

_EXACT = 2**53  # whole numbers up to here are floats


def slope(value: sympy.Expr, x: sympy.Symbol) -> sympy.Expr:
    """∂value/∂x, where it exists.

    SymPy takes a plain symbol as complex, and has no use for the derivative of its absolute value; so what has a
    kink is differentiated with real symbols in the place of the plain ones.
    """
    import sympy as sp

    if not value.has(sp.Abs, sp.sign, sp.Max, sp.Min, sp.floor, sp.ceiling):
        return value.diff(x)
    if not value.has(x):
        return sp.S.Zero
    real = {s: sp.Dummy(s.name, real=True) for s in value.free_symbols}
    found = value.xreplace(real).diff(real[x])
    found = found.replace(lambda e: isinstance(e, (sp.DiracDelta, sp.Derivative, sp.Subs)), lambda e: sp.S.Zero)
    return found.xreplace({dummy: s for s, dummy in real.items()})


def in_numpy(unknowns: object, value: object) -> Callable[..., Any]:
    """Return a function of arrays that computes expressions.

    Parameters
    ----------
    unknowns, value : as of `sympy.lambdify`. Whole numbers that are no floats (1/10³⁰⁸ has one) become floats, infinite
        where they are too large: Python's own would end the evaluation
    """
    import sympy as sp

    def in_floats(item: object) -> object:
        if isinstance(item, (list, tuple)):
            return [in_floats(part) for part in item]
        expression = sp.sympify(item)
        large = {n: sp.Float(n, 17) for n in expression.atoms(sp.Rational) if max(abs(n.p), n.q) > _EXACT}
        return expression.xreplace(large) if large else expression

    return sp.lambdify(unknowns, in_floats(value), "numpy")
