"""Taylor series: the states as polynomials of high order about the beginning of each step, for smooth scenes.

Order and step after Jorba and Zou, A software package for the numerical integration of ODEs by means of high-order
Taylor methods, Experimental Mathematics 14 (2005): the order follows from the tolerance, the step from the size of the
last coefficients. Some of these vanish by symmetry, at a start from rest every second one, so that five are looked at;
and a step counts only if the polynomial still satisfies the differential equation at its end.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.engine.pieces import passing
from lmoc.lower.recurrences import NoSeries
from lmoc.lower.series import LENGTH
from lmoc.numerics.evaluate.taylor_system import TaylorSystem
from lmoc.numerics.problem.base import Integration, Pieces, Problem, Properties
from lmoc.numerics.problem.status import Inapplicable, Status

PROPERTIES = Properties(
    "taylor", "Taylor series", "Taylor series", "18-26", "18-26", "own",
    needs="equations without kinks",
    good_for="smooth scenes over many steps, and many digits",
)  # fmt: skip

_LEAST, _MOST = 18, 26  # orders; steps of a lower one are hardly cheaper, and there are more of them
_LOOK = 50  # steps from which their mean length is looked at
_FAILED = {1: Status.COLLAPSED, 2: Status.NOT_FINITE, 3: Status.DOUBTFUL}  # what a walk in C returns
_GROWTH = 1.0  # of the order with the logarithm of the tolerance: 1/2 has the least work, more has fewer steps


def begin(problem: Problem) -> Taylor:
    """Return the method at the beginning of a problem.

    Raises
    ------
    Inapplicable
        The scene has no series.
    """
    if problem.system.python_inputs:
        raise Inapplicable("an input has no formula")
    try:
        system = problem.system.with_series(TaylorSystem)
    except NoSeries as error:
        raise Inapplicable(str(error)) from error
    system.prepare(*problem.system.given)
    registers = problem.system.registers
    if registers is not None:  # the solutions of blocks that the run has begun with
        own = system.kernel.unknowns
        system.w[own] = np.where(np.isfinite(registers[own]), registers[own], system.w[own])
    return Taylor(problem, system)


def order_for(rtol: float) -> int:
    """Return the order that suits a tolerance (after Jorba and Zou, equation 3.7)."""
    return min(max(math.ceil(1.0 - _GROWTH * math.log(rtol)), _LEAST), _MOST)


class Taylor(Integration):
    """The method at work: the series of the last step, and of the next."""

    looks = 4  # as many in C (``engine/c/taylor.c``)

    def __init__(self, problem: Problem, system: TaylorSystem) -> None:
        super().__init__(problem)
        self.system, self.order, self.t = system, order_for(problem.rtol), problem.t
        n = len(problem.x)
        self.x = np.array(problem.x, float)
        self._between, self._series, self._atol = np.zeros(n), np.zeros((2, n, LENGTH)), np.array(problem.atol, float)
        self._walk = walk = system.new_walk(problem.end, problem.max_step, problem.rtol)
        walk.atol, walk.between, walk.x = (a.ctypes.data for a in (self._atol, self._between, self.x))
        walk.q, walk.next = (a.ctypes.data for a in self._series)
        self.jump(problem.x)

    def jump(self, x: np.ndarray) -> None:
        walk = self._walk
        self.x[:] = x
        self.before = walk.before = walk.time = self.t
        self.problem.system.evaluations += 1
        self.finite = self.system.series(self.t, self.x, self.order, walk.next)

    def begin_piece(self, problem: Problem) -> bool:
        self.problem, self.t = problem, problem.t
        self.steps = self.rejected = 0
        self._walk.end, self._walk.longest = problem.end, problem.max_step
        self.jump(problem.x)
        return True

    def step(self) -> Status:
        walk = self._walk
        walk.most, walk.outputs, walk.hook = 1, 0, None
        return self._walked()

    @property
    def walker(self) -> Taylor:
        return self

    def walk(self, times: np.ndarray, room: int, most: int, hook: int | None) -> tuple[Status, int]:
        walk, out = self._walk, np.empty((min(room, len(times)), len(self.x)))
        walk.most, walk.outputs, walk.room, walk.hook = most, len(times), len(out), hook
        walk.times, walk.out = times.ctypes.data, out.ctypes.data
        status = self._walked()
        self._collected.append(out[: walk.reached])
        return status, walk.reached

    def pass_kinks(self, pieces: Pieces, room: int, most: tuple[int, int, int]) -> tuple[int, int, bool]:
        out = np.empty((min(room, len(pieces.times)), len(self.x)))
        own = passing(self.system.shared_call(), pieces.bounds, pieces.times, out, most)
        self.system.pass_kinks(self._walk, own)
        self.problem.system.evaluations += own.evaluations
        self.steps += own.steps
        self.rejected += own.rejected
        self.before, self.t, self.step_size = own.before, own.time, self._walk.length
        self._collected.append(out[: own.reached])
        return own.passed, own.reached, bool(own.stuck)

    def _walked(self) -> Status:
        if not self.finite:
            self._walk.reached = 0
            return Status.NOT_FINITE
        walk, problem = self._walk, self.problem
        found = self.system.walk(walk)
        problem.system.evaluations += walk.tries
        self.steps += walk.steps
        self.rejected += walk.tries - walk.steps
        if walk.steps:
            self.before, self.t, self.step_size = walk.before, walk.time, walk.length
        if found:
            return _FAILED[found]
        if self.steps >= _LOOK and self.t - problem.t < self.steps * problem.shortest:
            return Status.STIFF
        return Status.OK

    def series(self) -> tuple[float, int, int]:
        return self.before, self.order, self._walk.q

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return self.system.values(self.order, times - self.before, self._walk.q)
