"""Rows as linear combinations of terms: jets, and nonlinear functions of them told apart by their values.

``q = l*sin(theta)`` is a combination of ``q`` and ``sin(theta)`` with constant coefficients. Rows that depend on each
other as combinations of the same terms do so in every position of the mechanism. Two terms are the same up to a factor
when their values at a few generic points are (J. T. Schwartz, J. ACM 27, 1980, for polynomials): so ``(x - y)^2`` is
``(y - x)^2``, and ``sin(-theta)`` is ``-sin(theta)``, however they were written.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lmoc.expression.dag import ONE, ZERO, Expr, add, mul, neg, postorder, sub
from lmoc.structure.linear.coefficients import KNOWN, ROUNDOFF, Kinds, constant_nodes, value_and_size
from lmoc.structure.linear.explicit import as_formula
from lmoc.structure.linear.generic import GOLDEN
from lmoc.structure.linear.substitution import Rows, with_numbers
from lmoc.support.distinct import numbered

# one point gives the factor between two terms, the others tell whether it is the same everywhere
POINTS = 4
SAME = 1e-9
# without a value a parameter is taken for a number that nothing cancels
WITHOUT_VALUE = 2.0**0.5

Combination = tuple[dict[Expr, Expr], Expr]


@cache
def terms_of(shape: Expr, kinds: Kinds) -> Combination:
    """The shape as ``Σ coefficient·term + rest`` with constant coefficients and rest."""
    constant = constant_nodes(shape, kinds)
    parts: dict[int, Combination] = {}
    for node in postorder(shape):
        parts[id(node)] = ({}, node) if constant[id(node)] else _combined(node, [parts[id(a)] for a in node.args])
    return parts[id(shape)]


def _combined(node: Expr, parts: list[Combination]) -> Combination:
    op = node.op
    if op == "neg":
        return _scaled(parts[0], neg)
    if op in ("add", "sub"):
        combine = add if op == "add" else sub
        (a, rest_a), (b, rest_b) = parts
        total = {term: combine(a.get(term, ZERO), b.get(term, ZERO)) for term in {**a, **b}}
        return {term: c for term, c in total.items() if c is not ZERO}, combine(rest_a, rest_b)
    if op == "div" and not parts[1][0]:
        return _scaled(parts[0], lambda c: c / parts[1][1])
    if op == "mul":
        (a, rest_a), (b, rest_b) = parts
        if not a or not b:
            factor = rest_a if not a else rest_b
            return _scaled(parts[1] if not a else parts[0], lambda c: mul(factor, c))
        if len(a) == len(b) == 1 and rest_a is rest_b is ZERO:
            (term_a, factor_a), (term_b, factor_b) = *a.items(), *b.items()
            return {mul(term_a, term_b): mul(factor_a, factor_b)}, ZERO
    return {node: ONE}, ZERO


def _scaled(part: Combination, scale: Callable[[Expr], Expr]) -> Combination:
    return {term: scale(c) for term, c in part[0].items()}, scale(part[1])


# ------------------------------------------------------------------------ numbers


def generic(variable: np.ndarray, order: int, point: int = 0) -> np.ndarray:
    """Values of jets at a generic point, between 0.2 and 1.2; no two alike."""
    return 0.2 + (variable + 1 + 0.754877666 * order + 0.569840291 * point) * GOLDEN * (1 + point) % 1.0


def value_at(
    expr: Expr, g: Rows, known: np.ndarray, point: int = 0, place: np.ndarray | None = None
) -> np.ndarray:
    """(rows,) values of an expression at a generic point; 0 where its terms cancel to within roundoff.

    Parameters
    ----------
    known : values of all extended variables, NaN for unknowns
    place : (orders, extended) values of the jets, instead of those of a generic point
    """
    formula, leaves = as_formula(expr)
    columns = []
    for k, order in (leaf.value for leaf in leaves):
        variable = g.slots[:, k]
        if g.kinds[k] == KNOWN:
            columns.append(np.nan_to_num(known[variable], nan=WITHOUT_VALUE))
        elif place is not None and order < len(place):
            columns.append(place[order, variable])
        else:
            columns.append(generic(variable, order, point))
    table = np.stack(columns, axis=1) if columns else np.zeros((len(g.source), 0))
    value, size = value_and_size(formula, table, np.abs(table), float(generic(np.array(len(known)), 0, point)))
    value = np.broadcast_to(np.asarray(value, float), len(g.source))
    return np.where(np.abs(value) <= ROUNDOFF * size, 0.0, value)


def entries(groups: tuple[Rows, ...], known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The matrix of coefficients (row, column, value): rows numbered through, a column for each term."""
    row, column, value = [], [], []
    curved: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # rows, values at the points, coefficients
    for g, numbers in with_numbers(groups):
        for term, c in terms_of(g.shape, g.kinds)[0].items():
            coefficient = value_at(c, g, known)
            if term.op == "slot":
                row.append(numbers)
                column.append(g.column(term) + term.value[1] * len(known))
                value.append(coefficient)
            else:
                values = np.stack([value_at(term, g, known, point) for point in range(POINTS)], axis=1)
                curved.append((numbers, values, coefficient))
    if curved:
        numbers, values, coefficient = (np.concatenate(parts) for parts in zip(*curved, strict=True))
        label, size = _told_apart(values)
        row.append(numbers)
        column.append(label - len(label))  # below the numbers of jets
        value.append(coefficient * size)
    return np.concatenate(row), np.concatenate(column), np.concatenate(value)


def _told_apart(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers from 0 on, equal for terms that are proportional, and the factor of each.

    Parameters
    ----------
    values : (terms, POINTS); a term without a value at some point is like no other one
    """
    with np.errstate(all="ignore"):
        ratios = values[:, 1:] / values[:, :1]
    alone = ~np.isfinite(ratios).all(axis=1)
    ratios[alone] = 0.0
    label = np.where(alone, 1 + np.arange(len(values)), 0)
    for ratio in ratios.T:
        order = np.argsort(ratio, kind="stable")
        ordered = ratio[order]
        near = np.empty(len(ratio), np.int64)
        near[order] = np.cumsum(np.diff(ordered, prepend=ordered[:1]) > SAME * np.abs(ordered))
        label = numbered(label.astype(np.int64) * len(ratio) + near)[1]
    return label, np.where(alone, 1.0, values[:, 0])
