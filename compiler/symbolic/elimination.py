"""Sparse linear equations with symbolic coefficients, solved compactly.

Gaussian elimination in the order of Markowitz (Management Science 3 (1957) 255), but with the plainest pivot first: a
number before a single parameter before a sum. Connections and reactions have coefficients ±1 and go without leaving
a trace; what remains to be divided by is what a person would divide by: a mass matrix. The right-hand sides are carried
as combinations of the original ones, so coefficients stay rational functions of the parameters only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy

Row = dict[int, "sympy.Expr"]


@dataclass(frozen=True, eq=False)
class Elimination:
    """What elimination found.

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


def tidy(value: sympy.Expr) -> sympy.Expr:
    """A coefficient in lowest terms; cheap where nothing is to be done."""
    import sympy as sp

    return value if value.is_Number or value.is_Symbol else sp.cancel(value)


def eliminate(rows: Sequence[Mapping[int, sympy.Expr]], keep_last: Sequence[int] = ()) -> Elimination:
    """Solve ``Σ rows[i][x]·x = right[i]`` for all unknowns x that occur.

    Parameters
    ----------
    rows : coefficients by unknown, for each equation
    keep_last : unknowns
        Taken as pivots only when nothing else is left: they stay free where the equations leave a choice.
    """
    import sympy as sp

    left = [{x: tidy(sp.sympify(c)) for x, c in row.items()} for row in rows]
    left = [{x: c for x, c in row.items() if c != 0} for row in left]
    right: list[Row] = [{i: sp.S.One} for i in range(len(rows))]
    late = set(keep_last)
    open_rows = {i for i, row in enumerate(left) if row}
    order: list[tuple[int, int]] = []
    while open_rows:
        i, pivot = _best_pivot(left, open_rows, late)
        open_rows.discard(i)
        order.append((i, pivot))
        for j in [j for j in open_rows if pivot in left[j]]:
            factor = tidy(left[j][pivot] / left[i][pivot])
            _subtract(left[j], left[i], factor)
            _subtract(right[j], right[i], factor)
            left[j].pop(pivot, None)
            if not left[j]:
                open_rows.discard(j)
    used = {i for i, _ in order}
    conditions = [right[i] for i in range(len(rows)) if i not in used]
    return _back(left, right, order, conditions)


def _best_pivot(left: list[Row], open_rows: set[int], late: set[int]) -> tuple[int, int]:
    column_count: dict[int, int] = {}
    for i in open_rows:
        for x in left[i]:
            column_count[x] = column_count.get(x, 0) + 1
    best, choice = None, (-1, -1)
    for i in sorted(open_rows):
        for x, c in left[i].items():
            plainness = 0 if c.is_Number else 1 if c.is_Symbol else 2 + c.count_ops()
            cost = (x in late, plainness > 0, (len(left[i]) - 1) * (column_count[x] - 1), plainness, i, x)
            if best is None or cost < best:
                best, choice = cost, (i, x)
    return choice


def _subtract(target: Row, source: Row, factor: sympy.Expr) -> None:
    for x, c in source.items():
        value = tidy(target.get(x, 0) - factor * c)
        if value == 0:
            target.pop(x, None)
        else:
            target[x] = value


def _back(left: list[Row], right: list[Row], order: list[tuple[int, int]], conditions: list[Row]) -> Elimination:
    solution: dict[int, Row] = {}
    by_free: dict[int, Row] = {}
    for i, pivot in reversed(order):
        p = left[i][pivot]
        combination, free = dict(right[i]), {}
        for x, c in left[i].items():
            if x == pivot:
                continue
            if x in solution:
                _subtract(combination, solution[x], c)
                _subtract(free, by_free[x], c)
            else:
                _subtract(free, {x: c}, 1)
        solution[pivot] = {j: tidy(c / p) for j, c in combination.items()}
        by_free[pivot] = {x: tidy(c / p) for x, c in free.items()}
    return Elimination(solution, by_free, conditions)
