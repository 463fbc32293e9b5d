"""DOP853: an explicit Runge–Kutta method of order 8 with dense output of order 7, for problems that are not stiff.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 (step size), II.5 (method). Where the
equations are compiled and nobody looks at the steps in Python, they are made in C by the same rules (`walk`).
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.dop853.dense_output import DenseOutput, dense_terms, evaluate_dense, roughness
from lmoc.numerics.dop853.rules import RULES
from lmoc.numerics.problem.base import Integration, Pieces, Problem, Properties
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.stepper import Stepper

PROPERTIES = Properties(
    "dop853", "Runge–Kutta", "explicit Runge–Kutta", "8(5,3)", "7", "own",
    good_for="everything, until it detects stiffness",
)  # fmt: skip

_LONG = 500  # components from which output is computed step by step: gathering costs memory and saves nothing
_SHORTEST = 8e-16  # share of the time, up to which there is no step
_OK = Status.OK  # attributes of an enumeration are slow to look up
_KEPT = (  # between steps, the same in C as here
    "t", "before", "step_size", "length", "error", "stiffness", "grow", "stiff_count", "calm_count", "careful",
    "cuts", "cuts_since", "pending", "staged", "lost",
)  # fmt: skip
WALKED = {0: _OK, 1: Status.COLLAPSED, 2: Status.NOT_FINITE, 3: Status.DOUBTFUL, 4: Status.STIFF}  # what C returns


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
        self.stiff_count = self.calm_count = self.careful = 0
        self.cuts, self.cuts_since = 0, problem.t
        self.length = self.error = self.stiffness = 0.0  # of the last step
        self.t = self.before = problem.t
        self._start(problem.x, None if math.isinf(problem.first_step) else problem.first_step)

    def _start(self, x: np.ndarray, step_size: float | None = None) -> None:
        """Stand at a state without a step behind."""
        problem, stepper = self.problem, self.stepper
        self.pending = False  # whether the step in the stepper has been accepted
        self.tried = False  # whether it has been tried in C and is to be judged here
        self.staged = False  # whether all its stages are there
        self.grow, self.lost = RULES.grow, False
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

    def begin_piece(self, problem: Problem) -> bool:
        self.problem, self.end, self.max_step = problem, problem.end, problem.max_step
        self.steps = self.rejected = 0
        self.t = self.before = self.cuts_since = problem.t
        self.stiff_count = self.calm_count = self.careful = self.cuts = 0
        self.length = self.error = self.stiffness = 0.0
        self._start(problem.x)
        return True

    def restart(self) -> None:
        """Go on from the same state with an input that has another value."""
        self.jump(self.x)

    def reach(self, end: float, most: int) -> Status:
        """Make up to so many steps towards a time, the last one exactly to it."""
        self.end, status = end, _OK
        while self.t < end and most > 0 and status is _OK:
            status, most = self.step(), most - 1
        return status

    def step(self) -> Status:
        if self.tried:
            self.tried = False
            return self._accept()
        stepper = self.stepper
        if self.pending:
            stepper.accept()
            self.pending = False
        if not self.finite:
            return Status.NOT_FINITE
        t, end, h = self.t, self.end, min(self.step_size, self.max_step)
        if self.cuts >= RULES.cuts and not self._gets_on():
            return Status.NOT_FINITE
        while True:
            t_new = t + h
            if t + 1.001 * h >= end:  # the end is reached exactly
                t_new, h = end, end - t
            if not h > _SHORTEST * abs(t_new) or h < RULES.least:  # so with a step that is no number
                self.step_size = h
                return Status.NOT_FINITE if self.lost else Status.COLLAPSED
            self.length = h
            self.error, self.stiffness = error, stiffness = stepper.attempt(t, h)
            self.staged = False
            if error < 1.0:
                self.lost = False
                if stiffness >= RULES.rough_from and self.wanted < t_new and self._is_rough():
                    self.rejected += 1
                    self.careful = RULES.careful_steps
                    h *= RULES.careful / stiffness
                    continue
                return self._accept()
            self.rejected += 1
            self.problem.system.go_back()
            self.lost = not math.isfinite(error)
            self.cuts += self.lost
            h *= RULES.retry if self.lost else max(RULES.shrink, RULES.safety * error**-0.125)
            self.grow = 1.0

    def _gets_on(self) -> bool:
        """Return whether the latest steps get on though the values around are not finite.

        They do not where a state is at the edge of what the equations have values for: finite are only steps that are
        too short to move it by a digit.
        """
        advance, needed = self.t - self.cuts_since, self.cuts * RULES.pace * (self.end - self.t)
        self.cuts, self.cuts_since = 0, self.t
        return advance >= needed

    def _is_rough(self) -> bool:
        """Return whether the dense output of the step just tried is much less accurate than the step itself.

        So it may be where stability limits the step and not accuracy: the stages then swing about the solution.
        """
        stages = self._stages(self.t)
        return roughness(self.problem, self.stepper.x, self.length, stages) > RULES.rough

    def _accept(self) -> Status:
        """Accept the step just tried, and choose the length of the next."""
        h, error, stiffness = self.length, self.error, self.stiffness
        self.steps += 1
        self.careful -= self.careful > 0
        t_new = self.end if self.t + 1.001 * h >= self.end else self.t + h
        self.before, self.t, self.pending = self.t, t_new, True
        factor = min(self.grow, max(RULES.shrink, RULES.safety * error**-0.125)) if error > 0 else self.grow
        held = self.careful > 0 and factor * stiffness > RULES.careful
        self.grow = RULES.grow
        limited = held or stiffness > RULES.stiff_limit
        if (limited or self.stiff_count) and self._has_become_stiff(limited, h):
            self.step_size = h
            return Status.STIFF
        self.step_size = h * (RULES.careful / stiffness if held else factor)
        return _OK

    def _has_become_stiff(self, limited: bool, h: float) -> bool:
        """Return whether too many steps lie ahead and the last ones were limited by stability."""
        if limited:
            self.stiff_count, self.calm_count = self.stiff_count + 1, 0
            return self.stiff_count >= RULES.stiff_steps and (self.end - self.t) / h > self.problem.patience
        self.calm_count += 1
        if self.calm_count >= RULES.calm_steps:
            self.stiff_count = 0
        return False

    # ------------------------------------------------------------------ many steps in C

    @property
    def walker(self) -> Dop853 | None:
        return None if self.stepper.walker is None else self

    def walk(self, times: np.ndarray, room: int, most: int, hook: int | None) -> tuple[Status, int]:
        if not self.finite:
            return Status.NOT_FINITE, 0
        kept, given = self.state(most, hook)
        out = np.empty((min(room, len(times)), len(self.stepper.x)))
        made = self.stepper.walker.walk(kept, given, times, out)
        for name, value in kept.items():
            setattr(self, name, value)
        self.steps += made.steps
        self.rejected += made.rejected
        self._collected += self.output.values(), out[: made.reached]
        status = WALKED[made.found]
        self.tried = status is Status.DOUBTFUL
        return status, made.reached

    def pass_kinks(self, pieces: Pieces, room: int, most: tuple[int, int, int]) -> tuple[int, int, bool]:
        stepper = self.stepper
        if self.pending:
            stepper.accept()
            self.pending = False
        out = np.empty((min(room, len(pieces.times)), len(stepper.x)))
        own = stepper.walker.pass_kinks(*self.state(most[0]), pieces.bounds, pieces.times, out, most)
        self.t, self.before = own.time, own.before
        self.steps += own.steps
        self.rejected += own.rejected
        self._collected += self.output.values(), out[: own.reached]
        return own.passed, own.reached, bool(own.stuck)

    def state(self, most: int, hook: int | None = None) -> tuple[dict[str, float], dict[str, float | None]]:
        """Return what is kept between steps, and what C needs to know beside it to make up to `most` of them."""
        given = {"end": self.end, "max_step": self.max_step, "patience": self.problem.patience,
                 "most": most, "hook": hook}  # fmt: skip
        return {name: getattr(self, name) for name in _KEPT}, given

    # ------------------------------------------------------------------ values within the last step

    def _stages(self, begin: float) -> np.ndarray:
        """Return all stages of the step in the stepper, (16, n)."""
        stages = self.stepper.k if self.staged else self.stepper.stages(begin, self.length)
        self.staged = True
        return stages

    @np.errstate(all="ignore")
    def interpolate(self, times: np.ndarray) -> np.ndarray:
        stepper, h = self.stepper, self.length
        terms = dense_terms(np.array([h]), stepper.x[None], stepper.x_new[None], self._stages(self.before)[None])
        return evaluate_dense((times - self.before) / h, stepper.x[None], terms)

    def collect(self, times: np.ndarray) -> None:
        if len(self.stepper.x) > _LONG:
            super().collect(times)
            return
        stages = self._stages(self.before)
        if self.output.add(self.before, self.length, self.stepper.x, self.stepper.x_new, stages, times):
            self._collected.append(self.output.values())

    def collected(self) -> np.ndarray:
        self._collected.append(self.output.values())
        return super().collected()


@np.errstate(all="ignore")
def initial_step(problem: Problem, t: float, x: np.ndarray, f: np.ndarray) -> float:
    """Return a first step size (Hairer, Nørsett, Wanner I, II.4)."""
    system, n, span, engine = problem.system, len(x), problem.end - t, library()
    atol, x, trial = np.ascontiguousarray(problem.atol), np.ascontiguousarray(x), np.empty(n)
    own = atol.ctypes.data, x.ctypes.data, f.ctypes.data
    least = max(
        RULES.least, 2 * _SHORTEST * abs(t)
    )  # states next to zero that begin to move fast ask for none by rounding
    h = engine.lmoc_first_trial(n, span, problem.max_step, least, problem.rtol, *own)
    system.rhs(t + h, x + h * f, trial)
    return float(engine.lmoc_first_step(n, h, span, problem.rtol, *own, trial.ctypes.data))
