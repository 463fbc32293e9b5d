"""Balances of flows while elimination goes on: rows of a sparse matrix of ±1, not expressions."""

from __future__ import annotations

from functools import cache

import numpy as np

from lmoc.expression.dag import ZERO, Expr, add, slot, sub
from lmoc.structure.linear.affine import Affine
from lmoc.structure.linear.coefficients import UNKNOWN
from lmoc.structure.linear.substitution import Rows
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

# longer balances are kept as sums to the end
LONGEST_SHAPE = 8


@dataclass(frozen=True, eq=False)
class SumRows:
    """``Σ sign[j]·variable[index[j]] = 0`` over the entries j with row[j] = i.

    Attributes
    ----------
    row : (nnz,) ascending
    source : (n,) number of the flat equation of each row
    """

    row: np.ndarray
    index: np.ndarray
    sign: np.ndarray
    source: np.ndarray

    @property
    def lengths(self) -> np.ndarray:
        return np.bincount(self.row, minlength=len(self.source))

    def take(self, keep: np.ndarray) -> SumRows:
        """The rows of a mask."""
        entries = keep[self.row]
        number = np.cumsum(keep, dtype=INDEX) - 1
        return SumRows(number[self.row[entries]], self.index[entries], self.sign[entries], self.source[keep])

    def select(self, entries: np.ndarray) -> SumRows:
        """All rows with some of their entries."""
        return SumRows(self.row[entries], self.index[entries], self.sign[entries], self.source)


@dataclass(frozen=True, eq=False)
class SumView:
    """The rows with roots in place of their variables.

    Attributes
    ----------
    plain : the rows all of whose terms are ± an unknown root, equal roots added up, vanished terms left out
    irregular : rows of the original sums that have other terms and are short: to be treated as equations
    rest : rows of the original sums that remain
    """

    plain: SumRows
    plain_rest: np.ndarray  # (n,) numbers in `rest` of the rows of `plain`
    irregular: SumRows
    rest: SumRows


def view(sums: SumRows, table: Affine, kind_of_root: np.ndarray, zero: int) -> SumView:
    """Sort the rows into those that are sums of roots still, and those that are not.

    A long row keeps a term with a factor, or with a known value, under its own variable.
    """
    root = table.root[sums.index]
    plain_entry = (table.factor[sums.index] < 0) & (table.offset[sums.index] < 0) & (table.order[sums.index] == 0)
    plain_entry &= kind_of_root[root] == UNKNOWN
    gone = (root == zero) & (table.offset[sums.index] < 0)
    odd = ~plain_entry & ~gone
    rows = len(sums.source)
    has_odd = np.bincount(sums.row[odd], minlength=rows) > 0
    length = np.bincount(sums.row[~gone], minlength=rows)
    irregular = has_odd & (length <= LONGEST_SHAPE)
    regular = ~has_odd
    rest = sums.take(~irregular)
    chosen = plain_entry & regular[sums.row]
    entries = SumRows(sums.row[chosen], root[chosen], sums.sign[chosen] * table.sign[sums.index[chosen]], sums.source)
    plain = added_up(entries).take(regular)
    return SumView(plain, np.flatnonzero(regular[~irregular]), sums.select(~gone).take(irregular), rest)


def added_up(sums: SumRows) -> SumRows:
    """Equal variables of a row added up; those that cancel are left out."""
    if not len(sums.row):
        return sums
    order = np.lexsort((sums.index, sums.row))
    row, index = sums.row[order], sums.index[order]
    new = np.concatenate([[True], (row[1:] != row[:-1]) | (index[1:] != index[:-1])])
    if new.all():
        return sums
    first = np.flatnonzero(new)
    total = np.add.reduceat(sums.sign[order], first)
    # keep the order in which the terms first stood
    kept = np.argsort(np.minimum.reduceat(order, first), kind="stable")
    kept = kept[total[kept] != 0]
    return SumRows(row[first][kept], index[first][kept], total[kept], sums.source)


def as_groups(sums: SumRows) -> list[Rows]:
    """The rows as equations; rows with the same signs share a shape, terms with a plus first."""
    order = np.lexsort((np.arange(len(sums.row)), -sums.sign, sums.row))
    index, sign = sums.index[order], sums.sign[order]
    start = np.concatenate([[0], np.cumsum(sums.lengths)])
    lengths = np.diff(start)
    unit = np.bincount(sums.row[np.abs(sums.sign) != 1.0], minlength=len(lengths)) == 0
    plus = np.bincount(sums.row[sums.sign > 0], minlength=len(lengths))
    groups = []
    for length, positive in sorted(set(zip(lengths[unit].tolist(), plus[unit].tolist(), strict=True))):
        rows = np.flatnonzero(unit & (lengths == length) & (plus == positive))
        entries = start[rows][:, None] + np.arange(length)
        shape = sum_shape(tuple([1.0] * positive + [-1.0] * (length - positive)))
        groups.append(Rows(shape, (UNKNOWN,) * length, index[entries], sums.source[rows]))
    for r in np.flatnonzero(~unit).tolist():
        part = slice(start[r], start[r + 1])
        shape = sum_shape(tuple(sign[part].tolist()))
        groups.append(Rows(shape, (UNKNOWN,) * int(lengths[r]), index[None, part], sums.source[r : r + 1]))
    return groups


@cache
def sum_shape(signs: tuple[float, ...]) -> Expr:
    """``slot(0) + slot(1) - slot(2) …`` with coefficients."""
    total = ZERO
    for k, sign in enumerate(signs):
        term = slot(k) if abs(sign) == 1.0 else abs(sign) * slot(k)
        total = add(total, term) if sign > 0 else sub(total, term)
    return total
