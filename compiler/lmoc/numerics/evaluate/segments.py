"""Small programs with blocks: explicit stretches and the blocks' residuals are casadi functions, the solving is here.

A nonlinear block starts from its last solution and so keeps to its branch, which a function without memory could not.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.ir.program import Program, Solve, read, written
from lmoc.numerics.evaluate.casadi_system import Buffered, Lowered, can_lower
from lmoc.numerics.evaluate.newton import Newton, dense_solve, vanishes
from lmoc.support.sizes import LARGE_BLOCK

_EXACT = 1e-13  # as in `newton`
_QUICK = 10  # undamped steps before the damped method takes over


def can_segment(program: Program) -> bool:
    """Return whether everything inside the blocks is explicit, and they are small enough for dense matrices."""
    return all(not isinstance(s, Solve) or can_lower((s,)) or _small(s) and can_lower(s.inner) for s in program)


def _small(step: Solve) -> bool:
    return step.unknowns.shape[1] <= LARGE_BLOCK


class SegmentedProgram:
    """A program on one register vector; the same interface as `evaluate.Interpreter`."""

    def __init__(self, program: Program, count: int) -> None:
        self.pieces: list[_Segment | _Block] = []
        stretch: list = []
        for step in program:
            if isinstance(step, Solve) and not can_lower((step,)):
                self._close(stretch, count)
                stretch = []
                self.pieces.append(_Block(step, count))
            else:
                stretch.append(step)
        self._close(stretch, count)

    def _close(self, stretch: list, count: int) -> None:
        if stretch:
            self.pieces.append(_Segment(tuple(stretch), count))

    def reset(self) -> None:
        for piece in self.pieces:
            piece.reset()

    @property
    def blocks(self) -> list[np.ndarray]:
        """The registers of the unknowns of nonlinear blocks, (instances, size) each."""
        return [block.step.unknowns for block in self._nonlinear]

    @property
    def newtons(self) -> list[Newton]:
        """The solvers of nonlinear blocks."""
        return [block.newton for block in self._nonlinear]

    nonlinear_newtons = newtons

    @property
    def unknowns(self) -> np.ndarray:
        """One register of each instance of a nonlinear block."""
        return np.concatenate([block.step.unknowns[:, 0] for block in self._nonlinear])

    def determinants(self) -> np.ndarray:
        """Of the Jacobian of each instance of a nonlinear block, where it was solved last."""
        with np.errstate(invalid="ignore"):
            return np.concatenate([np.linalg.det(block.matrix()) for block in self._nonlinear])

    @property
    def _nonlinear(self) -> list[_Block]:
        return [p for p in self.pieces if isinstance(p, _Block) and not p.step.linear]

    def run(self, w: np.ndarray, time: float) -> None:
        """Fill the registers that the program writes; what cannot be computed becomes NaN."""
        for piece in self.pieces:
            piece.run(w, time)


def outside(program: Program, own: np.ndarray, count: int) -> np.ndarray:
    """Registers that a program reads and neither writes nor has among `own`."""
    used = np.zeros(count, bool)
    for step in program:
        used[read(step)] = True
    for step in program:
        used[written(step)] = False
    used[own] = False
    return np.flatnonzero(used)


class _Segment:
    """Explicit steps as one function."""

    def __init__(self, program: Program, count: int) -> None:
        none = np.zeros(0, int)
        self.reads = outside(program, none, count)
        self.writes = np.unique(np.concatenate([written(s) for s in program]))
        function = Lowered(program, count, none, self.reads, none, self.writes).function("segment")
        self.time, self.values, nothing = np.zeros(1), np.zeros(len(self.reads)), np.zeros(0)
        self.call = Buffered(function, (self.time, nothing, self.values, nothing))

    def reset(self) -> None:
        """There is nothing to forget."""

    def run(self, w: np.ndarray, time: float) -> None:
        self.time[0] = time
        np.take(w, self.reads, out=self.values)
        self.call()
        w[self.writes] = self.call.results[0]


class _Block:
    """A block: its residuals, their Jacobian and what lies between as one function, and the solving around it."""

    def __init__(self, step: Solve, count: int) -> None:
        import casadi as ca

        self.step = step
        self.unknowns, residuals = step.unknowns.ravel(), step.residuals.ravel()
        self.reads = outside(step.inner, self.unknowns, count)
        inside = np.unique(np.concatenate([written(s) for s in step.inner]))
        self.between = inside[~np.isin(inside, np.concatenate([self.unknowns, residuals]))]
        lowered = Lowered(step.inner, count, self.unknowns, self.reads, [], [*residuals, *self.between])
        residual, rest = lowered.out[: len(residuals)], lowered.out[len(residuals) :]
        jacobian = ca.jacobian(residual, lowered.x)
        arguments = [lowered.time, lowered.x, lowered.p, lowered.u]
        function = ca.Function("block", arguments, [residual, jacobian, ca.densify(rest)])
        self.time, self.x, self.values = np.zeros(1), np.zeros(len(self.unknowns)), np.zeros(len(self.reads))
        self.call = Buffered(function, (self.time, self.x, self.values, np.zeros(0)))
        self.r, self.j, self.rest = self.call.results
        instances, size = step.unknowns.shape
        rows, columns = np.array(jacobian.sparsity().row(), int), np.array(jacobian.sparsity().get_triplet()[1], int)
        self.place = rows // size, rows % size, columns % size
        self.a = np.zeros((instances, size, size))
        self.scalar = len(self.unknowns) == 1 and len(self.j) == 1
        self.newton = Newton(step.unknowns.shape)

    def reset(self) -> None:
        self.newton.forget()

    def run(self, w: np.ndarray, time: float) -> None:
        step, newton = self.step, self.newton
        self.time[0] = time
        np.take(w, self.reads, out=self.values)
        guess = self._guess(w)
        start = guess if newton.last is None else newton.last
        self.x[:] = 0.0 if step.linear else start.ravel()
        newton.start = start
        if self._quick():
            newton.last = self.x.reshape(step.unknowns.shape).copy()
        elif step.linear or not newton.patient:
            self.x[:] = newton.target[:] = np.nan
        else:
            self.x[:] = newton.solve(self._residual, self._matrix, guess).ravel()
        self.call()
        w[self.unknowns] = self.x
        w[self.between] = self.rest

    def _guess(self, w: np.ndarray) -> np.ndarray:
        step = self.step
        if step.linear or self.newton.last is not None:
            return np.zeros(step.unknowns.shape) if self.newton.last is None else self.newton.last
        given = np.zeros(step.unknowns.shape)
        if step.guess is not None:
            given = np.where(step.guess >= 0, w[step.guess], 0.0)
        return np.where(np.isfinite(w[step.unknowns]), w[step.unknowns], given)

    def _quick(self) -> bool:
        """Full Newton steps while each is at most half as long as the one before; False where that fails."""
        before = math.inf
        for iteration in range(_QUICK):
            self.call()
            change = self._correction()
            length = float(np.abs(change).max())
            if not (self.step.linear or length <= 0.5 * before) and self._solved():
                change = length = 0.0
            self.x += change
            if not iteration:
                self.newton.target = self.x.reshape(self.newton.shape).copy()
            if self.step.linear or length <= _EXACT * (1.0 + float(np.abs(self.x).max())):
                return math.isfinite(length)
            if not length <= 0.5 * before:
                return False
            before = length
        return False

    def matrix(self) -> np.ndarray:
        """Return the matrix of the block's last evaluation, (instances, size, size)."""
        self.a[self.place] = self.j
        return self.a

    def _solved(self) -> bool:
        shape = self.newton.shape
        return bool(vanishes(self.matrix(), self.r.reshape(shape), self.x.reshape(shape)).all())

    def _correction(self) -> np.ndarray | float:
        if self.scalar:
            slope = float(self.j[0])
            return -float(self.r[0]) / slope if slope else math.nan
        return -dense_solve(self.matrix(), self.r.reshape(*self.step.unknowns.shape, 1)).ravel()

    def _residual(self, u: np.ndarray) -> np.ndarray:
        self.x[:] = u.ravel()
        self.call()
        return self.r.reshape(u.shape).copy()

    def _matrix(self, u: np.ndarray) -> np.ndarray:
        return self.matrix()
