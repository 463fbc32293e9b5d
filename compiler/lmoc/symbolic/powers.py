"""Polynomials in what moves, with roots of parameters among their coefficients."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy


def in_powers(residual: sympy.Expr, moving: list[sympy.Symbol]) -> sympy.Expr:
    """Return a polynomial in what moves with collected coefficients, zero ones left out; anything else unchanged.

    Parameters
    ----------
    moving : jets of the coordinates, and inputs
    """
    import sympy as sp

    if not moving or not residual.is_polynomial(*moving):
        return residual
    residual, roots = _with_root_symbols(residual)
    total = sp.S.Zero
    for powers, coefficient in sp.Poly(residual, *moving).terms():
        for root, (n, radicand) in roots.items():
            coefficient = sp.rem(coefficient, root**n - radicand, root)
        coefficient = sp.factor_terms(sp.cancel(coefficient))
        for root, (n, radicand) in roots.items():
            coefficient = coefficient.xreplace({root**k: _root(radicand, n, k) for k in range(1, n)})
        total += coefficient * sp.Mul(*(x**n for x, n in zip(moving, powers, strict=True)))
    return total


def _with_root_symbols(value: sympy.Expr) -> tuple[sympy.Expr, dict[sympy.Symbol, tuple[int, sympy.Expr]]]:
    """Return an expression with a symbol for each root in it, and {symbol: (degree, radicand)}."""
    import sympy as sp

    roots = {}
    for power in [p for p in value.atoms(sp.Pow) if p.exp.is_Rational and p.exp.p == 1 and p.exp.q > 1]:
        symbol, n, radicand = sp.Dummy(), int(power.exp.q), power.base
        if radicand.func is sp.Abs and n % 2 and value.has(sp.sign(radicand.args[0])):
            radicand = radicand.args[0]
            value = value.subs(power, symbol / sp.sign(radicand))  # sign(v)·|v|^(1/3)
        else:
            value = value.xreplace({power: symbol})
        roots[symbol] = n, radicand
    return value, roots


def _root(radicand: sympy.Expr, n: int, power: int) -> sympy.Expr:
    """Return a power of the real n-th root."""
    import sympy as sp

    if n % 2 == 0 or radicand.func is sp.Abs:
        return radicand ** sp.Rational(power, n)
    size = sp.Abs(radicand) ** sp.Rational(power, n)
    return size if power % 2 == 0 else sp.sign(radicand) * size
