"""The options of a run, and their defaults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.ir.flat import Experiment
from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.numerics.limits import FINEST
from lmoc.numerics.options.formulations import GAIN, TABLE, Requested, requested
from lmoc.support.records import dataclass

ADAPTIVE = ("auto", "dop853", "taylor", "cvode", "adams", "ida", "cvodes", "idas", "radau", "gauss")
MOREAU = "moreau"  # time stepping of scenes with laws
WHOLE_RUN = ("collocation", "collocation-radau")  # one call, in which nobody looks at the steps
# all steps have the same length, the option `step`
FIXED_STEP = ("rk4", "midpoint", "verlet", "generalized-alpha", "collocation", "collocation-radau", MOREAU)
EITHER = ("gauss",)  # takes the length of its steps, or chooses it
SOLVERS = ADAPTIVE + FIXED_STEP
# names of methods elsewhere, and what does the same here
ALSO_KNOWN_AS = {
    "dop853": "ode45 ode23 ode78 ode89 rk45 rk23 rkf45 dopri5 dopri tsit5 vern7 rungekutta euler",
    "adams": "ode113 vode abm",
    "cvode": "ode15s bdf cvodes_bdf lsode gear",
    "ida": "dassl daspk dae15i ode15i",
    "radau": "radauiia radau5 radauii ode23s ode23t ode23tb esdirk rodas",
    "auto": "lsoda automatic default",
    "verlet": "leapfrog stormer stormerverlet velocityverlet symplectic semiimpliciteuler",
    "midpoint": "implicitmidpoint trapezoidal cranknicolson",
    "generalized-alpha": "alpha galpha genalpha generalizedalpha hht hhtalpha newmark newmarkbeta",
    "gauss": "gausslegendre irk",
    "moreau": "moreaujean timestepping nonsmooth",
}
FORMULATIONS = tuple(TABLE)
_STEPS = 1000  # of a run with steps of equal length, where nobody says
MOST_POINTS = 50_000_000  # output times


def solver_hint(name: str) -> str:
    """A hint for a solver that does not exist: what corresponds to one of another tool, else the nearest name."""
    plain = "".join(sign for sign in name.lower() if sign.isalnum() or sign == "_")
    own = next((own for own, others in ALSO_KNOWN_AS.items() if plain in others.split()), None)
    return f"'{own}' is the method of that kind here" if own else nearest(name, SOLVERS)


def checked_formulation(text: str, solver: str) -> Requested:
    """Return the formulation of a name. Raises as `RunOptions.requested`."""
    found = requested(text)
    if found is None:
        name = text.partition(":")[0]
        gain = f"a gain is a positive number in 1/s, as in baumgarte:{GAIN:g}"
        hint = gain if name == "baumgarte" else nearest(name, TABLE)
        known = ", ".join(TABLE)
        raise ModelError([Diagnostic("E0626", f"there is no formulation '{text}'", expected=known, hint=hint)])
    allowed = found.form.solvers
    if not found.form.goes_with(solver) and solver in SOLVERS:
        message = f"formulation '{text}' cannot be used with solver '{solver}'"
        others = [name for name, form in TABLE.items() if form.goes_with(solver)]
        hint = f"formulations that go with {solver}: {', '.join(others)}"
        raise ModelError([Diagnostic("E0626", message, expected=", ".join(allowed), hint=hint)])
    return found


@dataclass(frozen=True, eq=False)
class TimeSpan:
    """Start and stop of a run, s, and its output times (k,), all within."""

    start: float
    end: float
    times: np.ndarray


@dataclass(frozen=True)
class RunOptions:
    """Options of one run; None takes the model's `experiment`, else the default.

    Attributes
    ----------
    start, …, step : the arguments of `lmoc.DAE.simulate` of these names
    max_steps : steps after which the run is given up
    max_seconds : of the processor in this thread, after which the run is given up; None for no limit
    """

    start: float | None = None
    stop: float | None = None
    points: int | None = None
    times: Sequence[float] | None = None
    rtol: float | None = None
    atol: float | None = None
    solver: str = "auto"
    formulation: str = "auto"
    energy: bool = True
    keep: Sequence[str] | None = None
    max_step: float | None = None
    step: float | None = None
    max_steps: int = 5_000_000
    max_seconds: float | None = None

    @property
    def requested(self) -> Requested:
        """The formulation.

        Raises
        ------
        ModelError
            E0626: there is none of that name, or the solver does not go with it.
        """
        return checked_formulation(str(self.formulation), self.solver)

    def span(self, experiment: Experiment, begin: float | None = None) -> TimeSpan:
        """Return where the run begins and ends, and its output times.

        Parameters
        ----------
        begin : where it begins if nobody says otherwise, in place of the experiment's start

        Raises
        ------
        ValueError
            Where times do not increase, or the stop lies before the start.
        """
        start = _finite("start", _first(self.start, begin, experiment.start, 0.0))
        if self.times is not None:
            times = np.array(self.times, float).reshape(-1)
            if not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                raise ValueError("the output times must be finite and increase")
            if times[0] < start and (self.start is not None or begin is not None):
                raise ValueError(f"the first output time {times[0]:g} s lies before the start time {start:g} s")
            return TimeSpan(min(start, float(times[0])), float(times[-1]), times)
        after = start + 10.0 if self.start is not None or begin is not None else 10.0
        stop = _finite("stop", _first(self.stop, experiment.stop if begin is None else None, after))
        if not stop > start:
            raise ValueError(f"the stop time {stop:g} s must lie after the start time {start:g} s")
        return TimeSpan(start, stop, self._grid(start, stop, experiment))

    def _grid(self, start: float, stop: float, experiment: Experiment) -> np.ndarray:
        if self.points is None and experiment.interval:
            return _spaced(start, stop, experiment.interval)
        points = 501 if self.points is None else self.points
        if _finite("points", points) != int(points) or points < 2:
            raise ValueError(f"a run has at least 2 output points, found {points}")
        if points > MOST_POINTS:
            raise ValueError(f"a run has at most {MOST_POINTS} output points, found {points}")
        return np.linspace(start, stop, int(points))

    def tolerance(self, experiment: Experiment) -> float:
        """The relative tolerance."""
        return float(_first(self.rtol, experiment.tolerance, 1e-6))

    def check_tolerances(self, experiment: Experiment) -> None:
        """
        Raises
        ------
        ValueError
            Where they cannot be used.
        """
        rtol = _finite("rtol", _first(self.rtol, experiment.tolerance, 1e-6))
        atol = _finite("atol", _first(self.atol, 1.0))
        if not _finite("max_step", _first(self.max_step, 1.0)) > 0:
            raise ValueError(f"the longest step is positive, found max_step = {self.max_step:g}")
        if not (FINEST <= rtol < 1 and atol > 0):
            found = f"rtol = {rtol:g}" if self.atol is None else f"rtol = {rtol:g}, atol = {atol:g}"
            raise ValueError(f"tolerances are {FINEST:g} ≤ rtol < 1 and atol > 0, found {found}")
        self._check_step()

    def step_length(self, span: TimeSpan) -> float | None:
        """Return the length of all steps, s; None where the solver chooses them."""
        if self.step is None and self.solver in FIXED_STEP:
            return (span.end - span.start) / _STEPS
        return self.step

    def _check_step(self) -> None:
        """The length of the steps is given where the solver takes it, and only there."""
        if self.step is None:
            return
        if not _finite("step", self.step) > 0:
            raise ValueError(f"the length of the steps is positive, found step = {self.step:g}")
        if self.solver not in FIXED_STEP + EITHER:
            takers = ", ".join(FIXED_STEP + EITHER)
            raise ValueError(
                f"solver '{self.solver}' chooses its steps by the tolerance: step is for {takers}; max_step "
                "(--max-step) bounds the steps of others"
            )
        if self.max_step is not None:
            raise ValueError("step and max_step exclude each other")


def _spaced(start: float, stop: float, interval: float) -> np.ndarray:
    """Times at an interval, and the stop time, which may follow sooner."""
    count = (stop - start) / interval
    if abs(count - round(count)) < 1e-6 and round(count):
        return np.linspace(start, stop, round(count) + 1)
    return np.append(start + interval * np.arange(int(count) + 1), stop)


def _finite(name: str, value) -> float:
    if not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise ValueError(f"{name} must be a finite number, found {value!r}")
    return float(value)


def _first(*values):
    return next(v for v in values if v is not None)
