"""IDA (Hindmarsh et al. 2005) on a compiled or a Python residual F(t, y, y') = 0."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_void_p

import numpy as np

from lmoc.numerics.sundials import sundials as sun
from lmoc.numerics.sundials.session import Given, SundialsSession

Residual = Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]  # (t, y, yp, out)


class IdaSession(SundialsSession):
    """F(t, y, y') = 0."""

    name = "IDA"
    counters = "Steps", "ResEvals", "JacEvals"
    no_value = -8, -9, -12

    def __init__(
        self, given: Given, residual: Residual | tuple[object, object], yp: np.ndarray, differential: np.ndarray
    ) -> None:
        """
        Parameters
        ----------
        residual : a Python function, or a compiled one (`sundials.RESIDUAL`) and the pointer to hand it as user data
        yp : (n,) y' at the start, consistent with y
        differential : (n,) which components have derivatives in F; the others stay out of the error test
        """
        self.yp, self.differential = np.array(yp, float), differential.astype(float)
        # callbacks are kept alive as long as IDA may call them
        compiled = residual if isinstance(residual, tuple) else (sun.RESIDUAL(self.callback(residual)), None)
        self.residual, self.data = compiled
        super().__init__(given)

    def create(self) -> c_void_p:
        lib = self.lib
        memory = c_void_p(lib.IDACreate(self.context))
        self.rate = self.vector(self.yp)
        lib.IDAInit(memory, self.residual, self.given.t, self.state, self.rate)
        lib.IDASetUserData(memory, self.data)
        lib.IDASVtolerances(memory, self.given.rtol, self.tolerance)
        if not self.differential.all():
            lib.IDASetId(memory, self.vector(self.differential))
            lib.IDASetSuppressAlg(memory, 1)
        return memory

    def attach(self) -> None:
        def fill(t, cj, y, yp, residual, jacobian, *_) -> int:
            return self.guarded(lambda: self.solver.fill(jacobian, t, self.view(y), cj))

        self.jacobian = sun.RESIDUAL_JACOBIAN(fill)
        self.call("SetJacFn", self.jacobian)

    def solve(self, t: float, task: int) -> int:
        return self.lib.IDASolve(self.memory, t, byref(self.reached), self.state, self.rate, task)

    def restart(self, t: float, y: np.ndarray, yp: np.ndarray) -> None:
        """Begin again at another state, without a past."""
        self.x[:], self.yp[:] = y, yp
        self.call("ReInit", t, self.state, self.rate)
