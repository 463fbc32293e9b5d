"""The closures of loops by loops of equal shape: their program, its derivatives, and where these stand in matrices."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.ir.program import Program, needed_steps, read, written
from lmoc.ir.reduced import Invariants
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.structure.blocks.blocks import blocks_of
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class EqualLoops:
    """Loops of equal shape on one stage: matrices (loops, m, n).

    Attributes
    ----------
    rows : (loops, m) residuals, among those of the stage
    columns : (loops, n) states
    entry : (k,) entries of the stage's Jacobian
    place : three arrays (k,): where each of them stands in the matrices
    """

    rows: np.ndarray
    columns: np.ndarray
    entry: np.ndarray
    place: tuple[np.ndarray, np.ndarray, np.ndarray]

    def matrices(self, entries: np.ndarray) -> np.ndarray:
        """(places, loops, m, n) from the entries of the stage (places, nnz)."""
        result = np.zeros((len(entries), *self.rows.shape, self.columns.shape[1]))
        result[(slice(None), *self.place)] = entries[:, self.entry]
        return result


@dataclass(frozen=True, eq=False)
class ClosureStage:
    """Closures of one stage, by the states that they are solved for.

    Attributes
    ----------
    program : fills the residuals of this stage
    residual : registers
    columns : the states of this stage, among all states
    jacobian : ∂residual/∂states, the columns as in `columns`
    loops : by shape
    """

    program: Program
    residual: np.ndarray
    columns: np.ndarray
    jacobian: Jacobian
    loops: tuple[EqualLoops, ...]


@dataclass(frozen=True, eq=False)
class Closing:
    """The program of a plan's closures and its derivatives, positions first."""

    program: Program
    count: int
    parameters: np.ndarray
    stages: tuple[ClosureStage, ...]


def closing(plan: Plan) -> Closing:
    """Return the closures of a plan in all coordinates of its loops."""
    own: Invariants = plan.reduced.invariants
    count = max(own.count, plan.count)
    program = needed_steps(plan.full_program + own.program, own.residual, count)
    changing, used = np.zeros((2, count), bool)
    changing[np.concatenate([plan.states, plan.sampled, *map(written, program)])] = True
    used[np.concatenate([read(step) for step in program])] = True
    stages = []
    for k in np.unique(own.stage)[::-1].tolist():
        residual, columns = own.residual[own.stage == k], np.flatnonzero(own.state_stage == k)
        steps = needed_steps(program, residual, count)
        jacobian = Jacobian(steps, plan.states[columns], residual, count)
        stages.append(ClosureStage(steps, residual, columns, jacobian, tuple(_loops(jacobian, len(residual), columns))))
    return Closing(program, count, np.flatnonzero(used & ~changing), tuple(stages))


def _loops(jacobian: Jacobian, rows: int, columns: np.ndarray) -> Iterator[EqualLoops]:
    """Yield the connected parts of a Jacobian, equal shapes together."""
    row, column = jacobian.rows, jacobian.columns
    ends = row, rows + column
    label = blocks_of(np.concatenate(ends), np.concatenate(ends[::-1]), rows + len(columns)).block
    parts = np.unique(label[:rows])
    heights = [np.flatnonzero(label[:rows] == p) for p in parts]
    widths = [np.flatnonzero(label[rows:] == p) for p in parts]
    shapes = [(len(a), len(b)) for a, b in zip(heights, widths, strict=True)]
    for shape in dict.fromkeys(shapes):
        own = [k for k, s in enumerate(shapes) if s == shape]
        height, width = np.array([heights[k] for k in own]), np.array([widths[k] for k in own])
        loop, i, j = np.full(rows, -1), np.zeros(rows, int), np.zeros(len(columns), int)
        loop[height] = np.arange(len(own))[:, None]
        i[height], j[width] = np.arange(shape[0]), np.arange(shape[1])
        entry = np.flatnonzero(loop[row] >= 0)
        place = loop[row[entry]], i[row[entry]], j[column[entry]]
        yield EqualLoops(height, columns[width], entry, place)
