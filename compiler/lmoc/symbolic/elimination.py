"""Sparse linear equations with symbolic coefficients, solved compactly.

Gaussian elimination in the order of Markowitz (Management Science 3 (1957) 255), but with the plainest pivot first: a
number before a single parameter before a sum. Connections and reactions have coefficients ±1 and go without leaving
a trace; what remains to be divided by is what a person would divide by: a mass matrix. The right-hand sides are carried
as combinations of the original ones, so coefficients stay rational functions of the parameters only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lmoc.support.records import dataclass
from lmoc.symbolic.too_long import no_symbols

if TYPE_CHECKING:
    import sympy

MOST_TERMS = 2_000  # of a coefficient; operations where it is no rational function of symbols

Row = dict[int, "sympy.Expr"]
Element = Any  # of a field of rational functions; a factor of a hundred faster than expressions
Sparse = dict[int, Element]


@dataclass(frozen=True, eq=False)
class Eliminated:
    """The result of elimination.

    Attributes
    ----------
    solution : {unknown: combination}
        ``unknown = Σ combination[j]·right[j] + Σ coefficient·free`` with the free part in `by_free`.
    by_free : {unknown: {free unknown: coefficient}}
        Empty combinations where everything is determined.
    conditions : list of combinations
        ``Σ combination[j]·right[j]`` must vanish: the equations contradict each other otherwise.
    """

    solution: dict[int, Row]
    by_free: dict[int, Row]
    conditions: list[Row]


def eliminate(
    rows: Sequence[Mapping[int, sympy.Expr]],
    keep_last: Sequence[int] = (),
    most: float = MOST_TERMS,
    wanted: Sequence[int] | None = None,
) -> Eliminated:
    """Solve ``Σ rows[i][x]·x = right[i]`` for all unknowns x that occur.

    Parameters
    ----------
    rows : coefficients by unknown, for each equation
    keep_last : unknowns
        Taken as pivots only when nothing else is left: they stay free where the equations leave a choice.
    most : terms of a coefficient, beyond which nobody reads the result
    wanted : unknowns whose solution is asked for; None for all

    Raises
    ------
    ModelError
        E0660 (`NoSymbolsError`) where a coefficient grows beyond `most` terms.
    """
    import sympy as sp

    places = [(i, x) for i, row in enumerate(rows) for x in row]
    field, elements = _field([sp.S.One, *(sp.sympify(rows[i][x]) for i, x in places)])
    left: list[Sparse] = [{} for _ in rows]
    for (i, x), element in zip(places, elements[1:], strict=True):
        if element:
            left[i][x] = element
    right: list[Sparse] = [{i: field.one} for i in range(len(rows))]
    order = _forward(left, right, set(keep_last), most)
    used = {i for i, _ in order}
    solution, by_free = _back(left, right, order if wanted is None else _needed(left, order, wanted), most)

    def readable(row: Sparse) -> Row:
        return {x: field.to_sympy(c) for x, c in row.items()}

    return Eliminated(
        {x: readable(row) for x, row in solution.items()},
        {x: readable(row) for x, row in by_free.items()},
        [readable(right[i]) for i in range(len(rows)) if i not in used],
    )


def _field(coefficients: list[sympy.Expr]) -> tuple[Any, list[Element]]:
    """Return a field that holds coefficients, and these in it.

    Sines and cosines of one angle are independent of each other there: neither they nor expressions, which SymPy would
    take instead, know that their squares add up to one.
    """
    import sympy as sp
    from sympy.polys.constructor import construct_domain

    field, elements = construct_domain(coefficients, field=True)
    if field.is_EX:
        rational, others = construct_domain(coefficients, field=True, composite=True)
        symbols = getattr(rational, "symbols", ())
        if rational.is_FractionField and rational.domain.is_Exact and all(
            s.is_Symbol or isinstance(s, sp.sin | sp.cos) for s in symbols
        ):
            return rational, others
    return field, elements


def _forward(left: list[Sparse], right: list[Sparse], late: set[int], most: float) -> list[tuple[int, int]]:
    """Pivots in order; eliminates each from the rows still open."""
    open_rows = {i for i, row in enumerate(left) if row}
    order: list[tuple[int, int]] = []
    while open_rows:
        i, pivot = _best_pivot(left, open_rows, late)
        open_rows.discard(i)
        order.append((i, pivot))
        for j in [j for j in open_rows if pivot in left[j]]:
            factor = left[j][pivot] / left[i][pivot]
            _subtract(left[j], left[i], factor, most)
            _subtract(right[j], right[i], factor, most)
            left[j].pop(pivot, None)
            if not left[j]:
                open_rows.discard(j)
    return order


def _best_pivot(left: list[Sparse], open_rows: set[int], late: set[int]) -> tuple[int, int]:
    column_count: dict[int, int] = {}
    for i in open_rows:
        for x in left[i]:
            column_count[x] = column_count.get(x, 0) + 1
    best, choice = None, (-1, -1)
    for i in sorted(open_rows):
        for x, c in left[i].items():
            size = _size(c)
            cost = (x in late, size > 0, (len(left[i]) - 1) * (column_count[x] - 1), size, i, x)
            if best is None or cost < best:
                best, choice = cost, (i, x)
    return choice


def _size(element: Element) -> int:
    """0 for a number, else the number of terms."""
    top, bottom = getattr(element, "numer", None), getattr(element, "denom", None)
    if not hasattr(top, "is_ground"):
        return 0
    return 0 if top.is_ground and bottom.is_ground else len(top) + len(bottom)


def _check_length(element: Element, most: float) -> None:
    expression = getattr(element, "ex", None)  # where the field is that of arbitrary expressions
    length = _size(element) if expression is None else expression.count_ops()
    if length > most:
        raise no_symbols("the equations are too long to be solved in symbols", hint="`lmoc linearize` works in numbers")


def _subtract(target: Sparse, source: Sparse, factor: Element, most: float) -> None:
    for x, c in source.items():
        value = target[x] - factor * c if x in target else -factor * c
        if value:
            if most < math.inf:
                _check_length(value, most)
            target[x] = value
        else:
            target.pop(x, None)


def _needed(left: list[Sparse], order: list[tuple[int, int]], wanted: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pivots that some unknowns follow from: a row holds its pivot, later pivots and what stays free."""
    read = set(wanted)
    needed = []
    for i, pivot in order:
        if pivot in read:
            needed.append((i, pivot))
            read.update(left[i])
    return needed


def _back(
    left: list[Sparse], right: list[Sparse], order: list[tuple[int, int]], most: float
) -> tuple[dict[int, Sparse], dict[int, Sparse]]:
    """Back substitution: each pivot by the right-hand sides and by the unknowns that stay free."""
    solution: dict[int, Sparse] = {}
    by_free: dict[int, Sparse] = {}
    for i, pivot in reversed(order):
        p = left[i][pivot]
        combination, free = dict(right[i]), {}
        for x, c in left[i].items():
            if x == pivot:
                continue
            if x in solution:
                _subtract(combination, solution[x], c, most)
                _subtract(free, by_free[x], c, most)
            else:
                _subtract(free, {x: c}, p / p, most)
        solution[pivot] = {j: c / p for j, c in combination.items()}
        by_free[pivot] = {x: c / p for x, c in free.items()}
    return solution, by_free
