"""DOP853: an explicit Runge–Kutta method of order 8 with dense output of order 7, for problems that are not stiff.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 (step size), II.5 (method); the test for
stiffness is that of their code (volume II, IV.2).
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.evaluate.stepper import Stepper
from lmoc.numerics.integrate.base import Outcome, Problem, Properties, Watch
from lmoc.numerics.integrate.dense_output import DenseOutput, roughness
from lmoc.numerics.integrate.status import Status

PROPERTIES = Properties("dop853", "Runge–Kutta", stiff=False, order="8(5,3)", library="own")

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 8.0
_STIFF_LIMIT = 6.1  # |h·λ| at the edge of the stability region
_STIFF_STEPS = 15
_ROUGH = 5.5, 60.0  # |h·λ| and roughness, in tolerances, from which the dense output is not good enough
_CAREFUL = 4.5  # |h·λ| up to which it is, and which the steps keep to …
_CAREFUL_STEPS = 50  # … for so many steps after one was found too rough
_LEAST = 1e-300  # s, a step that can still be divided by
_LOOK = 128  # steps between two looks at the clock


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times."""
    run = _Run(problem)
    try:
        return run.go()
    except KeyboardInterrupt:
        return run.outcome(Status.INTERRUPTED)


class _Run:
    """The state of one integration."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.stepper: Stepper = problem.system.stepper()
        self.output = DenseOutput(problem)
        self.t, self.end = float(problem.times[0]), float(problem.times[-1])
        self.steps = self.rejected = 0
        self.stiff_count = self.calm_count = 0
        self.careful = 0
        self.watch = Watch(problem)

    def go(self) -> Outcome:
        problem, stepper, end = self.problem, self.stepper, self.end
        stepper.start(self.t, problem.x, problem.rtol, problem.atol)
        if not np.isfinite(stepper.f).all():
            return self.outcome(Status.NOT_FINITE)
        h = initial_step(problem, stepper.f, end - self.t)
        grow, lost = _GROW, False
        while self.t < end:
            tried = self.steps + self.rejected
            if tried >= problem.max_steps:
                return self.outcome(Status.TOO_MANY_STEPS)
            if tried % _LOOK == 0 and self.watch.expired(self.t):
                return self.outcome(Status.TOO_LONG)
            t_new, h = self.target(h)
            if h <= 8e-16 * abs(t_new) or h < _LEAST:
                return self.outcome(Status.NOT_FINITE if lost else Status.COLLAPSED)
            error, stiffness = stepper.attempt(self.t, h)
            lost = not math.isfinite(error)
            if error < 1.0:
                if self.output.next <= t_new and not self.show(t_new, h, stiffness):
                    self.rejected += 1
                    self.careful = _CAREFUL_STEPS
                    h *= _CAREFUL / stiffness
                    continue
                self.accept(t_new)
                factor = min(grow, max(_SHRINK, _SAFETY * error**-0.125)) if error > 0 else grow
                held = self.careful > 0 and factor * stiffness > _CAREFUL
                if self.has_become_stiff(held or stiffness > _STIFF_LIMIT, h):
                    return self.outcome(Status.STIFF, step=h)
                h *= _CAREFUL / stiffness if held else factor
                grow = _GROW
            else:
                self.rejected += 1
                h *= 0.1 if lost else max(_SHRINK, _SAFETY * error**-0.125)
                grow = 1.0
        return self.outcome(Status.OK)

    def target(self, h: float) -> tuple[float, float]:
        """Where a step of about h ends, and its length: it reaches the end exactly."""
        return (self.end, self.end - self.t) if self.t + 1.001 * h >= self.end else (self.t + h, h)

    def show(self, t_new: float, h: float, stiffness: float) -> bool:
        """Pass the step just tried on for output; False where its dense output is much less accurate than itself.

        So it may be where stability limits the step and not accuracy: the stages then swing about the solution.
        """
        problem, stepper = self.problem, self.stepper
        stages = stepper.stages(self.t, h)
        inside = self.output.next < t_new
        if inside and stiffness >= _ROUGH[0] and roughness(problem, stepper.x, h, stages) > _ROUGH[1]:
            return False
        self.output.add(self.t, t_new, h, stepper, stages)
        return True

    def accept(self, t_new: float) -> None:
        self.steps += 1
        self.careful = max(0, self.careful - 1)
        self.stepper.accept()
        self.t = t_new

    def has_become_stiff(self, limited: bool, h: float) -> bool:
        """Whether too many steps lie ahead and the last ones were limited by stability."""
        if limited:
            self.stiff_count, self.calm_count = self.stiff_count + 1, 0
            return self.stiff_count >= _STIFF_STEPS and (self.end - self.t) / h > self.problem.patience
        if self.stiff_count:
            self.calm_count += 1
            if self.calm_count >= 6:
                self.stiff_count = 0
        return False

    def outcome(self, status: Status, step: float = np.inf) -> Outcome:
        self.output.flush()
        counts = {"steps": self.steps, "rejected": self.rejected}
        return Outcome(self.t, self.stepper.x.copy(), self.output.reached, status, counts, step)


@np.errstate(all="ignore")
def initial_step(problem: Problem, f: np.ndarray, span: float) -> float:
    """A first step size (Hairer, Nørsett, Wanner I, II.4)."""
    system, x, t = problem.system, problem.x, float(problem.times[0])
    scale = problem.atol + problem.rtol * np.abs(x)

    def norm(v: np.ndarray) -> float:
        return math.sqrt(float(np.mean((v / scale) ** 2)))

    d0, d1 = norm(x), norm(f)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(max(h0, _LEAST), span)  # the slope may have no finite norm
    trial = np.empty_like(x)
    system.rhs(t + h0, x + h0 * f, trial)
    d2 = norm(trial - f) / h0
    if not math.isfinite(d2):
        return h0 * 1e-3
    steepest = max(d1, d2)
    h1 = max(1e-6, h0 * 1e-3) if steepest <= 1e-15 else (0.01 / steepest) ** (1 / 8)
    return min(100 * h0, h1, span)
