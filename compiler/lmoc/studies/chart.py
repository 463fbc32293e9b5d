"""Speed against accuracy: one scene by many methods, formulations and tolerances, against one reference."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError, SimulationError, nearest
from lmoc.numerics.options.formulations import TABLE
from lmoc.numerics.options.options import FIXED_STEP, FORMULATIONS, SOLVERS, solver_hint
from lmoc.session import Session
from lmoc.simulation import Request
from lmoc.studies.chart_text import save, table
from lmoc.studies.findings import DIGITS, Findings
from lmoc.studies.points import Measurement, Point, Runner, Setting, steps_for
from lmoc.studies.reference import Probe, Reference, first_of, is_stiff, make_reference, probe
from lmoc.studies.whole import Whole, try_whole
from lmoc.studies.work import reached_with
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RTOLS = tuple(10.0**-k for k in range(3, 11))
_QUICK_RTOLS = 1e-3, 1e-5, 1e-7, 1e-9
_QUICK = ("auto", "dop853", "taylor", "adams", "cvode", "radau", "gauss", "midpoint")
_ELSEWHERE = "auto", "dop853", "taylor", "ida", "radau", "gauss"  # in other formulations, unless somebody asks
_STEPS, _QUICK_STEPS = 6, 3  # lengths of fixed steps
# work of a run by `auto` in a quick chart, and of a run of its reference, s as counted in `work`; where there is more,
# only the beginning is charted
_QUICK_RUN, _QUICK_REFERENCE = 0.1, 0.5
_QUICK_WHOLE = 2.0  # s, that a run may take by which the advice is tried on the whole scene
_LEAST_SHARE = 0.5  # of the time for a chart that is left for its points, however long the reference has taken

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Budget:
    """The time that a chart may take, s.

    Attributes
    ----------
    total : for everything
    reference : for the reference
    run : for a single run of a method
    repeats : of each run, at most
    """

    total: float
    reference: float
    run: float
    repeats: int


_BUDGET = Budget(total=300.0, reference=60.0, run=20.0, repeats=5)
_QUICK_BUDGET = Budget(total=5.0, reference=2.0, run=0.35, repeats=2)


class Chart(Findings):
    """A chart of speed against accuracy, as a user holds it; attributes as of `Findings`."""

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw error against time; errors as `Run.plot`."""
        from lmoc.studies.chart_plot import plot

        return plot(self, path)

    def save(self, path: str | Path) -> Path:
        """Write the table as .csv or .json.

        Raises
        ------
        ModelError
            E0623, E0624: the file cannot be written.
        """
        return save(self, Path(path))

    def __str__(self) -> str:
        return table(self)

    def __repr__(self) -> str:
        return f"<Chart of {self.name}: {len(self.points)} points, {self.recommendation}>"


def chart(
    session: Session,
    request: Request,
    solvers: Sequence[str] | None = None,
    formulations: Sequence[str] | None = None,
    rtols: Sequence[float] | None = None,
    quick: bool = False,
    seconds: float | None = None,
    progress: Progress | None = None,
) -> Chart:
    """Chart speed against accuracy.

    Parameters
    ----------
    request : the run as it would be; its solver, formulation and tolerance do not count
    solvers : of `SOLVERS`; all by default. "auto" takes part, so that it can be judged
    formulations : of `FORMULATIONS`; all where the scene has constraints that formulations differ in, else "reduced"
    rtols : relative tolerances; a decade apart from 1e-3 to 1e-10 by default. Methods with fixed steps have a scan of
        step lengths instead
    quick : few methods and tolerances, in less than 10 s
    seconds : that the chart may take, about; 300 by default
    progress : called with what is being done and the share of the work that is done

    Raises
    ------
    ModelError
        E0540, E0541, E0626: unknown solvers or formulations, impossible tolerances; what is wrong with the run.
    SimulationError
        There is no reference, or the run itself fails.
    """
    progress = progress or (lambda text, share: None)
    runner = Runner(session, request)
    solvers = _checked("E0540", "solver", solvers, SOLVERS, solver_hint)
    formulations = _checked("E0626", "formulation", formulations, FORMULATIONS, lambda n: nearest(n, FORMULATIONS))
    tolerances = sorted(set(_QUICK_RTOLS if quick else _RTOLS) if rtols is None else _tolerances(rtols), reverse=True)
    budget = _budget(seconds, quick)
    if not len(session.reduced.states):
        raise ModelError([Diagnostic("E0541", "there is nothing to chart: the scene has no states to integrate")])
    until = clock.thread_time() + budget.total
    progress("auto at rtol 1e-6", 0.0)
    scene, note = runner, ""
    end = _quick_end(runner, budget) if quick else runner.span.end
    if end < scene.span.end:
        runner = runner.until(end)
        note = f"to be quick, only until {end:.3g} s of {scene.span.end:g} s"
    first = probe(runner, budget.reference)
    reference = make_reference(runner, first, budget.reference, progress)
    settings = [
        _settings(solver, formulation, tolerances, first, quick)
        for formulation in formulations or _formulations(session, quick)
        for solver in solvers or (_QUICK if quick else SOLVERS if formulation == "reduced" else _ELSEWHERE)
        if TABLE[formulation].goes_with(solver)
    ]
    until = max(until, clock.thread_time() + _LEAST_SHARE * budget.total)
    measurement = Measurement(runner, reference.signals, budget.run, until, progress)
    measurement.measure(settings, budget.repeats)
    points = (measurement.points.get(setting) for series in settings for setting in series)
    found = tuple(p for p in points if p is not None)
    whole = None
    if runner is not scene and not measurement.interrupted:
        whole = _try_whole(scene, runner, found, reference, progress)
    return Chart(session.flat.name, found, reference, note, measurement.interrupted, whole)


def _quick_end(runner: Runner, budget: Budget) -> float:
    """Return the end of the runs of a quick chart, s: `auto` gets there with little work, and so does the reference.

    It follows from the scene, and not from the clock.
    """
    auto = reached_with(runner, Setting("auto", "reduced", 1e-6), _QUICK_RUN, budget.total)
    part = runner if auto.end >= runner.span.end else runner.until(auto.end)
    try:
        return reached_with(part, first_of(is_stiff(auto.run)), _QUICK_REFERENCE, budget.total).end
    except (SimulationError, ModelError):  # another method serves as reference
        return auto.end


def _try_whole(
    scene: Runner, runner: Runner, points: Sequence[Point], reference: Reference, progress: Progress
) -> Whole:
    """Return what has come of trying the points with the most digits on the whole scene, of as many as any has."""
    longer = (scene.span.end - scene.span.start) / (runner.span.end - runner.span.start)
    names = reference.signals.names
    for digits in range(DIGITS, 0, -1):
        whole = try_whole(scene, points, names, 10.0**-digits, longer, _QUICK_WHOLE, progress)
        if any(p.error <= 10.0**-digits for p in whole.tried) or whole.uncertainty == math.inf:
            break
    return whole


def _budget(seconds: float | None, quick: bool) -> Budget:
    """Return the time allowed, the parts in proportion to the whole."""
    budget = _QUICK_BUDGET if quick else _BUDGET
    if seconds is None:
        return budget
    if not (math.isfinite(seconds) and seconds > 0):
        raise ModelError([Diagnostic("E0541", f"the seconds of a chart are positive, found {seconds:g}")])
    share = seconds / budget.total
    return Budget(seconds, budget.reference * share, budget.run * share, budget.repeats)


def _settings(solver: str, formulation: str, tolerances: Sequence[float], first: Probe, quick: bool) -> list[Setting]:
    """Return the points of one method, the coarsest first."""
    if solver not in FIXED_STEP:
        return [Setting(solver, formulation, rtol) for rtol in tolerances]
    lengths = steps_for(first.reached - first.begin, first.step, _QUICK_STEPS if quick else _STEPS)
    return [Setting(solver, formulation, math.nan, length) for length in lengths]


def _formulations(session: Session, quick: bool) -> tuple[str, ...]:
    """Return the formulations in which a scene differs: where nonlinear constraints are left after reduction."""
    return FORMULATIONS[1:] if session.reduced.constraints is not None and not quick else ("reduced",)


def _checked(code: str, what: str, names: Sequence[str] | None, known: Sequence[str], hint) -> tuple[str, ...]:
    """Return names that are all known, without repetitions; none where None is given."""
    found = tuple(dict.fromkeys([names] if isinstance(names, str) else names or ()))
    wrong = [name for name in found if name not in known]
    if wrong:
        raise ModelError(
            [Diagnostic(code, f"there is no {what} '{n}'", expected=", ".join(known), hint=hint(str(n))) for n in wrong]
        )
    return found


def _tolerances(rtols: Sequence[float] | float) -> list[float]:
    values = np.atleast_1d(np.asarray(rtols, float)).ravel()
    if not len(values) or not ((values >= 1e-14) & (values < 1)).all():
        raise ModelError([Diagnostic("E0541", f"tolerances are 1e-14 ≤ rtol < 1, found {rtols}")])
    return values.tolist()
