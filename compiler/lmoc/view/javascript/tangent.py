"""Derivatives of a program along a direction, as a program: forward differentiation of every step.

Beside each register that depends on the inputs stands its derivative in a register of its own. One run of the program,
behind one of the program itself, gives one column of the Jacobian: that of the input whose own derivative is 1 (A.
Griewank and A. Walther, Evaluating Derivatives, 2008, chapter 3). Through a block the implicit function theorem is
applied: a linear block for the derivatives of its unknowns.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import ZERO, Expr, add, mul, slot, slots
from lmoc.ir.program import Apply, Program, Solve, Step, Total
from lmoc.lower.chain_rule import partial
from lmoc.support.records import dataclass
from lmoc.view.javascript.registers import RegisterSource


@dataclass(frozen=True, eq=False)
class Tangent:
    """The derivatives of a program.

    Attributes
    ----------
    program : fills the derivatives, where the program itself has been run
    seeds : (inputs,) registers of the inputs' own derivatives
    of : (count,) register of the derivative of each register, -1 where it is always zero
    """

    program: Program
    seeds: np.ndarray
    of: np.ndarray


def tangent(program: Program, inputs: np.ndarray, count: int, registers: RegisterSource) -> Tangent:
    """Return the derivatives of a program by some registers.

    Parameters
    ----------
    count : of registers that the program is over
    """
    made = _Forward(np.full(count, -1), registers)
    seeds = made.active(inputs)
    return Tangent(made.steps(program), seeds, made.of)


class _Forward:
    def __init__(self, of: np.ndarray, registers: RegisterSource) -> None:
        self.of, self.registers = of, registers

    def active(self, registers: np.ndarray) -> np.ndarray:
        """Return new registers for the derivatives of some."""
        self.of[registers] = self.registers.add(len(registers))
        return self.of[registers]

    def steps(self, program: Program) -> Program:
        found: list[Step] = []
        for step in program:
            if isinstance(step, Apply):
                found += self.apply(step)
            elif isinstance(step, Total):
                found += self.total(step)
            else:
                found += self.solve(step)
        return tuple(found)

    def apply(self, step: Apply) -> list[Step]:
        """Return a step for each set of columns that depend on the inputs."""
        partials = [(k, d) for leaf in slots(step.shape) if (d := partial(step.shape, k := leaf.value[0])) is not ZERO]
        if not partials or not len(step.out):
            return []
        columns = [k for k, _ in partials]
        moves = self.of[step.slots[:, columns]] >= 0
        found: list[Step] = []
        for pattern in np.unique(moves, axis=0):
            if not pattern.any():
                continue
            rows = np.flatnonzero((moves == pattern).all(axis=1))
            used = [p for p, on in zip(partials, pattern.tolist(), strict=True) if on]
            shape: Expr = ZERO
            for n, (_, derivative) in enumerate(used):
                shape = add(shape, mul(derivative, slot(step.slots.shape[1] + n)))
            beside = self.of[step.slots[np.ix_(rows, [k for k, _ in used])]]
            table = np.concatenate([step.slots[rows], beside], axis=1)
            found.append(Apply(shape, table, self.active(step.out[rows])))
        return found

    def total(self, step: Total) -> list[Step]:
        moves = self.of[step.index] >= 0
        lengths = np.add.reduceat(np.append(moves, False).astype(int), step.start[:-1]) if len(step.out) else []
        lengths = np.where(np.diff(step.start) > 0, lengths, 0)
        rows = np.flatnonzero(lengths)
        if not len(rows):
            return []
        start = np.concatenate([[0], np.cumsum(lengths[rows])])
        index = self.of[step.index[moves]]
        return [Total(start, index, step.coefficient[moves], self.active(step.out[rows]))]

    def solve(self, step: Solve) -> list[Step]:
        """Return the block ``∂r/∂u·u' + r' = 0`` for the derivatives u' of the unknowns."""
        unknowns = self.active(step.unknowns.ravel()).reshape(step.unknowns.shape)
        inner = self.steps(step.inner)
        still = step.residuals.ravel()
        still = still[self.of[still] < 0]
        if len(still):
            self.active(still)
            inner += (Apply(ZERO, np.zeros((len(still), 0), int), self.of[still]),)
        return [Solve(inner, unknowns, self.of[step.residuals], True, False)]
