"""Speed against accuracy: one scene by many methods, formulations and tolerances, against one reference."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.numerics.formulations.table import TABLE
from lmoc.numerics.options import FIXED_STEP, FORMULATIONS, SOLVERS, solver_hint
from lmoc.session import Session
from lmoc.simulation import Request
from lmoc.studies.chart_text import save, table
from lmoc.studies.findings import Findings
from lmoc.studies.points import Measurement, Runner, Setting, steps_for
from lmoc.studies.reference import Probe, make_reference, probe, reach
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RTOLS = tuple(10.0**-k for k in range(3, 11))
_QUICK_RTOLS = 1e-3, 1e-5, 1e-7, 1e-9
_QUICK = ("auto", "dop853", "taylor", "adams", "cvode", "radau", "gauss", "midpoint")
_ELSEWHERE = "auto", "dop853", "taylor", "ida", "radau", "gauss"  # in other formulations, unless somebody asks
_STEPS, _QUICK_STEPS = 6, 3  # lengths of fixed steps
_QUICK_REFERENCE, _QUICK_SHARE = 0.2, 0.7  # of the time for it a run of the reference may take; of the way it gets then
_QUICK_RUN = 0.04  # s, that a run by `auto` may take in a quick chart; of a longer one only the beginning is charted
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
    first, note = probe(runner, budget.reference), ""
    end = _quick_end(runner, first, budget) if quick else first.end
    if end < first.end:
        runner = runner.until(end)
        note = f"to be quick, only until {end:.3g} s of {first.end:g} s"
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
    return Chart(session.flat.name, tuple(p for p in points if p is not None), reference, note, measurement.interrupted)


def _quick_end(runner: Runner, first: Probe, budget: Budget) -> float:
    """Return the end of the runs of a quick chart, s: `auto` gets there quickly, and so does the reference."""
    end = first.end
    if first.seconds > _QUICK_RUN:
        end = first.begin + (first.reached - first.begin) * _QUICK_RUN / first.seconds
    seconds = budget.reference * _QUICK_REFERENCE
    reached = reach(runner if end == first.end else runner.until(end), replace(first, end=end), seconds)
    return end if reached >= end else first.begin + _QUICK_SHARE * (reached - first.begin)


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
