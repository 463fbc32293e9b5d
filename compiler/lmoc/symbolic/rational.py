"""Rational functions in lowest terms, by arithmetic in their field.

`sympy.cancel` first multiplies everything out over one denominator and then looks for a common factor; sums of nested
fractions swell on that way. Here the expression is evaluated in the field, node by node, so that every intermediate
result is in lowest terms already. What is no sum, product or whole power (a sine) counts as one more variable.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy


def cancelled(value: sympy.Expr) -> sympy.Expr:
    """The expression as a quotient of two polynomials without common factor."""
    import sympy as sp

    if value.is_Number or value.is_Symbol:
        return value
    leaves = sorted(_leaves(value), key=sp.default_sort_key)
    if not leaves:
        return sp.cancel(value)
    if value.has(sp.Float):
        return value
    domain = sp.QQ.frac_field(*leaves)
    known = dict(zip(leaves, domain.gens, strict=True))
    return domain.to_sympy(_evaluate(value, domain, known))


def _leaves(value: sympy.Expr) -> set:
    found, open_nodes, seen = set(), [value], set()
    while open_nodes:
        node = open_nodes.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.is_Rational:
            continue
        if node.is_Add or node.is_Mul:
            open_nodes.extend(node.args)
        elif node.is_Pow and node.exp.is_Integer:
            open_nodes.append(node.base)
        else:
            found.add(node)
    return found


def _evaluate(node: sympy.Expr, domain, known: dict):
    """Memoized by `known`."""
    if node in known:
        return known[node]
    if node.is_Rational:
        result = domain.convert(domain.domain.from_sympy(node))
    elif node.is_Add:
        result = domain.zero
        for part in node.args:
            result += _evaluate(part, domain, known)
    elif node.is_Mul:
        result = domain.one
        for part in node.args:
            result *= _evaluate(part, domain, known)
    else:
        result = _evaluate(node.base, domain, known) ** int(node.exp)
    known[node] = result
    return result
