"""Run a program with numpy: one vector operation a node of a shape, whatever the number of rows and times.

The register vector ``w`` has shape (count,), or (count, times) to evaluate a whole trajectory at once.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.evaluate import evaluate_quietly
from lmoc.ir.program import Apply, Program, Solve, Total
from lmoc.numerics.solve.follow import Follower
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.newton import Newton, dense_solve
from lmoc.support.sizes import DENSE


class Interpreter:
    """A program made ready to run many times.

    Keeps what may be kept between runs: factors of constant linear blocks, solutions of nonlinear blocks (the next
    run starts from them). `reset` forgets both and is due when parameter values change.
    """

    def __init__(self, program: Program, count: int) -> None:
        self.program = program
        self.count = count
        self._blocks: dict[int, _Block] = {}
        self._prepare(program)
        blocks = [b for b in self._blocks.values() if b.newton is not None]
        self.newtons = [b.newton for b in blocks]
        unknowns = [b.step.unknowns for b in blocks]
        self.follower = Follower(lambda w, t: self.steps(program, w, t), self.newtons, unknowns)

    def _prepare(self, program: Program) -> None:
        for step in program:
            if isinstance(step, Solve):
                self._prepare(step.inner)
                self._blocks[id(step)] = _Block(step, self)

    def reset(self) -> None:
        for block in self._blocks.values():
            block.reset()

    def matrix(self, step: Solve, w: np.ndarray, time: float) -> np.ndarray:
        """∂residuals/∂unknowns of a block, (instances, size, size), after the program has run on `w`."""
        return self._blocks[id(step)].matrix(w, time)

    def run(self, w: np.ndarray, time: float | np.ndarray) -> None:
        """Fill the registers that the program writes; what cannot be computed becomes NaN."""
        with np.errstate(all="ignore"):
            if w.ndim == 2 and self.newtons:
                self.follower(w, np.broadcast_to(time, w.shape[1:]))
            else:
                self.steps(self.program, w, time)

    def steps(self, program: Program, w: np.ndarray, time: float | np.ndarray) -> None:
        for step in program:
            if isinstance(step, Apply):
                run_apply(step, w, time)
            elif isinstance(step, Total):
                run_total(step, w)
            else:
                self._blocks[id(step)].run(w, time)


def run_apply(step: Apply, w: np.ndarray, time: float | np.ndarray) -> None:
    w[step.out] = evaluate_quietly(step.shape, lambda k, _: w.take(step.slots[:, k], axis=0), time)


def run_total(step: Total, w: np.ndarray) -> None:
    coefficient = step.coefficient.reshape(-1, *[1] * (w.ndim - 1))
    w[step.out] = segment_sums(coefficient * w.take(step.index, axis=0), step.start)


def segment_sums(terms: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Sums of ``terms[start[i]:start[i+1]]`` along the first axis; an empty segment gives zero."""
    if len(start) < 2:
        return np.zeros((0, *terms.shape[1:]))
    # reduceat wants indices inside the array, and gives the element itself for an empty segment
    padded = np.concatenate([terms, np.zeros((1, *terms.shape[1:]))])
    sums = np.add.reduceat(padded, start[:-1], axis=0)
    sums[np.diff(start) == 0] = 0.0
    return sums


class _Block:
    """A Solve step with its Jacobian and what it remembers."""

    def __init__(self, step: Solve, interpreter: Interpreter) -> None:
        self.step = step
        self.interpreter = interpreter
        self.jacobian = Jacobian(step.inner, step.unknowns.ravel(), step.residuals.ravel(), interpreter.count)
        size = step.unknowns.shape[1]
        self.instance, row = np.divmod(self.jacobian.rows, size)
        self.place = (self.instance, row, self.jacobian.columns % size)
        self.sparse = step.linear and size > DENSE
        self.newton = None if step.linear else Newton(step.unknowns.shape)
        self.reset()

    def reset(self) -> None:
        self._factors: list | None = None
        self._inverse: np.ndarray | None = None
        if self.newton is not None:
            self.newton.forget()

    def run(self, w: np.ndarray, time) -> None:
        if self.newton is not None:
            self._run_newton(w, time)
        elif self.sparse:
            self._run_sparse(w, time)
        else:
            self._run_dense(w, time)

    def _residual(self, w: np.ndarray, time) -> np.ndarray:
        self.interpreter.steps(self.step.inner, w, time)
        return w[self.step.residuals]

    def matrix(self, w: np.ndarray, time) -> np.ndarray:
        """∂residuals/∂unknowns as (instances, size, size), or (instances, times, size, size)."""
        values = self.jacobian.values(w, time)
        instances, size = self.step.unknowns.shape
        if w.ndim == 1:
            a = np.zeros((instances, size, size))
            a[self.place] = values
            return a
        a = np.zeros((instances, size, size, w.shape[1]))
        a[self.place] = values
        return np.moveaxis(a, 3, 1)

    def _run_dense(self, w: np.ndarray, time) -> None:
        w[self.step.unknowns] = 0.0
        r = self._residual(w, time)
        if w.ndim == 2:
            r = np.moveaxis(r, 2, 1)
        if self.step.constant and self._inverse is None:
            at = w if w.ndim == 1 else np.ascontiguousarray(w[:, 0])
            eye = np.broadcast_to(np.eye(r.shape[-1]), (len(r), r.shape[-1], r.shape[-1]))
            self._inverse = dense_solve(self.matrix(at, np.ravel(time)[0]), eye)
        if self.step.constant:
            inverse = self._inverse if w.ndim == 1 else self._inverse[:, None]
            u = -(inverse @ r[..., None])[..., 0]
        else:
            u = -dense_solve(self.matrix(w, time), r[..., None])[..., 0]
        w[self.step.unknowns] = u if w.ndim == 1 else np.moveaxis(u, 1, 2)
        self.interpreter.steps(self.step.inner, w, time)

    def _run_sparse(self, w: np.ndarray, time) -> None:
        w[self.step.unknowns] = 0.0
        r = self._residual(w, time)
        if self._factors is None or not self.step.constant:
            values = self.jacobian.values(w, time)
            if w.ndim == 2:
                if not self.step.constant and (values != values[:, :1]).any():
                    self._run_columns(w, time)
                    return
                values = values[:, 0]
            self._factors = self._factorize(values)
        for factor, unknowns, residual in zip(self._factors, self.step.unknowns, r, strict=True):
            w[unknowns] = np.nan if factor is None else -factor.solve(residual)
        self.interpreter.steps(self.step.inner, w, time)

    def _run_columns(self, w: np.ndarray, time) -> None:
        """Run one time after the other, since the matrix changes between them."""
        for k, t in enumerate(np.broadcast_to(time, w.shape[1:])):
            column = np.ascontiguousarray(w[:, k])
            self._run_sparse(column, t)
            w[:, k] = column

    def _factorize(self, values: np.ndarray) -> list:
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        size = self.step.unknowns.shape[1]
        factors = []
        for b in range(len(self.step.unknowns)):
            own = self.instance == b
            entries = (values[own], (self.place[1][own], self.place[2][own]))
            try:
                factors.append(splu(csc_matrix(entries, shape=(size, size))))
            except RuntimeError:  # exactly singular: no value, which whoever asked reports with its place
                factors.append(None)
        return factors

    def _run_newton(self, w: np.ndarray, time) -> None:
        step = self.step

        def residual(u: np.ndarray) -> np.ndarray:
            w[step.unknowns] = u
            return self._residual(w, time)

        def matrix(u: np.ndarray) -> np.ndarray:
            return self.matrix(w, time)

        guess = np.zeros(step.unknowns.shape)
        if step.guess is not None:
            guess = np.where(step.guess >= 0, w[step.guess], 0.0)
        if self.newton.last is None:  # a value there is a first guess
            guess = np.where(np.isfinite(w[step.unknowns]), w[step.unknowns], guess)
        w[step.unknowns] = self.newton.solve(residual, matrix, guess)
        self.interpreter.steps(step.inner, w, time)
