"""Long expressions with sines and cosines made shorter by plain steps: `sympy.trigsimp` searches for minutes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.sorting import without_squares

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.curves import NamedCurves

MOST_CANCELLED = 600  # operations of a quotient that is brought into lowest terms
MOST_COLLECTED = 300  # operations of a sum whose like terms are put together
MOST_GATHERED = 150  # operations of an expression whose products of sines and cosines are put together
MOST_FACTORED = 800  # operations of an equation along a curve whose factors are looked for


def along_tangents(residual: sympy.Expr, curves: NamedCurves | None) -> sympy.Expr:
    """Return an equation without the lengths of tangents that all its terms have: forces in the place of powers.

    Of ``l·(l·s̈ + l'·ṡ² + g·sin φ)`` the sum; of a disk on a curve ``l − r·φ'`` is left out, the way of its centre.
    """
    import sympy as sp

    lengths = set() if curves is None else curves.lengths
    if curves is None or not residual.free_symbols & lengths or residual.count_ops() > MOST_FACTORED:
        return residual
    top, bottom = sp.fraction(sp.together(residual))
    number, factors = sp.factor_list(without_squares(sp.expand(top / bottom.as_coeff_Mul()[0])))
    left_out = [(f, n) for f, n in factors if _is_a_length(f, lengths)]
    if not left_out:
        return residual
    sign = sp.Mul(*(sp.sign(f.coeff(next(iter(f.free_symbols & lengths)))) ** n for f, n in left_out))
    return sp.expand(sign * number * sp.Mul(*(f**n for f, n in factors if (f, n) not in left_out)))


def _is_a_length(factor: sympy.Expr, lengths: set[sympy.Symbol]) -> bool:
    """Return whether a factor is the length of a tangent, or one along with it, and nothing that moves by itself."""
    import sympy as sp

    (of, *others) = factor.free_symbols & lengths or {None}
    rates = any(s.name.startswith("der(") for s in factor.free_symbols)
    return bool(of) and not others and not rates and not factor.has(sp.sin, sp.cos) and factor.coeff(of).is_Number


def tidy(value: sympy.Expr) -> sympy.Expr:
    """Return a quotient without common factors, products of sines and cosines put together where that is shorter."""
    import sympy as sp

    if value.count_ops() > MOST_CANCELLED:
        return value
    top, bottom = (sp.factor_terms(_gathered(sp.expand(e))) for e in sp.fraction(cancelled(value)))
    number, rest = (top / bottom).as_coeff_Mul()
    spread = sp.Mul(*(sp.expand_mul(number * f) if k == 0 else f for k, f in enumerate(_sums_first(rest))))
    return min((number * rest, spread), key=lambda e: e.count_ops())


def _sums_first(product: sympy.Expr) -> list[sympy.Expr]:
    import sympy as sp

    return sorted(sp.Mul.make_args(product), key=lambda f: not f.is_Add)


def _gathered(value: sympy.Expr) -> sympy.Expr:
    """``sin(a)·cos(b) − cos(a)·sin(b)`` as ``sin(a − b)`` (Fu, Zhong and Zeng 2006, rule TR10⁻¹)."""
    import sympy as sp
    from sympy.simplify.fu import TR10i

    if not value.has(sp.sin) or value.count_ops() > MOST_GATHERED:
        return value
    return min((value, sp.factor_terms(TR10i(value))), key=lambda e: e.count_ops())


def collected(value: sympy.Expr, symbols: Iterable[sympy.Symbol]) -> sympy.Expr:
    """Return a sum by some symbols in it, sines and cosines put together in each coefficient."""
    import sympy as sp

    value = sp.expand_mul(value)
    if value.count_ops() > MOST_COLLECTED:
        return value
    sums: dict[sympy.Expr, list[sympy.Expr]] = {}
    for term in sp.Add.make_args(value):
        coefficient, factor = term.as_independent(*symbols, as_Add=False)
        sums.setdefault(factor, []).append(coefficient)
    return sp.Add(*(_gathered(without_squares(sp.Add(*of))) * factor for factor, of in sums.items()))
