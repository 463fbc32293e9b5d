"""Taylor series: the states as polynomials of high order about the beginning of each step, for smooth scenes.

Order and step after Jorba and Zou, A software package for the numerical integration of ODEs by means of high-order
Taylor methods, Experimental Mathematics 14 (2005): the order follows from the tolerance, the step from the size of the
last coefficients. Some of these vanish by symmetry, at a start from rest every second one, so that five are looked at;
and a step counts only if the polynomial still satisfies the differential equation at its end.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.evaluate.native.series import LENGTH
from lmoc.numerics.integrate.base import Integration, Problem, Properties
from lmoc.numerics.integrate.status import Status

PROPERTIES = Properties(
    "taylor", "Taylor series", "Taylor series", "8-26", "8-26", "own",
    needs="a C compiler, equations without kinks",
    good_for="small smooth scenes at 1e-9 and below",
)  # fmt: skip

_LEAST, _MOST = 8, 26  # orders
_SAFETY = 0.9
_LOOK = 50  # steps between two looks at their mean length
_GROWTH = 1.0  # of the order with the logarithm of the tolerance: 1/2 has the least work, more has fewer steps


def begin(problem: Problem) -> Integration | None:
    """Return the method at the beginning of a problem; None where there is no series or no C compiler."""
    from lmoc.numerics.evaluate.native.taylor_system import TaylorSystem

    try:
        system = problem.system.plan.once(TaylorSystem)
    except (Unsupported, OSError):
        return None
    system.prepare(*problem.system.given)
    registers = problem.system.registers
    if registers is not None:  # the solutions of blocks that the run has begun with
        own = system.kernel.unknowns
        system.w[own] = np.where(np.isfinite(registers[own]), registers[own], system.w[own])
    return Taylor(problem, system)


def order_for(rtol: float) -> int:
    """Return the order that suits a tolerance (after Jorba and Zou, equation 3.7)."""
    return int(np.clip(math.ceil(1.0 - _GROWTH * math.log(rtol)), _LEAST, _MOST))


class Taylor(Integration):
    """The method at work: the series of the last step, and of the next."""

    def __init__(self, problem: Problem, system) -> None:
        super().__init__(problem)
        self.system, self.order = system, order_for(problem.rtol)
        self.atol = np.ascontiguousarray(problem.atol, float)
        self.series, self.next = np.zeros((2, len(problem.x), LENGTH))
        self.t = self.before = problem.t
        self.jump(problem.x)
        self.evaluation = "C"

    def jump(self, x: np.ndarray) -> None:
        self.x = np.array(x, float)
        self.before = self.t
        self.finite = self._fill(self.t, self.x)

    def _fill(self, t: float, x: np.ndarray) -> bool:
        self.problem.system.evaluations += 1
        return self.system.series(t, x, self.order, self.next)

    def step(self) -> Status:
        if not self.finite:
            return Status.NOT_FINITE
        problem, system, order, rtol = self.problem, self.system, self.order, self.problem.rtol
        self.series, self.next = self.next, self.series
        h = min(_SAFETY * system.length(order, rtol, self.atol, self.series), problem.max_step, problem.end - self.t)
        x = np.empty_like(self.x)
        found, reached, tries = system.step(
            self.t, problem.end, h, rtol, (self.atol, self.series, x, self.next)
        )  # fmt: skip
        problem.system.evaluations += tries
        self.rejected += tries - 1
        if found:
            self.series, self.next = self.next, self.series
            return Status.COLLAPSED if found == 1 else Status.NOT_FINITE
        system.mark()
        self.steps += 1
        self.before, self.t, self.x, self.step_size = self.t, reached, x, h
        if self.steps % _LOOK == 0 and self.t - problem.t < self.steps * problem.shortest:
            return Status.STIFF
        return Status.OK

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return self.system.values(self.order, times - self.before, self.series)
