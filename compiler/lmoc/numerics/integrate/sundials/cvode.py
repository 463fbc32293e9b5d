"""CVODE (Cohen & Hindmarsh 1996) on a compiled or a Python right-hand side."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_void_p

import numpy as np

from lmoc.numerics.integrate.sundials import sundials as sun
from lmoc.numerics.integrate.sundials.session import Given, Session

Rhs = Callable[[float, np.ndarray, np.ndarray], None]  # (t, x, out)


class CvodeSession(Session):
    """x' = rhs(t, x)."""

    name = "CVode"
    counters = "Steps", "RhsEvals", "JacEvals"
    no_value = -8, -9, -10, -11

    def __init__(self, given: Given, rhs: Rhs | tuple[object, object], method: str) -> None:
        """
        Parameters
        ----------
        rhs : a Python function, or a compiled one (`sundials.RHS`) and the pointer to hand it as user data
        method : "bdf" or "adams" (both with Newton's method on the Jacobian)
        """
        self.method = method
        # callbacks are kept alive as long as CVODE may call them
        self.rhs, self.data = rhs if isinstance(rhs, tuple) else (sun.RHS(self.callback(rhs)), None)
        super().__init__(given)

    def create(self) -> c_void_p:
        lib = self.lib
        memory = c_void_p(lib.CVodeCreate(sun.ADAMS if self.method == "adams" else sun.BDF, self.context))
        lib.CVodeInit(memory, self.rhs, self.given.t, self.state)
        lib.CVodeSVtolerances(memory, self.given.rtol, self.tolerance)
        lib.CVodeSetUserData(memory, self.data)
        return memory

    def attach(self) -> None:
        def fill(t, x, fx, jacobian, *_) -> int:
            return self.guarded(lambda: self.solver.fill(jacobian, t, self.view(x)))

        self.jacobian = sun.JACOBIAN(fill)
        self.call("SetJacFn", self.jacobian)

    def solve(self, t: float, task: int) -> int:
        return self.lib.CVode(self.memory, t, self.state, byref(self.reached), task)

    def restart(self, t: float, x: np.ndarray) -> None:
        """Begin again at another state, without a past."""
        self.x[:] = x
        self.call("ReInit", t, self.state)
