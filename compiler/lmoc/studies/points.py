"""The points of a chart: which runs there are, what each has given, and how long it takes.

All runs are made in one process, in turns, so that a disturbance hits all methods alike; the shortest of a run's times
counts. Times are those of the processor in this thread: on a machine that does nothing else they are what a user waits,
and on a busy one they are still comparable.
"""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace

import numpy as np

from lmoc.messages.budgeted import told
from lmoc.messages.diagnostics import Diagnostic, ModelError, RunInterrupted, SimulationError
from lmoc.numerics.options.options import TimeSpan
from lmoc.numerics.problem.status import Status
from lmoc.run import Run
from lmoc.session import Session
from lmoc.simulation import Request, simulate
from lmoc.studies.deviation import Signals, deviation, signals_of
from lmoc.studies.residual import constraint_residual
from lmoc.support.records import dataclass

_ONE_CALL = ("cvodes", "idas", "collocation", "collocation-radau")  # a run is one call, which nothing can stop
NOT_RUN = "not run"  # what a status begins with where there was no time for a run
TOO_SLOW = "it takes "  # what stands before how long a run took until it was given up
_SHORT = 1e-3  # of the span, a run that warms up


@dataclass(frozen=True)
class Setting:
    """One way to run a scene; `rtol` is NaN with a fixed step, `step` without."""

    solver: str
    formulation: str
    rtol: float
    step: float = np.nan

    @property
    def fixed(self) -> bool:
        return bool(np.isfinite(self.step))

    @property
    def text(self) -> str:
        """Return ``dop853 at rtol 1e-7``."""
        how = f"step {self.step:.2g} s" if self.fixed else f"rtol {self.rtol:.0e}".replace("e-0", "e-")
        form = "" if self.formulation == "reduced" else f" ({self.formulation})"
        return f"{self.solver}{form} at {how}"


@dataclass(frozen=True)
class Point:
    """The outcome of one way to run a scene.

    Attributes
    ----------
    error, end_error : the largest deviation from the reference, relative to each signal's largest magnitude, over the
        output times and at the last one; NaN for a run that has failed
    seconds : s, the shortest of several warm runs
    repeats : runs that count
    evaluations, jacobians, steps, events : of one run
    residual, velocity_residual : of the equations between positions, and of closed loops at the level of velocities
    energy : error of the balance; NaN where it is unknown
    status : "ok", or why there is no result
    note : what else there is to say; for "auto", the solvers it has chosen
    """

    setting: Setting
    error: float = np.nan
    end_error: float = np.nan
    seconds: float = np.nan
    repeats: int = 0
    evaluations: int = 0
    jacobians: int = 0
    steps: int = 0
    events: int = 0
    residual: float = np.nan
    velocity_residual: float = np.nan
    energy: float = np.nan
    status: str = "ok"
    note: str = ""

    @property
    def ok(self) -> bool:
        return self.status == "ok"


class Runner:
    """Makes runs of one scene.

    Parameters
    ----------
    request : the run as it would be without options of a chart
    """

    def __init__(self, session: Session, request: Request) -> None:
        self.session, self.request = session, request

    @property
    def span(self) -> TimeSpan:
        """The span of the runs and their output times.

        Raises
        ------
        ModelError
            E0541: there is no such span.
        """
        try:
            return self.request.options.span(self.session.flat.experiment)
        except ValueError as error:
            raise ModelError([Diagnostic("E0541", str(error))]) from None

    def until(self, stop: float) -> Runner:
        """Return what makes shorter runs, with as many output times."""
        options = replace(self.request.options, stop=stop, points=len(self.span.times), times=None)
        return Runner(self.session, replace(self.request, options=options))

    def run(self, setting: Setting, limit: float | None = None) -> tuple[Run, float]:
        """Return a run and the seconds that it took.

        Parameters
        ----------
        limit : s after which it is given up, where the method can be stopped

        Raises
        ------
        ModelError, SimulationError, RunInterrupted
        """
        options = replace(
            self.request.options,
            solver=setting.solver,
            formulation=setting.formulation,
            rtol=None if setting.fixed else setting.rtol,
            step=setting.step if setting.fixed else None,
            max_seconds=None if limit is None or self._is_one_call(setting.solver) else limit,
        )
        request = replace(self.request, options=options)
        gc.disable()  # as timeit does
        try:
            begin = clock.thread_time()
            run = told("the run", lambda: simulate(self.session, request))
            return run, clock.thread_time() - begin
        finally:
            gc.enable()

    def _is_one_call(self, solver: str) -> bool:
        """Return whether a run is one call of casadi, which takes those only that have no deadline."""
        reduced = self.session.reduced
        looked_at = reduced.switched is not None or reduced.flat.events is not None or reduced.constraints is not None
        return solver in _ONE_CALL and not looked_at

    def warm(self, setting: Setting) -> None:
        """Make a first short run, so that imports and what is kept with a scene are not counted to a method.

        Where it fails, so will the run itself, which tells why.
        """
        span = self.span
        short = [span.start + _SHORT * (span.end - span.start)]
        options = replace(self.request.options, stop=None, points=None, times=short)
        try:
            Runner(self.session, replace(self.request, options=options)).run(setting)
        except RunInterrupted:
            raise
        except (SimulationError, ModelError):
            return


@dataclass
class _Series:
    """The points of one method in one formulation, loosest first, under way."""

    settings: list[Setting]
    given_up: str = ""
    points: list[Point] = field(default_factory=list)


class Measurement:
    """Measures points until the time for it is over.

    Parameters
    ----------
    reference : what errors are measured against
    limit : s, the longest a single run may take
    until : value of `time.thread_time` at which no further repeats begin
    progress : called with a text and the share of the work that is done
    """

    def __init__(
        self, runner: Runner, reference: Signals, limit: float, until: float, progress: Callable[[str, float], None]
    ) -> None:
        self.runner, self.reference = runner, reference
        self.limit, self.until, self.progress = limit, until, progress
        self.points: dict[Setting, Point] = {}
        self.interrupted = False

    def measure(self, series: Sequence[Sequence[Setting]], repeats: int) -> None:
        """Measure all settings, those of one method loosest first, and repeat them in turns."""
        try:
            self._first(series)
            self._repeat(repeats)
        except KeyboardInterrupt:  # `RunInterrupted` is one: what has been measured stays
            self.interrupted = True

    def _first(self, series: Sequence[Sequence[Setting]]) -> None:
        total, done = sum(map(len, series)), 0
        work = [_Series(list(settings)) for settings in series]
        for settings in series:
            self.progress(f"warm up: {settings[0].solver}", 0.0)
            self.runner.warm(settings[0])
        for turn in _turns(work):
            setting = turn.settings.pop(0)
            self.progress(setting.text, 0.5 * done / total)
            point = self._new(setting, turn)
            self.points[setting] = point
            turn.points.append(point)
            done += 1

    def _new(self, setting: Setting, series: _Series) -> Point:
        """Return the point of a setting that has not been run yet, or why it is not run."""
        if series.given_up:
            return Point(setting, status=series.given_up)
        left = self.until - clock.thread_time()
        if left < 0:
            return Point(setting, status=f"{NOT_RUN}: the time limit of the chart was reached")
        expected = _expected(series.points)
        if expected > self.limit:
            series.given_up = f"{NOT_RUN}: it would take {expected:.2g} s"
            return Point(setting, status=series.given_up)
        point = self._measured(setting)
        if TOO_SLOW in point.status:
            series.given_up = f"{NOT_RUN}: a coarser one takes {point.status.partition(TOO_SLOW)[2].partition(':')[0]}"
        return point

    def _measured(self, setting: Setting) -> Point:
        begin = clock.thread_time()
        try:
            run, seconds = self.runner.run(setting, self.limit)
        except RunInterrupted:
            raise
        except SimulationError as failure:
            slow = f"{TOO_SLOW}more than {clock.thread_time() - begin:.2g} s"
            return Point(setting, status=str(failure).replace(Status.TOO_LONG.value, slow), note=_reached(failure))
        except ModelError as error:
            return Point(setting, status="refused: " + error.diagnostics[-1].message)
        return point_of(setting, run, seconds, self.reference)

    def _repeat(self, repeats: int) -> None:
        good = [setting for setting, point in self.points.items() if point.ok]
        for turn in range(repeats):
            for k, setting in enumerate(good):
                point = self.points[setting]
                if clock.thread_time() + point.seconds > self.until:
                    continue
                self.progress(setting.text, 0.5 + 0.5 * (turn + k / len(good)) / repeats)
                _, seconds = self.runner.run(setting)
                best = seconds if not point.repeats else min(seconds, point.seconds)
                self.points[setting] = replace(point, seconds=best, repeats=point.repeats + 1)


def _turns(work: Sequence[_Series]) -> Iterator[_Series]:
    """Yield the series in turns until all are done."""
    while any(s.settings for s in work):
        yield from (s for s in work if s.settings)


def _expected(points: Sequence[Point]) -> float:
    """Return the seconds that the next point of a series will take, as the last two suggest."""
    times = [p.seconds for p in points if p.ok]
    if len(times) < 2:
        return 0.0
    return times[-1] * max(1.0, times[-1] / times[-2])


def _reached(failure: SimulationError) -> str:
    return f"reached {failure.time:.6g} s"


def point_of(setting: Setting, run: Run, seconds: float, reference: Signals) -> Point:
    """Return what a run that has come to its end amounts to."""
    apart, stats = deviation(signals_of(run, reference.names), reference), run.stats
    notes = [apart.note]
    if setting.solver != stats["solver"]:
        notes.insert(0, str(stats["solver"]))
    finite = np.isfinite(apart.largest)
    return Point(
        setting, apart.largest, apart.end, seconds, 0, int(stats["evaluations"]), int(stats.get("jacobians", 0)),
        int(stats.get("steps", 0)), len(run.events), *_residuals(run), _balance(run),
        "ok" if finite else "the signals have no finite values", "; ".join(filter(None, notes)),
    )  # fmt: skip


def _balance(run: Run) -> float:
    """Return the error of the energy balance; NaN where it is unknown, or no part says what energy it has."""
    energy = run.energy
    if energy is None or not any(flow.any() for flow in (energy.stored, energy.supplied, energy.lost)):
        return np.nan
    return float(energy.balance)


def _residuals(run: Run) -> tuple[float, float]:
    """Return the residuals of positions and of velocities; of these NaN where there are no closed loops."""
    position, velocity = run.residual or (0.0, np.nan)
    return max(position, constraint_residual(run)), velocity


def steps_for(span: float, typical: float, count: int) -> list[float]:
    """Return lengths of fixed steps to scan, longest first: from half of those of an accurate method.

    Parameters
    ----------
    span : s, of the run
    typical : s, the mean step of an accurate method of high order
    """
    first = span / max(16.0, 2 * round(span / typical))
    return [first / 4**k for k in range(count)]
