"""Values of the derivatives of a program by numpy, from the registers as the program has left them.

Where the matrix of a block is singular, the unknowns that it still determines have derivatives, the others have none
(NaN).
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.evaluate import evaluate_quietly
from lmoc.ir.program import Total
from lmoc.lower.chain_rule import ChainRule, Implicit, Product
from lmoc.numerics.solve.newton import dense_solve, shortest_solution


class Jacobian(ChainRule):
    """∂w[outputs]/∂w[inputs] of a program, with its values."""

    def values(self, w: np.ndarray, time) -> np.ndarray:
        """Values of the entries, (nnz,) or (nnz, times), after the program has run on `w`."""
        v = np.empty((self.size, *w.shape[1:]))
        for a, b in self.ones:
            v[a:b] = 1.0
        with np.errstate(all="ignore"):
            for stage in self.stages:
                if isinstance(stage, Product):
                    _multiply(stage, v, w, time)
                else:
                    _imply(stage, v)
        return v[self.source]


def _multiply(stage: Product, v: np.ndarray, w: np.ndarray, time) -> None:
    step = stage.step
    tail = w.shape[1:]
    if isinstance(step, Total):
        factors = step.coefficient.reshape(-1, *[1] * len(tail))
    else:
        n = len(step.out)
        factors = np.empty((len(stage.partials) * n, *tail))
        for k, (derivative, _) in enumerate(stage.partials):
            own = evaluate_quietly(derivative, lambda c, _: w.take(step.slots[:, c], axis=0), time)
            factors[k * n : (k + 1) * n] = own
    terms = factors[stage.which] * v[stage.source]
    v[stage.first : stage.stop] = terms if stage.single else np.add.reduceat(terms, stage.start, axis=0)


def _imply(stage: Implicit, v: np.ndarray) -> None:
    instances, size, width = stage.shape
    tail = v.shape[1:]
    a, b = np.zeros((instances, size, size, *tail)), np.zeros((instances, size, width, *tail))
    a[stage.a_place], b[stage.b_place] = v[stage.a_source], v[stage.b_source]
    if not width:
        return
    if tail:
        a, b = np.moveaxis(a, 3, 1), np.moveaxis(b, 3, 1)
    x = -dense_solve(a, b)
    for k in map(tuple, np.argwhere(~np.isfinite(x).all(axis=(-2, -1)))):
        solution, determined = shortest_solution(a[k], b[k])
        x[k] = np.where(determined[:, None], -solution, np.nan)
    if tail:
        x = np.moveaxis(x, 1, 3)
    v[stage.first : stage.stop] = x[stage.result]
