"""Radau IIA of order 5: implicit, one step, accurate where a stiff problem also oscillates.

The steps are made in C (`engine/c/radau.c`); here is what a run asks of them. Their error estimate is damped by
stiffness, so they may become so long that the polynomial of collocation is far off between their ends although it is
right at them. Output therefore takes another polynomial, of degree 4, which also begins with the slope at which the
step before has ended; where the two differ by more than the tolerances the step is made again, shorter.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.engine.library import address
from lmoc.engine.radau import Functions, RatesInC
from lmoc.engine.radau import Radau as Engine
from lmoc.numerics.limits import FINEST_SMOOTH
from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System
from lmoc.numerics.steps.dop853 import initial_step
from lmoc.numerics.steps.resolvent import Resolvent
from lmoc.support.sizes import DENSE_IN_C

PROPERTIES = Properties(
    "radau", "Radau IIA", "collocation", "5", "4", "own",
    stability="L", implicit=True,
    good_for="stiff scenes whose fastest mode swings, and where there is no SUNDIALS",
)  # fmt: skip

_SHIFTS = (3.6378342527444957, 2.6810828736277523 - 3.0504301992474105j)  # as in C
_NODES = np.array([0.0, (4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])  # of collocation, and the beginning
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
        system = problem.system
        rtol = max(problem.rtol, FINEST_SMOOTH)
        self.engine = Engine(len(problem.x), _functions(system), _in_c(system), problem.atol, rtol)
        self.way = self.engine.way
        self.way.end, self.way.max_step = problem.end, problem.max_step
        self.t, self.x = problem.t, problem.x.copy()
        self.jump(self.x)
        self._first(problem.first_step)

    @np.errstate(all="ignore")  # values that are not finite are reported by the status
    def jump(self, x: np.ndarray) -> None:
        self.before, self.x = self.t, x
        self.coefficients: np.ndarray | None = None
        self.rough = math.inf  # of the last try of this step
        self.engine.jump(self.t, x)
        self.slope = self.engine.f.copy()

    def _first(self, step: float) -> None:
        if math.isinf(step):
            step = initial_step(self.problem, self.t, self.x, self.engine.f)
        self.step_size = self.way.step_size = step

    @np.errstate(all="ignore")
    def step(self) -> Status:
        way, system = self.way, self.problem.system
        while True:
            rejected, evaluations = way.rejected, way.evaluations
            found = self.engine.step()
            self.rejected += way.rejected - rejected
            if way.owner:  # else Python has counted
                system.evaluations += way.evaluations - evaluations
            if not found:
                finite = np.isfinite(self.engine.f).all() and math.isfinite(way.step_size)
                return Status.COLLAPSED if finite else Status.NOT_FINITE
            if self._accept():
                self.step_size = way.step_size
                return Status.OK

    def _accept(self) -> bool:
        """Take the step that C has made; False where it has to be made again, shorter."""
        way, engine = self.way, self.engine
        h, t_new = way.length, way.t
        coefficients = np.concatenate([engine.last[None], engine.dense])
        bend = h * self.slope - coefficients[1]
        inside = self.wanted < t_new
        rough = self._roughness(bend) if inside else 0.0
        longest = h * min(_LONGER, max(_SHORTER, _SAFETY * (_ROUGH / max(rough, 1e-300)) ** 0.25))
        if _ROUGH < rough < self.rough / 2:  # else a shorter step gains nothing: it is rounding, or a kink
            self.rough = rough
            self.rejected += 1
            engine.undo()
            way.step_size = way.max_step = longest
            return False
        self.steps += 1
        self.rough = math.inf
        self.before, self.t, self.x = self.t, t_new, engine.x.copy()
        self.coefficients, self.bend, self.slope = coefficients, bend, np.arange(4) @ coefficients / h
        way.max_step = min(longest if inside else _UNSEEN * way.max_step, self.problem.max_step)
        return True

    def _roughness(self, bend: np.ndarray) -> float:
        """Return the largest difference of the two polynomials within a step but for rounding, in tolerances."""
        allowed = self.problem.atol + self.problem.rtol * np.abs(self.x)
        noise = _NOISE * (np.abs(self.x) + abs(self.t) * np.abs(self.slope))
        return float(np.max(np.maximum(np.abs(bend) - noise, 0.0) / allowed * _LARGEST))

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return _values((times - self.before) / (self.t - self.before), self.coefficients, self.bend)

    def counts(self) -> dict[str, int]:
        return super().counts() | {"jacobians": self.way.jacobians}


def _bubble(theta: np.ndarray) -> np.ndarray:
    """The polynomial of degree 4 that is zero at the nodes and begins with the slope 1."""
    return np.prod(theta[:, None] - _NODES, axis=1) / np.prod(-_NODES[1:])


_LARGEST = float(np.abs(_bubble(np.linspace(0.0, 1.0, 1001))).max())


def _values(theta: np.ndarray, coefficients: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """States (k, n) at fractions theta (k,) of a step."""
    return np.vander(theta, 4, increasing=True) @ coefficients + np.outer(_bubble(theta), bend)


def _in_c(system: System) -> RatesInC | None:
    own = system.in_c()
    if own is None:
        return None
    return RatesInC(own.call, address("lmoc_derivatives"), own.mark, address("lmoc_go_back"))


def _functions(system: System) -> Functions:
    """Return what C asks of a system; from some size on its matrices are LAPACK's or sparse ones."""
    if system.n <= DENSE_IN_C:

        def slopes(t: float, x: np.ndarray, out: np.ndarray) -> None:
            out[:] = system.jacobian(t, x)

        return Functions(system.rhs, system.mark, system.go_back, slopes, None, None)
    resolvent = Resolvent(system, _SHIFTS)

    def substitute(which: int, v: np.ndarray) -> None:
        if not which:
            v[:] = resolvent.solve(0, v)
            return
        found = resolvent.solve(1, v[0] + 1j * v[1])
        v[0], v[1] = found.real, found.imag

    def take(t: float, x: np.ndarray, _: np.ndarray) -> None:
        resolvent.at(t, x)

    return Functions(system.rhs, system.mark, system.go_back, take, resolvent.factorize, substitute)
