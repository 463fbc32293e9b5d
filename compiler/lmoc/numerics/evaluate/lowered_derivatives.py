"""The Jacobian of a small system with implicit blocks as a casadi function: where there is no C compiler.

All blocks are laid open, f(x, z) and 0 = g(x, z), and their partial derivatives written by casadi; the implicit
function theorem gives ``∂f/∂x - ∂f/∂z (∂g/∂z)⁻¹ ∂g/∂x`` (Hairer & Wanner, Solving Ordinary Differential Equations II,
section VI.1).
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.evaluate.casadi_system import Buffered, lower_steps, shared
from lmoc.numerics.evaluate.newton import dense_solve
from lmoc.numerics.evaluate.opened import open_blocks
from lmoc.numerics.evaluate.segments import outside
from lmoc.numerics.evaluate.vector_system import VectorSystem
from lmoc.support.sizes import DENSE


class LoweredJacobian(VectorSystem):
    """A system small enough for casadi, with its Jacobian in casadi, too."""

    _lowered: LoweredDerivatives | None = None

    def _entries(self, t: float) -> np.ndarray:
        if self._lowered is None:
            self._lowered = LoweredDerivatives(self.program, self.inputs, self.outputs, self.plan.count)
        if self._lowered.is_small:
            found = self._lowered(self.w, t)[self._derivative.rows, self._derivative.columns]
            if np.isfinite(found).all():
                return found  # else a block is singular: numpy knows which unknowns it still determines
        return super()._entries(t)


class LoweredDerivatives:
    """∂w[outputs]/∂w[inputs] from the registers as the program has left them.

    Attributes
    ----------
    is_small : whether inputs and unknowns of all blocks are few enough for dense matrices; else it cannot be called
    """

    def __init__(self, program: Program, inputs: np.ndarray, outputs: np.ndarray, count: int) -> None:
        import casadi as ca

        opened, unknowns, residuals = open_blocks(program, lambda block: True)
        self.is_small = max(len(inputs), len(unknowns)) <= DENSE
        if not self.is_small:
            return
        read = outside(opened, np.zeros(0, int), count)
        self._reads = np.unique(np.concatenate([read, inputs, unknowns, outputs]))
        t, values = ca.SX.sym("t"), ca.SX.sym("w", len(self._reads))
        w: list = [None] * count
        for register, symbol in zip(self._reads.tolist(), ca.vertsplit(values), strict=True):
            w[register] = symbol
        of = {register: k for k, register in enumerate(self._reads.tolist())}
        lower_steps(opened, w, t)
        results = [ca.vertcat(ca.SX(0, 1), *[w[r] for r in registers.tolist()]) for registers in (outputs, residuals)]
        x, z = (ca.vertcat(ca.SX(0, 1), *[values[of[r]] for r in own.tolist()]) for own in (inputs, unknowns))
        parts = [ca.densify(ca.jacobian(result, symbols)) for result in results for symbols in (x, z)]
        self._time, self._values = np.zeros(1), np.zeros(len(self._reads))
        function = ca.Function("derivatives", [t, values], shared(parts))
        self._call = Buffered(function, (self._time, self._values))
        self._sizes = len(inputs), len(unknowns), len(outputs)

    def __call__(self, w: np.ndarray, time: float) -> np.ndarray:
        """Return the dense matrix, (outputs, inputs); not finite where the blocks' matrix is singular."""
        self._time[0] = time
        np.take(w, self._reads, out=self._values)
        self._call()
        x, z, f = self._sizes
        shapes = (f, x), (f, z), (z, x), (z, z)
        f_x, f_z, g_x, g_z = (
            values.reshape(shape, order="F") for values, shape in zip(self._call.results, shapes, strict=True)
        )
        with np.errstate(all="ignore"):  # a singular matrix gives what is not finite
            slope = dense_solve(g_z, g_x)
            slope += dense_solve(g_z, g_x - g_z @ slope)  # equations of different sizes: Skeel, Math. Comp. 35 (1980)
            return f_x - f_z @ slope
