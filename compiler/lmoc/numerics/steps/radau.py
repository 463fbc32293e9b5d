"""Radau IIA of order 5 by scipy: implicit, one step, accurate where a stiff problem also oscillates.

Its error estimate is damped by stiffness, so steps may become so long that the polynomial of collocation is far off
between their ends although it is right at them. Output therefore takes another polynomial, of degree 4, which also
begins with the slope at which the step before has ended; where the two differ by more than the tolerances the step is
made again, shorter.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lmoc.numerics.limits import FINEST_SMOOTH
from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.problem.status import Status
from lmoc.support.sizes import DENSE

PROPERTIES = Properties(
    "radau", "Radau IIA", "collocation", "5", "4", "scipy",
    stability="L", implicit=True,
    good_for="stiff scenes whose fastest mode swings, and where there is no SUNDIALS",
)  # fmt: skip

_NODES = np.array([0.0, (4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])  # of collocation, and the beginning
_FIT = np.linalg.inv(np.vander(_NODES, 4, increasing=True))  # from values there to coefficients
_NOISE = 20 * float(np.finfo(float).eps)  # rounding of states and times in a polynomial through the nodes
_ROUGH = 3.0  # tolerances between the two polynomials from which a step is made again
_SAFETY, _SHORTER, _LONGER = 0.8, 0.1, 5.0  # how the longest step follows from the last, since they differ as h⁴
_UNSEEN = 1.2  # by which it grows over steps without output


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem."""
    return Radau(problem)


class Radau(Integration):
    """The method at work (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8)."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.rhs, self.jacobian = self._marked(_rhs(problem)), self._marked(_jacobian(problem))
        self.raised: ValueError | None = None  # by the system itself, as a function given for an input may
        self.t, self.x = problem.t, problem.x.copy()
        self.jacobians = 0
        self.jump(self.x)

    def jump(self, x: np.ndarray) -> None:
        self.before, self.x = self.t, x
        self.coefficients: np.ndarray | None = None
        self.rough = math.inf  # of the last try of this step
        with np.errstate(all="ignore"):  # values that are not finite are reported by the status
            self.slope = self.rhs(self.t, x)
            self._begin(None, self.problem.max_step)

    def _begin(self, first_step: float | None, longest: float) -> None:
        """Have scipy's solver stand where the run does."""
        from scipy.integrate import Radau as Solver

        problem = self.problem
        self.solver = Solver(
            self.rhs,
            self.t,
            self.x,
            problem.end,
            rtol=max(problem.rtol, FINEST_SMOOTH),
            atol=problem.atol,
            jac=self.jacobian,
            first_step=first_step,
            max_step=longest,
        )

    def _marked(self, function: Callable) -> Callable:
        """Return a function whose errors can be told from those of scipy."""

        def call(t: float, x: np.ndarray):
            try:
                return function(t, x)
            except ValueError as error:
                self.raised = error
                raise

        return call

    @np.errstate(all="ignore")
    def step(self) -> Status:
        while True:
            try:
                self.solver.step()
            except ValueError as error:
                if error is self.raised:
                    raise
                return Status.NOT_FINITE  # such a value has reached the factorization
            if self.solver.status == "failed":
                return Status.COLLAPSED
            if self._accept():
                return Status.OK

    def _accept(self) -> bool:
        """Take the step that scipy has made; False where it has to be made again, shorter."""
        h, t_new = self.solver.t - self.t, float(self.solver.t)
        coefficients = _FIT @ self.solver.dense_output()(self.t + _NODES * h).T
        bend = h * self.slope - coefficients[1]
        inside = self.wanted < t_new
        rough = self._roughness(bend) if inside else 0.0
        longest = h * min(_LONGER, max(_SHORTER, _SAFETY * (_ROUGH / max(rough, 1e-300)) ** 0.25))
        if _ROUGH < rough < self.rough / 2:  # else a shorter step gains nothing: it is rounding, or a kink
            self.rough = rough
            self.rejected += 1
            self.jacobians += self.solver.njev
            self._begin(longest, longest)
            return False
        self.steps += 1
        self.rough = math.inf
        self.before, self.t, self.x = self.t, t_new, self.solver.y
        self.coefficients, self.bend, self.slope = coefficients, bend, np.arange(4) @ coefficients / h
        self.solver.max_step = min(longest if inside else _UNSEEN * self.solver.max_step, self.problem.max_step)
        return True

    def _roughness(self, bend: np.ndarray) -> float:
        """Return the largest difference of the two polynomials within a step but for rounding, in tolerances."""
        allowed = self.problem.atol + self.problem.rtol * np.abs(self.x)
        noise = _NOISE * (np.abs(self.x) + abs(self.t) * np.abs(self.slope))
        return float(np.max(np.maximum(np.abs(bend) - noise, 0.0) / allowed * _LARGEST))

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return _values((times - self.before) / (self.t - self.before), self.coefficients, self.bend)

    def counts(self) -> dict[str, int]:
        return super().counts() | {"jacobians": self.jacobians + self.solver.njev}


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
    if system.n <= DENSE:
        return system.jacobian
    from scipy.sparse import csc_matrix

    indptr, indices = system.pattern()

    def jacobian(t: float, x: np.ndarray):
        values = np.empty(len(indices))
        system.jacobian_values(t, x, values)
        return csc_matrix((values, indices, indptr), shape=(system.n, system.n))

    return jacobian
