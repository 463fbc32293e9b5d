"""Steps along Taylor series made in Python, where there is no C compiler: the same rules as in `native/c/taylor.c`."""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.evaluate.casadi_series import jets_function, nonlinear_unknowns
from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.integrate.base import Integration, Problem
from lmoc.numerics.integrate.status import Status
from lmoc.numerics.plan import Plan

_ALLOWED = 5.0  # tolerances that the slope may miss at the end of a step, as an error over the step
_LAST = 5  # coefficients that are looked at: some vanish by symmetry
_CAUTIOUS, _LOST, _MISSED = 0.9, 0.25, 0.6  # factors on the step: of its first length, and of those that fail


class Kept:
    """The functions of a plan by their order, which serve many runs."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._functions, self._refusal = plan, {}, ""

    def function(self, order: int):
        """Return `jets_function` of an order, made once.

        Raises
        ------
        Unsupported
            As it does, for all orders from then on.
        """
        if self._refusal:
            raise Unsupported(self._refusal)
        if order not in self._functions:
            try:
                self._functions[order] = jets_function(self._plan, order)
            except Unsupported as error:
                self._refusal = str(error)
                raise
        return self._functions[order]


class Jets:
    """The series of the states about a place, by a casadi function and the system's own solution of its blocks."""

    def __init__(self, problem: Problem, order: int) -> None:
        """
        Raises
        ------
        Unsupported
            There is no series of this scene.
        """
        self._system, plan = problem.system, problem.system.plan
        self._unknowns = nonlinear_unknowns(plan.program)
        if len(self._unknowns) and self._system.registers is None:
            raise Unsupported("the solutions of its blocks are not at hand")
        function = plan.once(Kept).function(order)
        self._t, self._x, self._slopes = np.zeros(1), np.zeros(len(problem.x)), np.zeros(len(problem.x))
        self._z, self._shape = np.zeros(len(self._unknowns)), (order + 1, len(problem.x))
        self._call = Buffered(function, (self._t, self._x, self._system.given[0][plan.parameters], self._z))

    def about(self, t: float, x: np.ndarray) -> np.ndarray | None:
        """Return the coefficients (order + 1, n) about a place; None where one of them is no number."""
        system = self._system
        if len(self._unknowns):
            system.rhs(t, x, self._slopes)
            self._z[:] = system.registers[self._unknowns]
        else:
            system.evaluations += 1
        self._t[0], self._x[:] = t, x
        self._call()
        found = self._call.results[0]
        return found.reshape(self._shape).copy() if np.isfinite(found).all() else None


class TaylorInPython(Integration):
    """The method at work: the series of the last step, and of the next."""

    evaluation = "casadi"
    looks = 4  # as in C (`native/c/taylor.c`)

    def __init__(self, problem: Problem, order: int) -> None:
        """
        Raises
        ------
        Unsupported
            There is no series of this scene.
        """
        super().__init__(problem)
        self.order, self.jets = order, Jets(problem, order)
        self.t, self.x = problem.t, np.array(problem.x, float)
        self.jump(problem.x)

    def jump(self, x: np.ndarray) -> None:
        self.x, self.before = np.array(x, float), self.t
        self.next = self.last = self.jets.about(self.t, self.x)

    def step(self) -> Status:
        with np.errstate(over="ignore", invalid="ignore"):  # of a step that is too long: it is rejected
            return self._step()

    def _step(self) -> Status:
        problem, series = self.problem, self.next
        if series is None:
            return Status.NOT_FINITE
        h = min(_CAUTIOUS * self._length(series), problem.max_step, problem.end - self.t)
        while True:
            reached = self.t + h
            if self.t + 1.001 * h >= problem.end:
                reached, h = problem.end, problem.end - self.t
            if h <= 8e-16 * abs(reached) or h < 1e-300:
                return Status.COLLAPSED
            x = _value(series, h)
            following = self.jets.about(reached, x)
            if following is not None and self._defect(series, h, following) <= _ALLOWED:
                break
            self.rejected += 1
            problem.system.go_back()
            h *= _LOST if following is None else _MISSED
            if following is None and h <= 1e-14 * abs(self.t):
                return Status.NOT_FINITE
        problem.system.mark()
        self.before, self.t, self.x, self.step_size = self.t, reached, x, h
        self.last, self.next = series, following
        self.steps += 1
        return Status.OK

    def _scale(self, *x: np.ndarray) -> np.ndarray:
        return self.problem.atol + self.problem.rtol * np.max(np.abs(x), axis=0)

    def _length(self, series: np.ndarray) -> float:
        """Return a step after which the last term is as large as the tolerances.

        Terms shrink by a factor an order: those before may be larger.
        """
        scale = self._scale(series[0])
        whole = max(1.0, float((np.abs(series[0]) / scale).max(initial=0.0)))
        sizes = (np.abs(series[-_LAST:]) / scale).max(axis=1, initial=0.0).tolist()
        lengths = [math.inf]
        for back, size in enumerate(reversed(sizes)):
            if size > 0.0:
                k = self.order - back
                lengths.append(math.exp(-(math.log(size) - back / self.order * math.log(whole)) / k))
        return min(lengths)

    def _defect(self, series: np.ndarray, h: float, following: np.ndarray) -> float:
        """Return how much the polynomial misses the differential equation at its end, as an error in tolerances."""
        slope = _value(series[1:] * np.arange(1.0, self.order + 1.0)[:, None], h)
        missed = np.abs(h * (slope - following[1])) / self._scale(series[0], following[0])
        return float(missed.max(initial=0.0))

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return _value(self.last, (times - self.before)[:, None])


def _value(series: np.ndarray, h):
    """Return a polynomial (by Horner's rule) at one distance (n,), or at several (k, 1) as (k, n)."""
    s = series[-1] * h + series[-2]
    for coefficient in series[-3::-1]:
        s *= h
        s += coefficient
    return s
