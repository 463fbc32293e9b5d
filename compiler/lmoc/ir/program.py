"""The reduced system as a program over registers: what every way of evaluating it lowers.

All numbers of a run live in one vector of *registers*: parameters, derived parameters, inputs and their
derivatives, states, and everything computed from them. A program is a list of steps in an order in which each
step reads only what earlier ones have written. A step serves many instances at once: a chain of springs has about ten
steps, whatever its length. Casadi, numpy and C are three lowerings of the same steps, and SymPy is a fourth.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Apply:
    """``w[out[i]] = shape(w[slots[i, 0]], w[slots[i, 1]], …)`` for every row i.

    The shape's leaves are slots of order 0, constants and time. The rows of one step do not read each other's results.
    """

    shape: Expr
    slots: np.ndarray  # (n, columns) registers
    out: np.ndarray  # (n,) registers, all different


@dataclass(frozen=True, eq=False)
class Total:
    """``w[out[i]] = Σ_j coefficient[j]·w[index[j]]`` over ``j`` in ``start[i] … start[i+1]-1``."""

    start: np.ndarray  # (n+1,)
    index: np.ndarray  # (nnz,) registers
    coefficient: np.ndarray  # (nnz,) numbers (±1 mostly)
    out: np.ndarray  # (n,) registers


@dataclass(frozen=True, eq=False)
class Solve:
    """Implicit equations: ``w[unknowns[b, :]]`` such that ``w[residuals[b, :]]`` vanish, each instance b on its own.

    `inner` computes the residual registers (and what is torn between) from the unknowns and from what is known.

    Attributes
    ----------
    inner : tuple of Apply, Total, Solve
    unknowns, residuals : (instances, size) registers
    linear : bool
        The residuals are linear in the unknowns.
    constant : bool
        Linear, with a matrix that depends on parameters only: factorized once for each parameter set.
    guess : (instances, size) registers or -1
        What to start Newton from where no earlier solution is at hand (a start value's register).
    """

    inner: tuple[Step, ...]
    unknowns: np.ndarray
    residuals: np.ndarray
    linear: bool
    constant: bool
    guess: np.ndarray | None = None


Step = Apply | Total | Solve
Program = tuple[Step, ...]


class Role(IntEnum):
    """The source of a register's value."""

    KNOWN = 0  # a constant, a parameter: from FlatDAE.parameter_values
    DERIVED = 1  # computed from KNOWN once for each parameter set (elimination factors, offsets)
    INPUT = 2  # a signal or a derivative of it
    STATE = 3  # integrated
    QUADRATURE = 4  # integrated along, read by nothing
    COMPUTED = 5  # by the right-hand side or when observed


@dataclass(frozen=True, eq=False)
class Registers:
    """The table of registers.

    Attributes
    ----------
    role : (count,) Role
    variable, order : (count,) int
        The jet that the register holds: the order-th time derivative of a variable of the flat model; variable is -1
        for helpers (residuals, derived parameters), which are named by `structure.reduced.Reduced.register_name`.
    """

    role: np.ndarray
    variable: np.ndarray
    order: np.ndarray

    @property
    def count(self) -> int:
        return len(self.role)


def written(step: Step) -> np.ndarray:
    """Registers that a step fills."""
    if isinstance(step, Solve):
        return np.concatenate([step.unknowns.ravel(), *(written(s) for s in step.inner)])
    return step.out


def read(step: Step) -> np.ndarray:
    """Registers that a step reads (those a Solve fills itself left out)."""
    if isinstance(step, Apply):
        return step.slots.ravel()
    if isinstance(step, Total):
        return step.index
    inside = np.concatenate([read(s) for s in step.inner]) if step.inner else np.zeros(0, int)
    return np.setdiff1d(inside, written(step))


def needed_steps(program: Program, registers: np.ndarray, count: int) -> Program:
    """The steps without which the given registers are not filled, in order; rows that nobody needs are left out."""
    return split_program(program, registers, count)[0]


def unfilled(program: Program, wanted: np.ndarray, count: int) -> np.ndarray:
    """Return the registers among so many that a program reads, or that are wanted, and that it does not fill."""
    filled, used = np.zeros(count, bool), np.zeros(count, bool)
    used[wanted[wanted < count]] = True
    for step in program:
        for mask, own in ((filled, written(step)), (used, read(step))):
            mask[own[own < count]] = True
    return np.flatnonzero(used & ~filled)


def split_program(program: Program, registers: np.ndarray, count: int) -> tuple[Program, Program]:
    """A program in two: the steps without which the given registers are not filled, and what is left of the others."""
    wanted = np.zeros(count, bool)
    wanted[registers] = True
    kept: list[Step] = []
    left: list[Step] = []
    for step in reversed(program):
        hit = wanted[written(step)]
        if isinstance(step, Solve):
            hit[:] = hit.any()
        if hit.any():
            part = _rows(step, hit)
            wanted[read(part)] = True
            kept.append(part)
        if not hit.all():
            left.append(_rows(step, ~hit))
    return tuple(reversed(kept)), tuple(reversed(left))


def _rows(step: Step, chosen: np.ndarray) -> Step:
    if chosen.all():
        return step
    if isinstance(step, Apply):
        return Apply(step.shape, step.slots[chosen], step.out[chosen])
    assert isinstance(step, Total)  # the rows of a block stay together
    return _rows_of_total(step, np.flatnonzero(chosen))


def _rows_of_total(step: Total, rows: np.ndarray) -> Total:
    lengths = np.diff(step.start)[rows]
    start = np.concatenate([[0], np.cumsum(lengths)])
    entries = np.repeat(step.start[rows] - start[:-1], lengths) + np.arange(start[-1])
    return Total(start, step.index[entries], step.coefficient[entries], step.out[rows])


def walk(program: Program) -> Iterator[Step]:
    """Yield every step, those inside blocks too."""
    for step in program:
        yield step
        if isinstance(step, Solve):
            yield from walk(step.inner)


def program_rows(program: Program) -> int:
    """Return the number of rows of all steps, as a measure of size."""
    return sum(s.unknowns.size if isinstance(s, Solve) else len(s.out) for s in walk(program))
