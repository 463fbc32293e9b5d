"""Derivatives of a program in some directions as a program of its own, behind the steps whose derivatives they are.

What follows from registers that move is ``Σ ∂f/∂w·ẇ`` with the slopes ∂f/∂w in registers that all directions share; of
implicit equations ``r(u, w) = 0`` it is the solution of ``r_u·u̇ = -r_w·ẇ``, another block with linear equations. Such a
program has a Taylor series as the one that it comes from (Griewank & Walther, Evaluating Derivatives, 2008, 3 and 13).
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import ZERO, Expr, slot, slots
from lmoc.ir.program import Apply, Program, Solve, Step, Total
from lmoc.lower.chain_rule import partial
from lmoc.lower.recurrences import NoSeries


class Forward:
    """A program with its derivatives.

    Attributes
    ----------
    steps : with those of the derivatives
    moving : (registers, m) where the derivative of a register in a direction stands; -1 where it is zero
    count : of registers
    """

    def __init__(self, program: Program, moving: np.ndarray, count: int) -> None:
        """
        Parameters
        ----------
        moving : of what the program does not fill
        count : registers so far, those of derivatives included
        """
        self.moving, self.count = moving.copy(), count
        self.m = moving.shape[1]
        steps: list[Step] = []
        for step in program:
            slopes, own = self._step(step)
            steps += [step, *slopes, *own]
        self.steps = tuple(steps)

    def _reserve(self, count: int) -> np.ndarray:
        self.count += count
        return np.arange(self.count - count, self.count)

    def _step(self, step: Step) -> tuple[list[Step], list[Step]]:
        """Return the steps of the slopes, and those of the derivatives."""
        if isinstance(step, Apply):
            return self._apply(step)
        return self._solve(step) if isinstance(step, Solve) else ([], self._total(step))

    def _apply(self, step: Apply) -> tuple[list[Step], list[Step]]:
        read = {leaf.value[0] for leaf in slots(step.shape)}
        partials = {c: partial(step.shape, c) for c in sorted(read) if (self.moving[step.slots[:, c]] >= 0).any()}
        partials = {c: own for c, own in partials.items() if own is not ZERO}
        first: list[Step] = []
        factors = {c: self._factor(step, own, first) for c, own in partials.items()}
        found: dict[tuple[bytes, tuple[int, ...]], list[int]] = {}  # which directions have the same rows and columns
        for j in range(self.m):
            reads = np.stack([self.moving[step.slots[:, c], j] >= 0 for c in partials], axis=1) if partials else None
            for pattern in np.unique(reads, axis=0) if reads is not None else ():
                rows = np.flatnonzero((reads == pattern).all(axis=1))
                columns = tuple(c for c, own in zip(partials, pattern, strict=True) if own)
                found.setdefault((rows.tobytes(), columns), []).append(j)
        made = []
        for (key, columns), js in found.items():
            if columns:
                rows = np.frombuffer(key, int)
                made.append((rows, js, self._row(step, rows, columns, js, factors)))
        self.moving[step.out] = -1
        for rows, js, own in made:
            self.moving[np.ix_(step.out[rows], np.array(js))] = own.out.reshape(len(js), -1).T
        return first, [own for *_, own in made]

    def _factor(self, step: Apply, own: Expr, first: list[Step]) -> Expr | np.ndarray:
        """Return a slope: a number, or the registers (rows,) in which it stands."""
        if own.op == "slot":
            return step.slots[:, own.value[0]]
        if not slots(own) and own.is_const:
            return own
        registers = self._reserve(len(step.out))
        first.append(Apply(own, step.slots, registers))
        return registers

    def _row(
        self, step: Apply, rows: np.ndarray, columns: tuple[int, ...], js: list[int],
        factors: dict[int, Expr | np.ndarray],
    ) -> Apply:  # fmt: skip
        """Return the derivatives of some rows that depend on some columns, one direction after the other."""
        shape: Expr | None = None
        table: list[np.ndarray] = []

        def column(own: np.ndarray) -> Expr:
            table.append(own)
            return slot(len(table) - 1)

        for c in columns:
            factor = factors[c]
            by = column(np.concatenate([self.moving[step.slots[rows, c], j] for j in js]))
            term = (factor if isinstance(factor, Expr) else column(np.tile(factor[rows], len(js)))) * by
            shape = term if shape is None else shape + term
        assert shape is not None
        return Apply(shape, np.stack(table, axis=1), self._reserve(len(rows) * len(js)))

    def _total(self, step: Total) -> list[Step]:
        owner, moving = np.repeat(np.arange(len(step.out)), np.diff(step.start)), self.moving[step.index]
        self.moving[step.out] = -1
        found: list[Step] = []
        for j in range(self.m):
            own = np.flatnonzero(moving[:, j] >= 0)
            rows, lengths = np.unique(owner[own], return_counts=True)
            if not len(rows):
                continue
            out = self._reserve(len(rows))
            start = np.concatenate([[0], np.cumsum(lengths)])
            found.append(Total(start, moving[own, j], step.coefficient[own], out))
            self.moving[step.out[rows], j] = out
        return found

    def _solve(self, step: Solve) -> tuple[list[Step], list[Step]]:
        """All directions of an instance have the matrix that its own unknowns have, and another right side."""
        (instances, size), slopes, inner = step.unknowns.shape, [], []
        unknowns = self._reserve(instances * size * self.m).reshape(instances, size, self.m)
        self.moving[step.unknowns] = unknowns
        for one in step.inner:
            first, own = self._step(one)
            slopes += first
            inner += own
        residuals = self.moving[step.residuals]
        if residuals.min(initial=0) < 0:
            raise NoSeries("an equation does not move with its unknowns")
        columns, rows = (np.moveaxis(v, 2, 0).reshape(-1, size) for v in (unknowns, residuals))
        return slopes, [Solve(tuple(inner), columns, rows, linear=True, constant=False)]
