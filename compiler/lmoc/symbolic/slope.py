"""Derivatives of expressions in plain symbols, which stand for real numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy


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
