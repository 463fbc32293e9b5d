"""CVODE (Cohen & Hindmarsh 1996) on a compiled or a Python right-hand side."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_void_p

import numpy as np

from lmoc.numerics.sundials import sundials as sun
from lmoc.numerics.sundials.session import Given, SundialsSession

_GIVEN_UP = -3, -4  # too many shorter steps in a row have failed the error test, or Newton's method
_BEGINNINGS, _PROGRESS = 20, 1e-4  # new ones within this part of the time ahead

Rhs = Callable[[float, np.ndarray, np.ndarray], None]  # (t, x, out)


class CvodeSession(SundialsSession):
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
        self._stuck, self._beginnings = -np.inf, 0  # s, where it has given up, and how often near there
        self._counted: dict[str, int] = {}  # before it has last begun
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
        """As of `SundialsSession`; where it gives up it begins again, without a past and with a step to fit.

        After a long step seven shorter ones are not always short enough: its error in the position is within the
        tolerance, and a stiff spring makes of it a velocity far above that of the velocity.
        """
        while True:
            flag = self.lib.CVode(self.memory, t, self.state, byref(self.reached), task)
            if flag not in _GIVEN_UP or self.error is not None or not np.isfinite(self.x).all() or not self._goes_on():
                return flag
            self.restart(self.t, self.x)

    def _goes_on(self) -> bool:
        """Return whether it has got on since it has given up last, or has not often done so near there."""
        if self.t - self._stuck > _PROGRESS * (self.given.end - self.t):
            self._stuck, self._beginnings = self.t, 0
        self._beginnings += 1
        return self._beginnings <= _BEGINNINGS

    def restart(self, t: float, x: np.ndarray) -> None:
        """Begin again at another state, without a past."""
        self._counted = self.counts()
        self.x[:] = x
        self.call("ReInit", t, self.state)

    def counts(self) -> dict[str, int]:
        return {name: self._counted.get(name, 0) + n for name, n in super().counts().items()}
