"""Sparse derivatives of a program's registers by others: the chain rule, forward over the steps.

Each step's shape is differentiated once for each of its slots. What follows is products and segment sums over index
arrays, as in the assembly of finite elements. Through a Solve the implicit function theorem is applied:
``∂u/∂x = -(∂r/∂u)⁻¹ ∂r/∂x`` for each instance.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import ZERO, Expr, slot, slots
from lmoc.ir.program import Apply, Program, Solve, Total
from lmoc.support.records import dataclass


@lru_cache(maxsize=4096)
def partial(shape: Expr, column: int) -> Expr:
    """∂shape/∂slot(column)."""
    return differentiate(shape, slot(column))


@dataclass(frozen=True, eq=False)
class Product:
    """``value[first + k] = Σ factor[which[j]]·value[source[j]]`` over the j of segment k."""

    step: Apply | Total
    partials: tuple[tuple[Expr, int], ...]  # (derivative, slot column) of an Apply
    which: np.ndarray
    source: np.ndarray
    start: np.ndarray
    single: bool
    first: int
    stop: int


@dataclass(frozen=True, eq=False)
class Implicit:
    """Derivatives of the unknowns of a Solve, dense for each instance."""

    step: Solve
    shape: tuple[int, int, int]  # instances, size, columns (padded)
    a_source: np.ndarray
    a_place: tuple[np.ndarray, np.ndarray, np.ndarray]
    b_source: np.ndarray
    b_place: tuple[np.ndarray, np.ndarray, np.ndarray]
    result: tuple[np.ndarray, np.ndarray, np.ndarray]  # where in the dense solution the new values stand
    first: int
    stop: int


class ChainRule:
    """∂w[outputs]/∂w[inputs] of a program.

    Attributes
    ----------
    rows, columns : (nnz,) pattern, ordered by row and then by column
    source : (nnz,) where the entries stand among all that are computed on the way
    size : number of these
    ones : ranges among them that are 1, the seeds
    stages : how the others follow, in the order of the program's steps
    """

    def __init__(self, program: Program, inputs: np.ndarray, outputs: np.ndarray, count: int) -> None:
        self._columns_total = len(inputs)
        self._column = np.arange(len(inputs))  # column of every entry made so far
        self._start = np.zeros(count, int)
        self._length = np.zeros(count, int)
        self._start[inputs], self._length[inputs] = np.arange(len(inputs)), 1
        self.ones: list[tuple[int, int]] = [(0, len(inputs))]  # entries that are 1: seeds
        self.stages: list[Product | Implicit] = []
        self._sweep(program)
        source, self.rows = _ranges(self._start[outputs], self._length[outputs])
        self.columns = self._column[source]
        self.source = source
        self.size = len(self._column)

    # ------------------------------------------------------------------ pattern

    def _sweep(self, program: Program) -> None:
        for step in program:
            if isinstance(step, Apply):
                self._apply(step)
            elif isinstance(step, Total):
                self._total(step)
            else:
                self._solve(step)

    def _apply(self, step: Apply) -> None:
        partials: list[tuple[Expr, int]] = []
        which: list[np.ndarray] = []
        sources: list[np.ndarray] = []
        rows: list[np.ndarray] = []
        n = len(step.out)
        for leaf in slots(step.shape):
            registers = step.slots[:, leaf.value[0]]
            if not self._length[registers].any():
                continue
            derivative = partial(step.shape, leaf.value[0])
            if derivative is ZERO:
                continue
            source, row = _ranges(self._start[registers], self._length[registers])
            which.append(len(partials) * n + row)
            sources.append(source)
            rows.append(row)
            partials.append((derivative, leaf.value[0]))
        self._product(step, tuple(partials), which, sources, rows)

    def _total(self, step: Total) -> None:
        source, term = _ranges(self._start[step.index], self._length[step.index])
        row = np.repeat(np.arange(len(step.out)), np.diff(step.start))[term]
        self._product(step, (), [term], [source], [row])

    def _product(
        self,
        step: Apply | Total,
        partials: tuple[tuple[Expr, int], ...],
        every_which: list[np.ndarray],
        sources: list[np.ndarray],
        rows: list[np.ndarray],
    ) -> None:
        self._start[step.out], self._length[step.out] = 0, 0
        if not rows or not sum(map(len, rows)):
            return
        which, source, row = np.concatenate(every_which), np.concatenate(sources), np.concatenate(rows)
        key = row * self._columns_total + self._column[source]
        order = np.argsort(key, kind="stable")
        key = key[order]
        new = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
        first = len(self._column)
        out_row, column = np.divmod(key[new], self._columns_total)
        self._enter(step.out, out_row, column)
        single = len(new) == len(key)
        stage = Product(step, partials, which[order], source[order], new, single, first, first + len(new))
        self.stages.append(stage)

    def _enter(self, registers: np.ndarray, row: np.ndarray, column: np.ndarray) -> None:
        """New entries for registers, sorted by row."""
        lengths = np.bincount(row, minlength=len(registers))
        first = len(self._column)
        self._start[registers] = first + np.cumsum(lengths) - lengths
        self._length[registers] = lengths
        self._column = np.concatenate([self._column, column])

    def _solve(self, step: Solve) -> None:
        instances, size = step.unknowns.shape
        unknowns = step.unknowns.ravel()
        base = self._columns_total
        self._columns_total += len(unknowns)
        seed = len(self._column)
        self._enter(unknowns, np.arange(len(unknowns)), base + np.arange(len(unknowns)))
        self.ones.append((seed, seed + len(unknowns)))
        self._sweep(step.inner)
        residuals = step.residuals.ravel()
        source, row = _ranges(self._start[residuals], self._length[residuals])
        column = self._column[source]
        own = column >= base
        instance = row // size
        a_place = (instance[own], row[own] % size, (column[own] - base) % size)
        # the inputs on which an instance depends, numbered within it
        outer = ~own
        pairs, position = np.unique(instance[outer] * base + column[outer], return_inverse=True)
        pair_instance, pair_column = np.divmod(pairs, base)
        per_instance = np.bincount(pair_instance, minlength=instances)
        within = np.arange(len(pairs)) - (np.cumsum(per_instance) - per_instance)[pair_instance]
        b_place = (instance[outer], row[outer] % size, within[position])
        width = int(per_instance.max(initial=0))
        # every unknown of an instance depends on all of these
        first_pair = np.cumsum(per_instance) - per_instance
        pair, unknown = _ranges(np.repeat(first_pair, size), np.repeat(per_instance, size))
        first = len(self._column)
        self._enter(unknowns, unknown, pair_column[pair])
        result = (unknown // size, unknown % size, within[pair])
        shape, last = (instances, size, width), first + len(pair)
        self.stages.append(Implicit(step, shape, source[own], a_place, source[outer], b_place, result, first, last))
        self._columns_total = base
        self._sweep(step.inner)


def _ranges(start: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All numbers ``start[i] … start[i]+length[i]-1``, one i after the other, and the i of each."""
    owner = np.repeat(np.arange(len(start)), length)
    offset = np.cumsum(length) - length
    return np.arange(len(owner)) - offset[owner] + start[owner], owner
