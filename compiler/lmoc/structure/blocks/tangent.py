"""Time derivatives of registers as further steps: forward differentiation of a program.

A derivative that an equation of the start asks for need not stand in the reduced system: the rate of a spring's force,
the velocity of a point that follows from states by a formula. It is found as automatic differentiation finds it
(Griewank & Walther, Evaluating Derivatives, 2008, chapter 3): every step is followed by one for the rates of what it
fills. Implicit equations give linear ones, with their own Jacobian as the matrix. Each shape is differentiated once.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from lmoc.expression.calculus import total_derivative
from lmoc.expression.dag import ZERO, Expr
from lmoc.ir.program import Apply, Program, Solve, Step, Total, written
from lmoc.structure.linear.explicit import as_formula
from lmoc.structure.linear.substitution import partition


class Tangent:
    """Registers of rates, and the steps that fill them.

    Attributes
    ----------
    rate : (registers,) the register that holds the time derivative of each register, -1 where that is zero
    program : steps for all rates made so far, to come after the program itself
    depth : how often a rate can be taken again
    """

    def __init__(self, program: Program, rate: np.ndarray):
        """Begin with the rates that are there: those of states and of inputs.

        Parameters
        ----------
        program : what computes all other registers
        rate : as the attribute
        """
        self.rate = rate
        self.program: Program = ()
        self.depth = 0
        self._newest = program
        self._next = len(rate)

    def advance(self) -> None:
        """Give rates to all that the program fills; when called again, to these rates."""
        room = sum(len(written(step)) for step in self._newest)
        self._next = len(self.rate)
        self.rate = np.concatenate([self.rate, np.full(room, -1)])
        self._newest = tuple(made for step in self._newest for made in self._of_step(step))
        self.program += self._newest
        self.depth += 1

    def _new(self, registers: np.ndarray) -> np.ndarray:
        """Fresh registers for the rates of these."""
        rates = self._next + np.arange(registers.size).reshape(registers.shape)
        self._next += registers.size
        self.rate[registers] = rates
        return rates

    def _of_step(self, step: Step) -> list[Step]:
        if isinstance(step, Apply):
            return self._of_apply(step)
        return [self._of_total(step)] if isinstance(step, Total) else [self._of_solve(step)]

    def _of_apply(self, step: Apply) -> list[Step]:
        made: list[Step] = []
        for moving, rows in partition(self.rate[step.slots] >= 0) if step.slots.size else [((), None)]:
            shape, leaves = _derivative(step.shape, moving)
            if shape is ZERO:
                continue
            table, out = (step.slots, step.out) if rows is None else (step.slots[rows], step.out[rows])
            columns = [self.rate[table[:, k]] if order else table[:, k] for k, order in leaves]
            slots = np.stack(columns, axis=1) if columns else np.zeros((len(out), 0), np.int64)
            made.append(Apply(shape, slots, self._new(out)))
        return made

    def _of_total(self, step: Total) -> Total:
        owner = np.repeat(np.arange(len(step.out)), np.diff(step.start))
        moving = self.rate[step.index] >= 0
        start = np.concatenate([[0], np.cumsum(np.bincount(owner[moving], minlength=len(step.out)))])
        return Total(start, self.rate[step.index[moving]], step.coefficient[moving], self._new(step.out))

    def _of_solve(self, step: Solve) -> Solve:
        """``∂r/∂u·u̇ + ∂r/∂x·ẋ = 0``: linear in the rates of the unknowns, whatever the equations are."""
        unknowns = self._new(step.unknowns)
        inner = [made for part in step.inner for made in self._of_step(part)]
        still = step.residuals[self.rate[step.residuals] < 0]
        if len(still):  # sign(u) = 1 moves nothing: its rate is the equation 0 = 0, which has no solution either
            inner.append(Apply(ZERO, np.zeros((len(still), 0), np.int64), self._new(still)))
        return Solve(tuple(inner), unknowns, self.rate[step.residuals], True, step.constant)


@cache
def _derivative(shape: Expr, moving: tuple[bool, ...]) -> tuple[Expr, tuple[tuple[int, int], ...]]:
    """The total derivative as a formula, and what its columns hold: (column of the shape, 1 for the rate of that)."""
    still = frozenset(k for k, moves in enumerate(moving) if not moves)
    formula, leaves = as_formula(total_derivative(shape, still))
    return formula, tuple(leaf.value for leaf in leaves)
