"""Equations solved for one of their jets, and what shapes look like as formulas over registers; once for each shape."""

from __future__ import annotations

from functools import cache

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ZERO, Expr, mul, neg, slot, slots, sub, substitute
from lmoc.structure.linear.coefficients import Kinds, is_constant, ratio


@cache
def as_formula(expr: Expr) -> tuple[Expr, tuple[Expr, ...]]:
    """The expression with its i-th jet as ``slot(i)``, and the jets: what a step over registers wants."""
    leaves = slots(expr)
    return substitute(expr, {leaf: slot(i) for i, leaf in enumerate(leaves)}), leaves


@cache
def solved(residual: Expr, leaf: Expr) -> Expr | None:
    """The value of `leaf` for which the residual vanishes, where that is linear in it; else None.

    Of a product only the factor with the leaf must vanish: ``cos(theta)*(l1*f1 + l2*f2) = 0`` gives f2 at a dead
    centre too.
    """
    while residual.op in ("mul", "neg"):
        having = [a for a in residual.args if leaf in slots(a)]
        if len(having) != 1:
            break
        residual = having[0]
    parts = linear_parts(residual, (leaf,))
    if parts is None or leaf not in parts[0]:
        return None
    return _quotient(neg(parts[1]), parts[0][leaf])


def solution(residual: Expr, leaf: Expr) -> Expr:
    """The value of `leaf` where the residual has a `pivot` for it: it is linear in it, and can be solved.

    Raises
    ------
    ValueError
        It has none.
    """
    found = solved(residual, leaf)
    if found is None:
        raise ValueError(f"{residual} is not linear in {leaf}")
    return found


@cache
def pivot(residual: Expr, kinds: Kinds, leaf: Expr) -> Expr | None:
    """The coefficient of `leaf` where it depends on parameters only, else None: an equation that is safe to solve."""
    parts = linear_parts(residual, (leaf,))
    coefficient = None if parts is None else parts[0].get(leaf)
    return coefficient if coefficient is not None and is_constant(coefficient, kinds) else None


@cache
def jointly_linear(residual: Expr, leaves: tuple[Expr, ...]) -> tuple[tuple[Expr, Expr], ...] | None:
    """Pairs (leaf, coefficient) where the residual is linear in all leaves together, in each branch, else None."""
    parts = linear_parts(residual, leaves, in_branches=True)
    return None if parts is None else tuple(parts[0].items())


def solve_pair(residuals: tuple[Expr, ...], leaves: tuple[Expr, ...]) -> tuple[Expr, ...] | None:
    """One or two linear equations solved by Cramer's rule; None where they are not linear."""
    parts = [p for r in residuals if (p := linear_parts(r, leaves)) is not None]
    if len(parts) < len(residuals):
        return None
    matrix = [[p[0].get(leaf, ZERO) for leaf in leaves] for p in parts]
    right = [neg(p[1]) for p in parts]
    if len(leaves) == 1:
        return None if matrix[0][0] is ZERO else (_quotient(right[0], matrix[0][0]),)
    (a, b), (c, d) = matrix
    determinant = sub(mul(a, d), mul(b, c))
    if determinant is ZERO:
        return None
    first = sub(mul(right[0], d), mul(b, right[1]))
    second = sub(mul(a, right[1]), mul(right[0], c))
    return _quotient(first, determinant), _quotient(second, determinant)


def _quotient(numerator: Expr, denominator: Expr) -> Expr:
    sign, value = ratio(numerator, denominator)
    return neg(value) if sign < 0 else value
