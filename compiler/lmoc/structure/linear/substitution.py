"""Put roots in the place of eliminated variables: once for each shape and pattern, in columns for the rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ZERO, Expr, add, mul, neg, slot, slots, transform
from lmoc.structure.linear.affine import (
    FACTOR,
    NEGATIVE,
    OFFSET,
    OFFSET_NEGATIVE,
    ORDER_SHIFT,
    ZERO_ROOT,
    Affine,
)
from lmoc.structure.linear.coefficients import (
    INPUT,
    KNOWN,
    UNKNOWN,
    Kinds,
    leaves_of,
    linear_form,
    linear_sum,
    renumbered,
)
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Rows:
    """Equations ``shape(slots[i]) = 0`` on the way through elimination.

    Attributes
    ----------
    kinds : kind of each column
    slots : (n, columns) extended variables
    source : (n,) numbers of flat equations
    looped : 1 where variables have turned out to be the same, so that what cancels closes a loop; 2 where one is left
    """

    shape: Expr
    kinds: Kinds
    slots: np.ndarray
    source: np.ndarray
    looped: int = 0

    def take(self, rows: np.ndarray) -> Rows:
        return Rows(self.shape, self.kinds, self.slots[rows], self.source[rows], self.looped)

    def with_shape(self, shape: Expr) -> Rows:
        """The same rows with another shape over the same columns."""
        shape, columns = renumbered(shape)
        if columns == tuple(range(len(self.kinds))):
            return Rows(shape, self.kinds, self.slots, self.source, self.looped)
        kinds = tuple(self.kinds[c] for c in columns)
        return Rows(shape, kinds, self.slots[:, list(columns)], self.source, self.looped)

    def column(self, leaf: Expr) -> np.ndarray:
        return self.slots[:, leaf.value[0]]


def merged(groups: Iterable[Rows]) -> list[Rows]:
    """Groups of the same shape put together."""
    alike: dict[tuple[Expr, Kinds, int], list[Rows]] = {}
    for g in groups:
        if len(g.source):
            alike.setdefault((g.shape, g.kinds, g.looped), []).append(g)
    return [many[0] if len(many) == 1 else _joined(many) for many in alike.values()]


def with_numbers(groups: Iterable[Rows]) -> Iterator[tuple[Rows, np.ndarray]]:
    """Groups, each with the numbers of its rows, counted through all of them."""
    first = 0
    for g in groups:
        yield g, np.arange(first, first + len(g.source))
        first += len(g.source)


def _joined(many: list[Rows]) -> Rows:
    first = many[0]
    slots_ = np.concatenate([g.slots for g in many])
    return Rows(first.shape, first.kinds, slots_, np.concatenate([g.source for g in many]), first.looped)


def partition(codes: np.ndarray) -> list[tuple[tuple[int, ...], np.ndarray | None]]:
    """Rows of a table sorted by their content: pairs (content, row numbers), row numbers None for all."""
    if len(codes) == 1:
        return [(tuple(codes[0].tolist()), None)]
    if (codes == codes[0]).all():
        return [(tuple(codes[0].tolist()), None)]
    order = np.lexsort(codes.T)
    ordered = codes[order]
    cut = np.flatnonzero((ordered[1:] != ordered[:-1]).any(axis=1)) + 1
    return [(tuple(codes[part[0]].tolist()), np.sort(part)) for part in np.split(order, cut)]


def substituted(group: Rows, table: Affine, kind_of_root: np.ndarray) -> list[Rows]:
    """The rows with the table's roots instead of their unknowns; a list, as rows with different patterns part ways.

    Parameters
    ----------
    kind_of_root : kind of each flat variable and of the constant 0
    """
    unknown = [c for c, kind in enumerate(group.kinds) if kind == UNKNOWN]
    if not unknown:
        return [group]
    variables = group.slots[:, unknown]
    codes = table.code[variables]
    if not codes.any():
        return [group]
    return [
        part
        for pattern, rows in partition(codes)
        for part in _one_pattern(group if rows is None else group.take(rows), unknown, pattern, table, kind_of_root)
    ]


def _one_pattern(
    group: Rows, unknown: list[int], pattern: tuple[int, ...], table: Affine, kind_of_root: np.ndarray
) -> list[Rows]:
    if not any(pattern):
        return [group]
    width = group.slots.shape[1]
    shape, picks = _substitute(group.shape, tuple(unknown), pattern, width)
    slots_ = np.empty((len(group.slots), len(picks)), group.slots.dtype)
    for place, pick in enumerate(picks):
        part, i = divmod(pick - width, len(unknown))
        new = (table.root, table.factor, table.offset)[part] if pick >= width else None
        slots_[:, place] = group.slots[:, pick] if new is None else new[group.slots[:, unknown[i]]]
    known = group.kinds + tuple([UNKNOWN] * len(unknown)) + tuple([KNOWN] * (2 * len(unknown)))
    result = []
    root_columns = [i for i, p in enumerate(picks) if width <= p < width + len(unknown)]
    kinds = [known[p] for p in picks]
    if not root_columns:
        return [Rows(shape, tuple(kinds), slots_, group.source, group.looped)]
    for root_kinds, rows in partition(kind_of_root[slots_[:, root_columns]]):
        for c, k in zip(root_columns, root_kinds, strict=True):
            kinds[c] = k
        part = Rows(shape, tuple(kinds), slots_, group.source, group.looped)
        result += equal_columns_merged(part if rows is None else part.take(rows))
    return result


@cache
def _substitute(
    shape: Expr, unknown: tuple[int, ...], pattern: tuple[int, ...], width: int
) -> tuple[Expr, tuple[int, ...]]:
    """The new shape, and where its columns are found in [old slots | roots | factors | offsets]."""
    u = len(unknown)
    place = {column: i for i, column in enumerate(unknown)}

    def leaf(node: Expr) -> Expr:
        if node.op != "slot" or node.value[0] not in place:
            return node
        i = place[node.value[0]]
        return jet(pattern[i], node.value[1], (width + i, width + u + i, width + 2 * u + i))

    return renumbered(transform(shape, leaf))


def jet(code: int, order: int, columns: tuple[int, int, int]) -> Expr:
    """The order-th derivative of a variable with the given pattern, over columns (root, factor, offset)."""
    root, factor, offset = columns
    if code & ZERO_ROOT:
        result = ZERO
    else:
        result = slot(root, order + (code >> ORDER_SHIFT))
        if code & FACTOR:
            result = mul(slot(factor), result)
        if code & NEGATIVE:
            result = neg(result)
    if code & OFFSET and order == 0:
        shift = slot(offset)
        result = add(result, neg(shift) if code & OFFSET_NEGATIVE else shift)
    return result


# -------------------------------------------------------------- equal columns


def equal_columns_merged(group: Rows) -> list[Rows]:
    """Rows in which two columns hold the same variable get a shape of their own, with one column for both."""
    columns = [c for c, kind in enumerate(group.kinds) if kind in (UNKNOWN, INPUT)]
    if len(columns) < 2:
        return [group]
    table = group.slots[:, columns]
    if len(table) == 1:
        row = table[0].tolist()
        if len(set(row)) == len(row):
            return [group]
        twins = np.array([[row.index(v) for v in row]])
    else:
        pairs = [(i, j) for j in range(len(columns)) for i in range(j) if (table[:, i] == table[:, j]).any()]
        if not pairs:
            return [group]
        twins = np.tile(np.arange(len(columns), dtype=np.int16), (len(table), 1))
        for i, j in reversed(pairs):
            twins[table[:, i] == table[:, j], j] = i
    return [
        _merge_columns(group if rows is None else group.take(rows), tuple(columns), pattern)
        for pattern, rows in partition(twins)
    ]


def _merge_columns(group: Rows, columns: tuple[int, ...], pattern: tuple[int, ...]) -> Rows:
    if pattern == tuple(range(len(columns))):
        return group
    shape = _with_merged_columns(group.shape, group.kinds, columns, pattern)
    classes = [p for p, c in zip(pattern, columns, strict=True) if group.kinds[c] == UNKNOWN]
    alone = len(classes) > 1 and len(set(classes)) == 1
    return Rows(group.shape, group.kinds, group.slots, group.source, looped=2 if alone else 1).with_shape(shape)


@cache
def _with_merged_columns(shape: Expr, kinds: Kinds, columns: tuple[int, ...], pattern: tuple[int, ...]) -> Expr:
    target = {columns[j]: columns[i] for j, i in enumerate(pattern)}

    def leaf(node: Expr) -> Expr:
        return slot(target[node.value[0]], node.value[1]) if node.op == "slot" and node.value[0] in target else node

    new = transform(shape, leaf)
    parts = linear_form(new, kinds)
    if parts is not None:
        coefficients, rest = parts
        return linear_sum(coefficients, _collected(rest))
    for jet in leaves_of(new, kinds, UNKNOWN):
        alone = linear_parts(new, [jet])
        if alone is not None and not alone[0]:
            new = alone[1]
    return new


def _collected(rest: Expr) -> Expr:
    """A rest with equal terms put together, where it is linear in its jets."""
    parts = linear_parts(rest, slots(rest))
    return rest if parts is None else linear_sum(*parts)
