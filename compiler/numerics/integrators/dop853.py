"""DOP853: an explicit Runge–Kutta method of order 8 with dense output of order 7, for problems that are not stiff.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 (step size), II.5 (method), II.6 (dense
output); the test for stiffness is that of their code (volume II, IV.2).
"""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from lmoc.numerics.integrators.base import (
    COLLAPSED,
    NOT_FINITE,
    TOO_LONG,
    TOO_MANY,
    Outcome,
    Problem,
    Properties,
    Watch,
)
from lmoc.numerics.integrators.stepper import Stepper, make_stepper

PROPERTIES = Properties("dop853", "Runge–Kutta", stiff=False, order="8(5,3)", jacobian=False, library="own")

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 8.0
_STIFF_LIMIT = 6.1  # |h·λ| at the edge of the stability region
_STIFF_STEPS = 15
_LAST_TERM = (4 / 7) ** 4 * (3 / 7) ** 3  # the most that the last term of the dense output is weighted with
_ROUGH = 5.5, 60.0  # |h·λ| and size of that term, in tolerances, from which the dense output is not good enough
_LANDING = 30  # steps that end on output times after an interpolation was found too rough
_LOOK = 128  # steps between two looks at the clock
_BATCH = 200_000  # numbers of dense output gathered before they are evaluated


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times."""
    return _Run(problem).go()


class _Run:
    """The state of one integration."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.stepper: Stepper = make_stepper(problem.system)
        self.times = problem.times.tolist()
        self.t = self.times[0]
        self.reached = 1
        self.steps = self.rejected = 0
        self.stiff_count = self.calm_count = 0
        self.landing = 0
        self.dense: list[tuple] = []
        self.watch = Watch(problem)

    def go(self) -> Outcome:
        problem, stepper, end = self.problem, self.stepper, self.times[-1]
        stepper.start(self.t, problem.x, problem.rtol, problem.atol, problem.tested)
        if not np.isfinite(stepper.f).all():
            return self.outcome(NOT_FINITE)
        h = initial_step(problem, stepper.f, end - self.t)
        grow, lost = _GROW, False
        while self.t < end:
            if self.steps + self.rejected >= problem.max_steps:
                return self.outcome(TOO_MANY)
            if (self.steps + self.rejected) % _LOOK == 0 and self.watch.expired(self.t):
                return self.outcome(TOO_LONG)
            t_new = self.t + h
            if self.landing and t_new + 1e-3 * h >= self.times[self.reached]:
                t_new, h = self.times[self.reached], self.times[self.reached] - self.t
            if t_new + 1e-3 * h >= end:
                t_new, h = end, end - self.t
            if h <= 8e-16 * abs(t_new) or h < 1e-300:
                return self.outcome(NOT_FINITE if lost else COLLAPSED)
            error, stiffness = stepper.attempt(self.t, h)
            lost = not math.isfinite(error)
            if error < 1.0:
                terms = self.interpolation(t_new, h)
                if terms is not None and self.is_rough(t_new, terms, stiffness):
                    self.rejected += 1
                    self.landing, h = _LANDING, self.times[self.reached] - self.t
                    continue
                if self.accept(t_new, h, stiffness, terms):
                    return self.outcome("", stiff=True, step=h)
                h *= min(grow, max(_SHRINK, _SAFETY * error**-0.125)) if error > 0 else grow
                grow = _GROW
            else:
                self.rejected += 1
                h *= 0.1 if lost else max(_SHRINK, _SAFETY * error**-0.125)
                grow = 1.0
        return self.outcome("")

    def interpolation(self, t_new: float, h: float) -> np.ndarray | None:
        """Terms of the dense output of the step just tried, where output times lie in it."""
        inside = self.reached < len(self.times) and self.times[self.reached] <= t_new
        return self.stepper.dense(self.t, h) if inside else None

    def is_rough(self, t_new: float, terms: np.ndarray, stiffness: float) -> bool:
        """Whether the dense output is much less accurate than the step, and an output time lies inside.

        So it may be where stability limits the step and not accuracy: the stages then swing about the solution. The
        last term of the interpolation stands for those that it leaves out.
        """
        if stiffness < _ROUGH[0] or self.times[self.reached] >= t_new:
            return False
        problem, stepper = self.problem, self.stepper
        scale = problem.atol + problem.rtol * np.abs(stepper.x)
        error = _LAST_TERM * np.abs(terms[6]) / scale
        return math.sqrt(float((error[problem.tested] ** 2).mean())) > _ROUGH[1]

    def accept(self, t_new: float, h: float, stiffness: float, terms: np.ndarray | None) -> bool:
        """Take the step; True where the problem turns out to be too stiff to go on."""
        self.steps += 1
        self.landing = max(0, self.landing - 1)
        if terms is not None:
            last = bisect_right(self.times, t_new, self.reached)
            self.dense.append((self.reached, last, self.t, h, self.stepper.x.copy(), terms))
            self.reached = last
            if len(self.dense) * 8 * len(self.stepper.x) > _BATCH:
                self.flush()
        self.stepper.accept()
        self.t = t_new
        if stiffness > _STIFF_LIMIT:
            self.stiff_count, self.calm_count = self.stiff_count + 1, 0
            if self.stiff_count >= _STIFF_STEPS:
                return (self.times[-1] - self.t) / h > self.problem.patience
        elif self.stiff_count:
            self.calm_count += 1
            if self.calm_count >= 6:
                self.stiff_count = 0
        return False

    def flush(self) -> None:
        """Evaluate the dense output gathered so far and hand it on."""
        if not self.dense:
            return
        first, counts = self.dense[0][0], [b - a for a, b, *_ in self.dense]
        owner = np.repeat(np.arange(len(counts)), counts)
        begin, step = np.array([d[2] for d in self.dense]), np.array([d[3] for d in self.dense])
        theta = (self.problem.times[first : first + len(owner)] - begin[owner]) / step[owner]
        x = np.array([d[4] for d in self.dense])
        terms = np.array([d[5] for d in self.dense])
        largest = max(1, 4_000_000 // (8 * x.shape[1]))
        for a in range(0, len(owner), largest):
            own = owner[a : a + largest]
            self.problem.sink(first + a, evaluate_dense(theta[a : a + largest], x[own], terms[own]))
        self.dense = []

    def outcome(self, failure: str, stiff: bool = False, step: float = np.inf) -> Outcome:
        self.flush()
        counts = {"steps": self.steps, "rejected": self.rejected}
        return Outcome(self.t, self.stepper.x.copy(), self.reached, failure, stiff, counts, step)


def evaluate_dense(theta: np.ndarray, x: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Dense output at fractions theta (k,) of steps that begin at x (k, n); terms (k, 7, n)."""
    theta = theta[:, None]
    y = np.zeros_like(x)
    for i in range(7):
        y += terms[:, 6 - i]
        y *= theta if i % 2 == 0 else 1.0 - theta
    return x + y


def initial_step(problem: Problem, f: np.ndarray, span: float) -> float:
    """A first step size (Hairer, Nørsett, Wanner I, II.4)."""
    system, x, t = problem.system, problem.x, float(problem.times[0])
    scale = (problem.atol + problem.rtol * np.abs(x))[problem.tested]
    if not len(scale):
        return span

    def norm(v: np.ndarray) -> float:
        return math.sqrt(float(np.mean((v[problem.tested] / scale) ** 2)))

    d0, d1 = norm(x), norm(f)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(h0, span)
    trial = np.empty_like(x)
    system.rhs(t + h0, x + h0 * f, trial)
    d2 = norm(trial - f) / h0
    if not math.isfinite(d2):
        return h0 * 1e-3
    steepest = max(d1, d2)
    h1 = max(1e-6, h0 * 1e-3) if steepest <= 1e-15 else (0.01 / steepest) ** (1 / 8)
    return min(100 * h0, h1, span)
