"""The work of a run as its counts tell it: the same on every machine, idle or busy, unlike the time that it takes."""

from __future__ import annotations

from lmoc.messages.diagnostics import SimulationError
from lmoc.numerics.problem.status import Status
from lmoc.run import Run
from lmoc.studies.points import Runner, Setting
from lmoc.support.records import dataclass

_EVALUATION, _ROW, _EVENT = 4e-6, 2e-8, 5e-4  # s on a usual machine: of an evaluation, of a row in it, of an event
_PARTS = 4.0  # by which the part that is looked at grows
_LEAST = 4.0**-6  # of the span


@dataclass(frozen=True)
class Reached:
    """How far a run gets with so much work.

    Attributes
    ----------
    end : s
    run : the last one, which has gone at least as far
    """

    end: float
    run: Run


def work(run: Run) -> float:
    """Return the seconds that a run would take on a usual machine, by its evaluations and events; good to a factor."""
    rows = run.trajectory.segments[0].observer.plan.row_count
    return int(run.stats["evaluations"]) * (_EVALUATION + _ROW * rows) + _EVENT * len(run.events)


def reached_with(runner: Runner, setting: Setting, most: float, seconds: float) -> Reached:
    """Return how far a setting gets with so much work: a little of the span is looked at first, then ever more.

    Parameters
    ----------
    most : s, as `work` counts them
    seconds : that a single run may take in any case

    Raises
    ------
    ModelError, SimulationError
        The run fails before it gets there.
    """
    span, part, last = runner.span, _LEAST, None
    while True:
        length = part * (span.end - span.start)
        own = runner if part >= 1.0 else runner.until(span.start + length)
        try:
            run, _ = own.run(setting, seconds)
        except SimulationError as failure:
            if last is None or Status.TOO_LONG.value not in str(failure):
                raise
            return last
        spent, last = work(run), Reached(span.start + length, run)
        if spent > most:
            return Reached(span.start + length * most / spent, run)
        if part >= 1.0:
            return Reached(span.end, run)
        part = min(1.0, part * _PARTS)
