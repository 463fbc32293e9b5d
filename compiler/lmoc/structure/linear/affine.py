"""Tables ``x = sign·factor·root^(order) + offset_sign·offset``, and how one is put into another."""

from __future__ import annotations

import numpy as np

from lmoc.structure.linear.derived import NONE, DerivedParameters
from lmoc.support.indices import INDEX, counted
from lmoc.support.records import dataclass

# bits of Affine.code: how a jet of the variable looks once its root stands in its place
NEGATIVE, FACTOR, OFFSET, OFFSET_NEGATIVE, ZERO_ROOT, ELSEWHERE = 1, 2, 4, 8, 16, 32
ORDER_SHIFT = 6
CODE = np.int16


@dataclass(eq=False)
class Affine:
    """One row a variable: ``x = sign·factor·root^(order) + offset_sign·offset``.

    `factor` and `offset` are extended variables, -1 for 1 and 0. The root ``count`` (one beyond the flat variables)
    is the constant 0: a variable with a known value is its offset.

    Attributes
    ----------
    code : the row as a bit pattern (0: the variable is its own root), by which equations are sorted for substitution
    """

    root: np.ndarray
    order: np.ndarray
    sign: np.ndarray
    factor: np.ndarray
    offset_sign: np.ndarray
    offset: np.ndarray
    code: np.ndarray

    @staticmethod
    def identity(count: int) -> Affine:
        """Every one of ``count`` variables, and the constant 0, its own root."""
        ones, none = np.ones(count + 1, np.int8), np.full(count + 1, NONE, INDEX)
        order, code = np.zeros(count + 1, np.int8), np.zeros(count + 1, CODE)
        return Affine(counted(0, count + 1), order, ones, none, ones.copy(), none.copy(), code)

    def take(self, rows: np.ndarray) -> Affine:
        return Affine(*(column[rows] for column in self.columns()))

    def put(self, rows: np.ndarray, other: Affine) -> None:
        for mine, new in zip(self.columns(), other.columns(), strict=True):
            mine[rows] = new

    def columns(self) -> tuple[np.ndarray, ...]:
        return self.root, self.order, self.sign, self.factor, self.offset_sign, self.offset, self.code

    @property
    def plain(self) -> np.ndarray:
        """Rows without factor and offset: composing with them makes no derived parameter."""
        return (self.factor < 0) & (self.offset < 0)


def composed(outer: Affine, inner: Affine, zero: int, derived: DerivedParameters) -> Affine:
    """Put ``r = inner`` into ``x = outer(r)``; row i of `inner` belongs to the root of row i of `outer`.

    Parameters
    ----------
    zero : the root that is the constant 0
    """
    constant = inner.root == zero
    sign = np.where(constant, 1, outer.sign * inner.sign).astype(np.int8)
    order = np.where(constant, 0, outer.order + inner.order).astype(np.int8)
    if (outer.factor >= 0).any():
        factor = derived.product(np.where(constant, NONE, outer.factor), inner.factor)
    else:
        factor = inner.factor
    if (inner.offset >= 0).any():
        shift = np.where(outer.order == 0, inner.offset, NONE)
        offset_sign, offset = derived.shifted(
            outer.sign * inner.offset_sign, outer.factor, shift, outer.offset_sign, outer.offset
        )
    else:
        offset_sign, offset = outer.offset_sign, outer.offset
    result = Affine(inner.root, order, sign, factor, offset_sign.astype(np.int8), offset, order)
    result.code = codes(result, zero)
    return result


def codes(rows: Affine, zero: int) -> np.ndarray:
    """Bit patterns of rows of variables that are not their own roots."""
    code = rows.order.astype(CODE) << ORDER_SHIFT
    shifted = rows.offset >= 0
    for bit, where in (
        (ZERO_ROOT, rows.root == zero),
        (ELSEWHERE, rows.root != zero),
        (NEGATIVE, rows.sign < 0),
        (FACTOR, rows.factor >= 0),
        (OFFSET, shifted),
        (OFFSET_NEGATIVE, shifted & (rows.offset_sign < 0)),
    ):
        code |= where * CODE(bit)
    return code


def resolve(table: Affine, linked: np.ndarray, zero: int, derived: DerivedParameters) -> None:
    """Follow parents to the roots, in place: afterwards no root in the table has a parent.

    Plain links are followed first, then the others among themselves, then every variable goes over the last of
    its plain ancestors: so a derived parameter is made once for each link with a factor, whatever hangs on it. Each
    of the three is pointer doubling (Wyllie 1979): a path of n links takes log2 n passes.

    Parameters
    ----------
    table : rows of `linked` hold parents instead of roots; there is no cycle
    linked : variables that have a parent
    """
    plain = table.plain[linked]
    light, heavy = linked[plain], linked[~plain]
    if not len(heavy):
        _double(table, light, zero, derived)
        return
    fixed = np.zeros(len(table.root), bool)
    fixed[heavy] = True
    _double(table, light, zero, derived, fixed)
    _step(table, heavy, zero, derived, ~fixed)
    _double(table, heavy, zero, derived)
    _step(table, light, zero, derived, np.ones(len(fixed), bool))


def _step(table: Affine, rows: np.ndarray, zero: int, derived: DerivedParameters, through: np.ndarray) -> np.ndarray:
    """Replace the roots of `rows` by what the table says of them, where they have parents; returns the rows changed."""
    root = table.root[rows]
    moved = (table.root[root] != root) & through[root]
    rows = rows[moved]
    if len(rows):
        table.put(rows, composed(table.take(rows), table.take(root[moved]), zero, derived))
    return rows


def _double(
    table: Affine, rows: np.ndarray, zero: int, derived: DerivedParameters, fixed: np.ndarray | None = None
) -> None:
    through = np.ones(len(table.root), bool) if fixed is None else ~fixed
    while len(rows):
        rows = _step(table, rows, zero, derived, through)
