"""Radau IIA of order 5 by scipy: implicit, one step, accurate where a stiff problem also oscillates.

Its error estimate is damped by stiffness, so steps may become so long that the polynomial of collocation is far off
between their ends although it is right at them. Output therefore takes another polynomial, of degree 4, which also
begins with the slope at which the step before has ended; where the two differ by more than the tolerances the step is
made again, shorter.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.numerics.integrate.base import Outcome, Problem, Properties, Watch
from lmoc.numerics.integrate.status import Status

PROPERTIES = Properties("radau", "Radau IIA", stiff=True, order="5", library="scipy")

_DENSE = 100  # states up to which the Jacobian is a dense matrix
_FINEST = 1e-13  # relative tolerance below which Newton's method within a step meets rounding
_NODES = np.array([0.0, (4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])  # of collocation, and the beginning
_FIT = np.linalg.inv(np.vander(_NODES, 4, increasing=True))  # from values there to coefficients
_ROUGH = 3.0  # tolerances between the two polynomials from which a step is made again
_SAFETY, _SHORTER, _LONGER = 0.8, 0.1, 5.0  # how the longest step follows from the last, since they differ as h⁴
_UNSEEN = 1.2  # by which it grows over steps without output


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8)."""
    if len(problem.times) == 1:
        return Outcome(float(problem.times[0]), problem.x, 1)
    with np.errstate(all="ignore"):  # what is not finite is told by the outcome
        return _Run(problem).go()


class _Run:
    """The state of one integration."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.rhs, self.jacobian = self.marked(_rhs(problem)), self.marked(_jacobian(problem))
        self.raised: ValueError | None = None  # by the system itself, as a function given for an input may
        self.t, self.x, self.reached = float(problem.times[0]), problem.x.copy(), 1
        self.slope = self.rhs(self.t, self.x)
        self.steps = self.rejected = self.jacobians = 0
        self.solver = self.begin(None, np.inf)

    def begin(self, first_step: float | None, longest: float):
        """scipy's solver from where the run stands."""
        from scipy.integrate import Radau

        problem = self.problem
        return Radau(
            self.rhs,
            self.t,
            self.x,
            float(problem.times[-1]),
            rtol=max(problem.rtol, _FINEST),
            atol=problem.atol,
            jac=self.jacobian,
            first_step=first_step,
            max_step=longest,
        )

    def go(self) -> Outcome:
        status = Status.OK
        try:
            watch = Watch(self.problem)
            while status is Status.OK and self.solver.status == "running":
                if self.steps + self.rejected >= self.problem.max_steps:
                    status = Status.TOO_MANY_STEPS
                else:
                    status = Status.TOO_LONG if watch.expired(self.t) else self.step()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        counts = {"steps": self.steps, "rejected": self.rejected, "jacobians": self.jacobians + self.solver.njev}
        return Outcome(self.t, self.x, self.reached, status, counts=counts)

    def marked(self, function: Callable) -> Callable:
        """A function whose errors can be told from those of scipy."""

        def call(t: float, x: np.ndarray):
            try:
                return function(t, x)
            except ValueError as error:
                self.raised = error
                raise

        return call

    def step(self) -> Status:
        """One step and the output within it; why there can be no more steps, where that is so."""
        try:
            self.solver.step()
        except ValueError as error:
            if error is self.raised:
                raise
            return Status.NOT_FINITE  # such a value has reached the factorization
        if self.solver.status == "failed":
            return Status.COLLAPSED
        h, t_new = self.solver.t - self.t, float(self.solver.t)
        coefficients = _FIT @ self.solver.dense_output()(self.t + _NODES * h).T
        bend = h * self.slope - coefficients[1]
        last = int(np.searchsorted(self.problem.times, t_new, "right"))
        inside = last > self.reached and self.problem.times[self.reached] < t_new
        rough = self.roughness(bend) if inside else 0.0
        longest = h * min(_LONGER, max(_SHORTER, _SAFETY * (_ROUGH / max(rough, 1e-300)) ** 0.25))
        if rough > _ROUGH:
            self.again(longest)
            return Status.OK
        self.steps += 1
        if last > self.reached:
            theta = (self.problem.times[self.reached : last] - self.t) / h
            self.problem.sink(self.reached, _values(theta, coefficients, bend))
            self.reached = last
        self.t, self.x, self.slope = t_new, self.solver.y, np.arange(4) @ coefficients / h
        self.solver.max_step = longest if inside else _UNSEEN * self.solver.max_step
        return Status.OK

    def roughness(self, bend: np.ndarray) -> float:
        """The largest difference of the two polynomials within a step, in tolerances."""
        allowed = self.problem.atol + self.problem.rtol * np.abs(self.x)
        return float(np.max(np.abs(bend) / allowed * _LARGEST))

    def again(self, h: float) -> None:
        """Give up the step just made, for steps that are no longer than h."""
        self.rejected += 1
        self.jacobians += self.solver.njev
        self.solver = self.begin(h, h)


def _bubble(theta: np.ndarray) -> np.ndarray:
    """The polynomial of degree 4 that is zero at the nodes and begins with the slope 1."""
    return np.prod(theta[:, None] - _NODES, axis=1) / np.prod(-_NODES[1:])


_LARGEST = float(np.abs(_bubble(np.linspace(0.0, 1.0, 1001))).max())


def _values(theta: np.ndarray, coefficients: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """States (k, n) at fractions theta (k,) of a step."""
    return np.vander(theta, 4, increasing=True) @ coefficients + np.outer(_bubble(theta), bend)


def _rhs(problem: Problem) -> Callable:
    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(len(x))
        problem.system.rhs(t, x, out)
        return out

    return rhs


def _jacobian(problem: Problem) -> Callable:
    system = problem.system
    if system.n <= _DENSE:
        return system.jacobian
    from scipy.sparse import csc_matrix

    indptr, indices = system.pattern()

    def jacobian(t: float, x: np.ndarray):
        values = np.empty(len(indices))
        system.jacobian_values(t, x, values)
        return csc_matrix((values, indices, indptr), shape=(system.n, system.n))

    return jacobian
