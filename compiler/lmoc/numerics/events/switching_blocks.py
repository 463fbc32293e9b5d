"""Implicit blocks whose matrices depend on discrete values, and whether they determine their unknowns."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program, Solve, needed_steps, read
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.newton import shortest_solution
from lmoc.structure.laws.degree import dependent

_SINGULAR = 1e-14  # of the largest singular value, of a matrix with rows and columns of one size
_KEPT = 10_000  # combinations of discrete values whose result is kept


class SwitchingBlocks:
    """The blocks of a program.

    Two frictions that hold one shaft share its load in no way that equations tell: their block is singular, and what
    the elimination makes of it is rounding.

    Parameters
    ----------
    program, count : what fills how many registers
    discrete : registers of the discrete values
    """

    def __init__(self, program: Program, discrete: np.ndarray, count: int) -> None:
        self._program, self._discrete = program, discrete
        changing = dependent(program, discrete, count)
        self._blocks = [s for s in program if isinstance(s, Solve) and not s.constant and changing[read(s)].any()]
        self._read = [np.flatnonzero(self._reads(program, step, count)) for step in self._blocks]
        self._all_read = np.unique(np.concatenate([np.zeros(0, int), *self._read]))
        self._interpreter = Interpreter(program, count) if self._blocks else None
        self._found: dict[bytes, np.ndarray] = {}
        self.tried: set[bytes] = set()  # discrete values for which others have been sought already

    def _reads(self, program: Program, block: Solve, count: int) -> np.ndarray:
        """Return (discrete,) which discrete values a block depends on."""
        reached = np.zeros(count, bool)
        reached[read(block)] = True
        for step in needed_steps(program, read(block), count):
            reached[read(step)] = True
        return reached[self._discrete]

    def __bool__(self) -> bool:
        return bool(self._blocks)

    def key(self, w: np.ndarray) -> bytes:
        """Return the discrete values that the blocks depend on."""
        return bytes(w[self._discrete[self._all_read]].tobytes())

    def undetermined_by(self, w: np.ndarray, time: float) -> np.ndarray:
        """Return which discrete values (by position) the singular blocks depend on; none where all are regular.

        Parameters
        ----------
        w : (count,) registers with all that is given; filled here
        """
        if self._interpreter is None:
            return np.zeros(0, int)
        key = self.key(w)
        if key not in self._found:
            self._interpreter.reset()
            self._interpreter.run(w, time)
            with np.errstate(all="ignore"):
                matrices = [self._interpreter.matrix(block, w, time) for block in self._blocks]
            singular = [any(is_singular(one) for one in block) for block in matrices]
            reads = [own for own, chosen in zip(self._read, singular, strict=True) if chosen]
            if len(self._found) >= _KEPT:
                self._found.clear()
            self._found[key] = np.unique(np.concatenate([np.zeros(0, int), *reads]))
        return self._found[key]

    def shared(self, w: np.ndarray, time: float) -> np.ndarray:
        """Return registers with the shortest solutions of singular blocks: frictions share the load that they hold."""
        assert self._interpreter is not None
        own = w.copy()
        self._interpreter.reset()
        with np.errstate(all="ignore"):
            for step in self._program:
                switches = isinstance(step, Solve) and any(step is block for block in self._blocks)
                if switches:
                    own[step.unknowns] = 0.0  # where Newton's method begins: its steps are the shortest ones, too
                self._interpreter.steps((step,), own, time)
                if switches and step.linear:
                    self._share(step, own, time)
        return own

    def _share(self, block: Solve, w: np.ndarray, time: float) -> None:
        """Replace what the elimination has made of the singular instances of a block."""
        assert self._interpreter is not None
        found = w[block.unknowns]
        w[block.unknowns] = 0.0
        self._interpreter.steps(block.inner, w, time)
        for k, matrix in enumerate(self._interpreter.matrix(block, w, time)):
            if is_singular(matrix):
                found[k] = -shortest_solution(matrix, w[block.residuals[k]])[0]
        w[block.unknowns] = found
        self._interpreter.steps(block.inner, w, time)


def is_singular(matrix: np.ndarray) -> bool:
    """Return whether a matrix is singular but for rounding, whatever the units of its rows and columns."""
    if not np.isfinite(matrix).all():
        return False
    scaled = np.abs(matrix)
    for axis in (0, 1, 0, 1):
        size = np.sqrt(scaled.max(axis=axis, keepdims=True) * 1.0)
        matrix = matrix / np.where(size > 0, size, 1.0)
        scaled = np.abs(matrix)
    singular = np.linalg.svd(matrix, compute_uv=False)
    return bool(singular[-1] <= _SINGULAR * len(matrix) * singular[0])
