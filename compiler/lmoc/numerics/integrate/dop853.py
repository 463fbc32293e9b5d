"""DOP853: an explicit Runge–Kutta method of order 8 with dense output of order 7, for problems that are not stiff.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 (step size), II.5 (method); the test for
stiffness is that of their code (volume II, IV.2).
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.evaluate.stepper import Stepper
from lmoc.numerics.integrate.base import Integration, Problem, Properties
from lmoc.numerics.integrate.dense_output import DenseOutput, dense_terms, evaluate_dense, roughness
from lmoc.numerics.integrate.status import Status

PROPERTIES = Properties(
    "dop853", "Runge–Kutta", "explicit Runge–Kutta", "8(5,3)", "7", "own",
    good_for="everything, until it detects stiffness",
)  # fmt: skip

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 8.0
_STIFF_LIMIT = 6.1  # |h·λ| at the edge of the stability region
_STIFF_STEPS = 15
_ROUGH = 5.5, 60.0  # |h·λ| and roughness, in tolerances, from which the dense output is not good enough
_CAREFUL = 4.5  # |h·λ| up to which it is, and which the steps keep to …
_CAREFUL_STEPS = 50  # … for so many steps after one was found too rough
_LONG = 500  # components from which output is computed step by step: gathering costs memory and saves nothing
_CUTS = 500  # steps cut short for values that are not finite, after which they must have got on …
_PACE = 1e-9  # … by this part of what lies ahead each
_LEAST = 1e-300  # s, a step that can still be divided by
_OK = Status.OK  # attributes of an enumeration are slow to look up


def begin(problem: Problem) -> Dop853:
    """Return the method at the beginning of a problem."""
    return Dop853(problem)


class Dop853(Integration):
    """The method at work. The step made last stays as it is in the stepper until the next one begins."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.stepper: Stepper = problem.system.stepper()
        self.end, self.max_step = problem.end, problem.max_step
        self.output = DenseOutput(len(problem.x), len(problem.times))
        self.stiff_count = self.calm_count = 0
        self.careful = 0
        self.cuts, self.cuts_since = 0, problem.t
        self.t = self.before = problem.t
        self._start(problem.x, None if math.isinf(problem.first_step) else problem.first_step)

    def _start(self, x: np.ndarray, step_size: float | None = None) -> None:
        """Stand at a state without a step behind."""
        problem, stepper = self.problem, self.stepper
        self.pending = False  # whether the step in the stepper has been accepted
        self.stages: np.ndarray | None = None  # of that step, once they are needed
        self.grow, self.lost = _GROW, False
        stepper.start(self.t, x, problem.rtol, problem.atol)
        self.finite = bool(np.isfinite(stepper.f).all())
        if step_size is None:
            step_size = initial_step(problem, self.t, x, stepper.f) if self.finite else 0.0
        self.step_size = step_size

    @property
    def x(self) -> np.ndarray:
        return self.stepper.x_new if self.pending else self.stepper.x

    def jump(self, x: np.ndarray) -> None:
        self.before = self.t
        self._start(x.copy(), self.step_size)

    def step(self) -> Status:
        stepper = self.stepper
        if self.pending:
            stepper.accept()
            self.pending = False
        if not self.finite:
            return Status.NOT_FINITE
        t, end, h = self.t, self.end, min(self.step_size, self.max_step)
        if self.cuts >= _CUTS and not self._gets_on():
            return Status.NOT_FINITE
        while True:
            t_new = t + h
            if t + 1.001 * h >= end:  # the end is reached exactly
                t_new, h = end, end - t
            if not h > 8e-16 * abs(t_new) or h < _LEAST:  # so with a step that is no number
                self.step_size = h
                return Status.NOT_FINITE if self.lost else Status.COLLAPSED
            error, stiffness = stepper.attempt(t, h)
            self.stages = None
            if error < 1.0:
                self.lost = False
                if stiffness >= _ROUGH[0] and self.wanted < t_new and self._is_rough(t, h):
                    self.rejected += 1
                    self.careful = _CAREFUL_STEPS
                    h *= _CAREFUL / stiffness
                    continue
                return self._accept(t_new, h, error, stiffness)
            self.rejected += 1
            self.lost = not math.isfinite(error)
            self.cuts += self.lost
            h *= 0.1 if self.lost else max(_SHRINK, _SAFETY * error**-0.125)
            self.grow = 1.0

    def _gets_on(self) -> bool:
        """Return whether the latest steps get on though the values around are not finite.

        They do not where a state is at the edge of what the equations have values for: finite are only steps that are
        too short to move it by a digit.
        """
        advance, needed = self.t - self.cuts_since, self.cuts * _PACE * (self.end - self.t)
        self.cuts, self.cuts_since = 0, self.t
        return advance >= needed

    def _is_rough(self, t: float, h: float) -> bool:
        """Return whether the dense output of the step just tried is much less accurate than the step itself.

        So it may be where stability limits the step and not accuracy: the stages then swing about the solution.
        """
        self.stages = self.stepper.stages(t, h)
        return roughness(self.problem, self.stepper.x, h, self.stages) > _ROUGH[1]

    def _accept(self, t_new: float, h: float, error: float, stiffness: float) -> Status:
        self.steps += 1
        self.careful -= self.careful > 0
        self.before, self.t, self.length, self.pending = self.t, t_new, h, True
        factor = min(self.grow, max(_SHRINK, _SAFETY * error**-0.125)) if error > 0 else self.grow
        held = self.careful > 0 and factor * stiffness > _CAREFUL
        self.grow = _GROW
        limited = held or stiffness > _STIFF_LIMIT
        if (limited or self.stiff_count) and self._has_become_stiff(limited, h):
            self.step_size = h
            return Status.STIFF
        self.step_size = h * (_CAREFUL / stiffness if held else factor)
        return _OK

    def _has_become_stiff(self, limited: bool, h: float) -> bool:
        """Return whether too many steps lie ahead and the last ones were limited by stability."""
        if limited:
            self.stiff_count, self.calm_count = self.stiff_count + 1, 0
            return self.stiff_count >= _STIFF_STEPS and (self.end - self.t) / h > self.problem.patience
        self.calm_count += 1
        if self.calm_count >= 6:
            self.stiff_count = 0
        return False

    # ------------------------------------------------------------------ values within the last step

    def _own_stages(self) -> np.ndarray:
        if self.stages is None:
            self.stages = self.stepper.stages(self.before, self.length)
        return self.stages

    @np.errstate(all="ignore")
    def interpolate(self, times: np.ndarray) -> np.ndarray:
        stepper, h = self.stepper, self.length
        terms = dense_terms(np.array([h]), stepper.x[None], stepper.x_new[None], self._own_stages()[None])
        return evaluate_dense((times - self.before) / h, stepper.x[None], terms)

    def collect(self, times: np.ndarray) -> None:
        if len(self.stepper.x) > _LONG:
            super().collect(times)
            return
        stages = self._own_stages() if self.stages is None else self.stages
        if self.output.add(self.before, self.length, self.stepper.x, self.stepper.x_new, stages, times):
            self._collected.append(self.output.values())

    def collected(self) -> np.ndarray:
        self._collected.append(self.output.values())
        return super().collected()


@np.errstate(all="ignore")
def initial_step(problem: Problem, t: float, x: np.ndarray, f: np.ndarray) -> float:
    """Return a first step size (Hairer, Nørsett, Wanner I, II.4)."""
    system, span = problem.system, problem.end - t
    scale = problem.atol + problem.rtol * np.abs(x)

    def norm(v: np.ndarray) -> float:
        return math.sqrt(float(np.mean((v / scale) ** 2)))

    d0, d1 = norm(x), norm(f)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    h0 = min(max(h0, _LEAST), span, problem.max_step)  # the slope may have no finite norm
    trial = np.empty_like(x)
    system.rhs(t + h0, x + h0 * f, trial)
    d2 = norm(trial - f) / h0
    if not math.isfinite(d2):
        return h0 * 1e-3
    steepest = max(d1, d2)
    h1 = max(1e-6, h0 * 1e-3) if steepest <= 1e-15 else (0.01 / steepest) ** (1 / 8)
    return min(100 * h0, h1, span)
