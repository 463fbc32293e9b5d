"""Determinants of sparse matrices over a ring of polynomials, by minors.

Row by row, the minors of the rows so far are kept for each set of columns (W. M. Gentleman and S. C. Johnson, ACM
TOMS 2 (1976) 232): nothing is divided, so nothing swells that does not stay. A set without a column that no later row
has is dropped, so that the number of sets is bounded by the width of the matrix and not by its size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Element = Any  # of a ring of polynomials


class TooLongError(Exception):
    """The determinant has more terms than are wanted."""


def determinant(rows: Sequence[Mapping[int, Element]], one: Element, most_terms: int) -> Element:
    """Return the determinant of a square matrix.

    Parameters
    ----------
    rows : {column: element} for each row, without zeros
    one : of the ring
    most_terms : of all minors of some rows together

    Raises
    ------
    TooLongError
        There are more.
    """
    order, sign = _narrow(rows)
    last = {column: k for k, i in enumerate(order) for column in rows[i]}
    minors = {0: one}
    for k, i in enumerate(order):
        closing = sum(1 << column for column, at in last.items() if at == k)
        further: dict[int, Element] = {}
        for columns, minor in minors.items():
            for column, value in rows[i].items():
                if columns >> column & 1:
                    continue
                both = columns | 1 << column
                if both & closing != closing:
                    continue
                term = minor * value
                if (columns >> column).bit_count() % 2:
                    term = -term
                further[both] = further[both] + term if both in further else term
        minors = {columns: minor for columns, minor in further.items() if minor}
        if sum(len(minor) for minor in minors.values()) > most_terms:
            raise TooLongError
    if not minors:
        return one - one
    (found,) = minors.values()
    return -found if sign < 0 else found


def _narrow(rows: Sequence[Mapping[int, Element]]) -> tuple[list[int], int]:
    """An order of the rows in which few columns are open at a time, and the sign of that permutation."""
    left, open_columns, order = set(range(len(rows))), set(), []
    while left:
        i = min(left, key=lambda r: (len(rows[r].keys() - open_columns), len(rows[r]), r))
        order.append(i)
        left.discard(i)
        open_columns |= rows[i].keys()
    return order, _parity(order)


def _parity(order: Sequence[int]) -> int:
    seen, sign = set(), 1
    for start in range(len(order)):
        length, k = 0, start
        while k not in seen:
            seen.add(k)
            k, length = order[k], length + 1
        if length and length % 2 == 0:
            sign = -sign
    return sign
