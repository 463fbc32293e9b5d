"""The equations in root jets as batches, before and after differentiation."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, cached_property

import numpy as np

from lmoc.expression.calculus import total_derivative, without_rates
from lmoc.expression.dag import ZERO, Expr, postorder, slots
from lmoc.ir.flat import Kind
from lmoc.ir.normalized import LongSums, Normalized
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.sigma import highest_value_transversal, offsets
from lmoc.structure.linear.coefficients import INPUT, UNKNOWN, Kinds, kinds_of, leaves_of
from lmoc.support.indices import INDEX, counted, positions
from lmoc.support.records import dataclass

_MOST_ROUNDS = 8  # of derivatives that rates are made of: more come where a rate needs its own derivative


@dataclass(frozen=True, eq=False)
class EquationBatch:
    """Equations ``shape(slots[i]) = 0``, all differentiated equally often.

    Attributes
    ----------
    kinds : kind of each column
    slots : (n, columns) extended variables
    row : (n,) numbers of the undifferentiated equations
    times : how often they have been differentiated
    """

    shape: Expr
    kinds: Kinds
    slots: np.ndarray
    row: np.ndarray
    times: int = 0

    @cached_property
    def unknown(self) -> tuple[Expr, ...]:
        """The unknown jets among the leaves."""
        return leaves_of(self.shape, self.kinds, UNKNOWN)

    def take(self, rows: np.ndarray) -> EquationBatch:
        return EquationBatch(self.shape, self.kinds, self.slots[rows], self.row[rows], self.times)


@dataclass(frozen=True, eq=False)
class SumBatch:
    """Long sums ``Σ coefficient[j]·index[j]^(order[j]) = 0``, each with a row of its own."""

    start: np.ndarray
    index: np.ndarray
    order: np.ndarray
    coefficient: np.ndarray
    row: np.ndarray

    @cached_property
    def entry_row(self) -> np.ndarray:
        """(nnz,) the position among the sums that each entry belongs to."""
        return np.repeat(np.arange(len(self.row)), np.diff(self.start))


@cache
def derivative(shape: Expr, kinds: Kinds) -> Expr:
    """Total time derivative; parameters stand still."""
    return total_derivative(shape, frozenset(k for k, kind in enumerate(kinds) if kind not in (UNKNOWN, INPUT)))


class EquationSystem:
    """The normalized equations, numbered through: the groups in order, then the long sums.

    Attributes
    ----------
    kind : (extended,) KNOWN, INPUT or UNKNOWN of each extended variable
    variable : (columns,) the unknown roots
    column : (extended,) number of each unknown root, -1 for all else
    batches, sums : the equations
    source : (rows,) flat equation that each row comes from
    incidence, differentiable : Incidence, whole and without what only `given` contains
    needed : (columns,) the highest derivative of each root that some variable of the flat model is
    """

    def __init__(self, normalized: Normalized):
        flat, count = normalized.flat, normalized.extended_count
        self.normalized, self.flat = normalized, flat
        self.kind = np.zeros(count, np.int8)
        self.kind[: flat.count] = kinds_of(flat)
        own = normalized.root == counted(0, flat.count)
        self.variable = positions(own & (flat.kind == Kind.UNKNOWN))
        self.column = np.full(count, -1, INDEX)
        self.column[self.variable] = counted(0, len(self.variable))
        self.batches = self._batches(normalized)
        self.sums = _sum_batch(normalized.sums, sum(len(b.row) for b in self.batches))
        self.source = np.concatenate([*(g.source for g in normalized.groups if g.rows), normalized.sums.source])
        self.rows = len(self.source)
        self.incidence = self._incidence()
        self.given = [b for b in self.batches if any(node.op == "given" for node in postorder(b.shape))]
        self.differentiable = self._incidence(ZERO) if self.given else self.incidence
        self.needed = np.zeros(len(self.variable), INDEX)
        at = np.flatnonzero((normalized.order > 0) & (self.column[normalized.root] >= 0))
        columns = self.column[normalized.root[at]].astype(np.int64)
        np.maximum.at(self.needed, columns, normalized.order[at])

    def _batches(self, normalized: Normalized) -> tuple[EquationBatch, ...]:
        result, first = [], 0
        for g in normalized.groups:
            if g.rows:
                rows = counted(first, first + g.rows)
                result.append(EquationBatch(g.residual, tuple(self.kind[g.slots[0]].tolist()), g.slots, rows))
                first += g.rows
        return tuple(result)

    def transversal(self) -> np.ndarray | None:
        """Return a highest-value transversal, if possible without what a derivative does not contain (`given`)."""
        match = highest_value_transversal(self.incidence)
        if match is None or self.differentiable is self.incidence:
            return match
        other = highest_value_transversal(self.differentiable)
        return match if other is None or self._value(other) < self._value(match) else other

    def offsets(self, match: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the offsets for a transversal (`sigma.offsets`), with the derivatives that a rate is made of."""
        for _ in range(_MOST_ROUNDS):
            c, d = offsets(self.incidence, match, lower)
            lower = np.maximum(lower, self.rate_orders(c))
            if (d >= lower).all():
                break
        return c, d

    def rate_orders(self, c: np.ndarray) -> np.ndarray:
        """Return the highest derivative of each unknown in what equations with a `given` come to (columns,)."""
        top = np.zeros(len(self.variable), np.int64)
        for b in self.given:
            shape = b.shape
            for times in range(int(c[b.row].max()) + 1):
                rows = np.flatnonzero(c[b.row] >= times)
                for leaf in leaves_of(without_rates(shape), b.kinds, UNKNOWN):
                    np.maximum.at(top, self.column[b.slots[rows, leaf.value[0]]], leaf.value[1])
                shape = derivative(shape, b.kinds)
        return top

    def given_motions(self) -> Iterator[tuple[EquationBatch, np.ndarray]]:
        """Yield what sets unknowns to positions with rates of their own, and the columns of what it sets (rows, n)."""
        for b in self.given:
            moved = {leaf.value[0] for leaf in leaves_of(without_rates(b.shape, ZERO), b.kinds, UNKNOWN)}
            if {leaf.value[0] for leaf in b.unknown} - moved:
                yield b, self.column[b.slots[:, sorted(moved)]]

    def _value(self, match: np.ndarray) -> int:
        i = self.incidence
        return int(i.order[match[i.row] == i.column].sum())

    def _incidence(self, given: Expr | None = None) -> Incidence:
        row, column, order = [self.sums.row[self.sums.entry_row]], [self.column[self.sums.index]], [self.sums.order]
        for b in self.batches:
            unknown = leaves_of(without_rates(b.shape, given), b.kinds, UNKNOWN)
            highest = {leaf.value[0]: leaf.value[1] for leaf in unknown}  # leaves come with their orders rising
            for k, n in highest.items():
                row.append(b.row)
                column.append(self.column[b.slots[:, k]])
                order.append(np.full(len(b.row), n, INDEX))
        return Incidence.of(
            self.rows, len(self.variable), np.concatenate(row), np.concatenate(column), np.concatenate(order)
        )

    def name(self, column: int) -> str:
        """The user's name of an unknown."""
        return self.flat.variable_name(int(self.variable[column]))

    def differentiated(self, c: np.ndarray) -> tuple[tuple[EquationBatch, ...], tuple[SumBatch, ...]]:
        """Every equation and its derivatives up to the c-th; each shape is differentiated once for each order."""
        batches, sums = [], []
        for b in self.batches:
            shape, rows = b.shape, None
            for times in range(int(c[b.row].max()) + 1):
                if times:
                    shape = derivative(shape, b.kinds)
                    rows = np.flatnonzero(c[b.row] >= times)
                part = b if rows is None or len(rows) == len(b.row) else b.take(rows)
                batches.append(EquationBatch(without_rates(shape), part.kinds, part.slots, part.row, times))
        if self.sums.row.size:
            for times in range(int(c[self.sums.row].max()) + 1):
                sums.append(_sums_from(self.sums, np.flatnonzero(c[self.sums.row] >= times), times))
        return tuple(batches), tuple(sums)

    def highest_inputs(self, batches: tuple[EquationBatch, ...]) -> np.ndarray:
        """(flat.count,) highest derivative of each input in equations or as a flat variable, -1 where there is none."""
        top = np.full(self.flat.count, -1, INDEX)
        roots = self.normalized.root
        known = np.flatnonzero((roots < self.flat.count) & (self.kind[roots] == INPUT))
        np.maximum.at(top, roots[known], self.normalized.order[known])
        for b in batches:
            for leaf in slots(b.shape):
                if b.kinds[leaf.value[0]] == INPUT:
                    np.maximum.at(top, b.slots[:, leaf.value[0]], leaf.value[1])
        return top


def _sum_batch(sums: LongSums, first: int) -> SumBatch:
    rows = counted(first, first + sums.rows)
    return SumBatch(sums.start, sums.index, sums.order, sums.coefficient, rows)


def _sums_from(sums: SumBatch, rows: np.ndarray, times: int) -> SumBatch:
    lengths = np.diff(sums.start)[rows]
    start = np.concatenate([[0], np.cumsum(lengths)])
    entries = np.repeat(sums.start[rows] - start[:-1], lengths) + np.arange(start[-1])
    return SumBatch(start, sums.index[entries], sums.order[entries] + times, sums.coefficient[entries], sums.row[rows])
