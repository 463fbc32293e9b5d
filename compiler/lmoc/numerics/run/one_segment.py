"""The integration of one segment of a run: its problem, and the cases in which there is nothing to integrate."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.taylor_system import has_series
from lmoc.numerics.failures.chatter import FRICTION_HINT, chatters, jumps
from lmoc.numerics.limits import FINEST
from lmoc.numerics.options.formulations import ONE_STEP
from lmoc.numerics.options.options import MOREAU
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.activity import Lookout, lookout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import REQUESTED, Outcome, PlanCost, Problem
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import break_times
from lmoc.numerics.steps import choice
from lmoc.numerics.steps.automatic import NOT_STIFF, OVERRUN, TRIAL, begins_along_series
from lmoc.numerics.steps.standing import standing
from lmoc.numerics.task.task import Cost, Segment, Task
from lmoc.numerics.task.tolerances import Tolerances
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.laws.step_length import Stepped
    from lmoc.numerics.laws.time_stepping import TimeStepping
    from lmoc.numerics.run.changes import Continuation

_MOST_OF_TABLES = 10 * kinks.MOST  # kinks of a table at which a run stops
_SLOW = (Status.CHATTERING, Status.COLLAPSED, Status.TOO_MANY_STEPS, Status.SPENT)
_MULTISTEP = frozenset({"cvode", "adams", "ida"})
_NO_TIME = 1e-15  # of the time: a shorter segment is too short for the solvers, and nothing moves in it
_DRIFT = 0.1  # of the tolerance: from there on the states are moved onto what is closed
ACCEPTED = 0.01  # share of the ranges of positions by which they may be off before a run warns of it


@dataclass(frozen=True, eq=False)
class Bounds:
    """The bounds of the integration of a segment.

    Attributes
    ----------
    begin, end : s
    longest : s, the longest step
    roots : what ends the segment early; None where nothing switches
    finer : factor on the tolerances
    continuation : bounds the steps after a change of coordinates
    kept : moves states onto what is closed (`LawSwitching.kept`); None where nothing drifts
    """

    begin: float
    end: float
    longest: float = np.inf
    roots: Roots | None = None
    finer: float = 1.0
    continuation: Continuation | None = None
    kept: Callable[..., np.ndarray] | None = None


class SegmentSolver:
    """Integrates the segments of one run.

    Attributes
    ----------
    tolerances : of the run
    cost : of all its segments so far
    unresolved : (states,) what the latest method tells the states apart by no more where it begins, for methods that
        begin with order one
    errors : (states,) what the latest method has allowed itself in a step
    """

    def __init__(self, task: Task, tolerances: Tolerances) -> None:
        options = task.options
        self.task, self.tolerances, self.cost = task, tolerances, Cost()
        self._deadline = None if options.max_seconds is None else clock.thread_time() + options.max_seconds
        self._progress = None if task.progress is None else lambda t: task.progress(t, task.span.end)
        self._lookout: Lookout | None = None
        self._given = break_times(task.signals, task.span.start, task.span.end, _MOST_OF_TABLES)
        self._spent: dict[Plan, PlanCost] = {}
        self.unresolved: np.ndarray | float = 0.0
        self.errors: np.ndarray | float = 0.0

    def at_once(self, segment: Segment, x: np.ndarray, bounds: Bounds) -> Outcome | None:
        """Return the outcome of a segment without states or without extent; None where there is something to do."""
        begin, end = bounds.begin, bounds.end
        if not len(x) and bounds.roots is None:
            reason = "no states"
        elif begin == end:
            return self.cost.add(Outcome(begin, x, 0), segment.system, "none", "only the start")
        elif end - begin <= _NO_TIME * max(abs(begin), abs(end)):
            reason = "only an instant"
        else:
            return None
        count = len(_times_ahead(segment, end))
        segment.recorder(segment.recorder.reached, np.tile(x, (count, 1)))
        return self.cost.add(Outcome(end, x, count), segment.system, "none", reason)

    def __call__(self, segment: Segment, x: np.ndarray, bounds: Bounds) -> Outcome:
        """Integrate a segment from a state (n,) to its end, or to what ends it earlier."""
        options = self.task.options
        problem = self._problem(segment, x, bounds)
        if not len(x):
            return self.cost.add(standing(problem), segment.system, "none", "no states")
        implicit = problem.index_one is not None
        outcome, method = choice.run(problem, "ida" if implicit else options.solver)
        if implicit:
            method["reason"] = f"for formulation {options.formulation}"
        segment.largest = None if bounds.roots is None else bounds.roots.largest
        multistep = str(method["solver"]).rpartition(", ")[2] in _MULTISTEP
        self.errors = problem.rtol * np.abs(outcome.x) + problem.atol
        self.unresolved = self.errors if multistep else 0.0
        return self.cost.add(outcome, segment.system, method["solver"], method["reason"])

    def along_series(self, segment: Segment) -> bool:
        """Return whether the first steps of a segment are made along a Taylor series, if nothing divides it."""
        options, system = self.task.options, segment.system
        most = min(options.max_steps, options.requested.form.most_steps)
        if len(self._given) or most < TRIAL + OVERRUN:
            return False
        if options.solver != "auto":
            return options.solver == "taylor" and has_series(system)
        spent = self._spent.setdefault(segment.plan, PlanCost())
        spent.series |= (found := begins_along_series(system, spent))
        return found

    def count_series(self, outcome: Outcome, system: System) -> None:
        """Count segments that have been such steps alone."""
        self.cost.add(outcome, system, "taylor", NOT_STIFF if self.task.options.solver == "auto" else REQUESTED)

    def march(self, segment: Segment, x: np.ndarray, begin: Callable[[], TimeStepping]) -> Stepped:
        """Go to the end of the run by steps of equal length, in which impulses of the laws take the place of events.

        Parameters
        ----------
        begin : returns what makes the steps, at the start
        """
        from lmoc.numerics.laws.step_length import stepped

        span, recorder, plan = self.task.span, segment.recorder, segment.plan
        done = recorder.reached
        problem = Problem(
            segment.system,
            segment.begin,
            x,
            span.end,
            recorder.times[done:],
            self.tolerances.rtol,
            np.zeros(len(x)),
            lambda first, states: recorder(first + done, states),
            deadline=self._deadline,
            progress=self._progress,
            step=self.task.options.step_length(span),
        )
        positions = np.isin(plan.derivatives, plan.states) & ~plan.ledger
        found = stepped(problem, begin, positions, self.task.options.step is not None)
        self.cost.add(found.outcome, segment.system, MOREAU, REQUESTED)
        self.cost.stats |= {"step": found.step, "estimated_error": found.error}
        _report_steps(found, self.task.report)
        return found

    def holding_jump(self, segment: Segment, t: float, x: np.ndarray, step: float) -> str:
        """Describe the jump of an equation that keeps the motion at a place by such steps; empty where none does."""
        found, span = segment.plan.once(jumps), self.task.span
        if not found:
            return ""
        return chatters(found, segment.observer, segment.system, (t, x), span.end - span.start, step)

    def why_slow(self, segment: Segment, outcome: Outcome) -> str:
        """Return why a run with ever shorter steps cannot go on, where a jump of an equation is the reason; else ""."""
        if outcome.status not in _SLOW:
            return ""
        jump = self.holding_jump(segment, outcome.time, outcome.x, outcome.step)
        return f"{jump} ({FRICTION_HINT})" if jump else ""

    def _problem(self, segment: Segment, x: np.ndarray, bounds: Bounds) -> Problem:
        """Return what the integrator is given for a segment."""
        task, options, begin, end = self.task, self.task.options, bounds.begin, bounds.end
        corrected = None
        if bounds.kept is not None and options.solver in ONE_STEP:
            corrected = partial(bounds.kept, share=_DRIFT * self.tolerances.rtol)
        loops, done, times = segment.loops, segment.recorder.reached, _times_ahead(segment, end)
        whole = task.span.start, task.span.end
        self._lookout = lookout(segment.plan, segment.base, task.signals, whole, self._lookout)

        def sink(first: int, states: np.ndarray) -> None:
            if loops is not None:
                states = loops.output(times[first:], states)
            elif bounds.kept is not None:
                states = np.array([bounds.kept(t, x) for t, x in zip(times[first:].tolist(), states)])
            segment.recorder(first + done, states)

        def held(t: float, x: np.ndarray, step: float) -> bool:
            return bool(self.holding_jump(segment, t, x, step))

        return Problem(
            segment.system,
            begin,
            x,
            end,
            times,
            max(self.tolerances.rtol * bounds.finer, FINEST),
            self.tolerances.absolute(segment, x) * bounds.finer,
            sink,
            max_step=bounds.longest,
            max_steps=min(options.max_steps, options.requested.form.most_steps),
            deadline=self._deadline,
            progress=self._progress,
            lookout=self._lookout if bounds.continuation is None else bounds.continuation.bounded(self._lookout),
            breaks=self._breaks(segment, begin, end),
            guard=segment.watch or loops,
            roots=bounds.roots,
            correction=corrected if loops is None else loops.correction,
            compiled_guard=segment.watch or (loops if loops is not None and loops.landing is not None else None),
            index_one=None if loops is None else loops.index_one,
            held=held if segment.plan.once(jumps) else None,
            step=options.step_length(task.span),
            spent=self._spent,
        )

    def _breaks(self, segment: Segment, begin: float, end: float) -> np.ndarray:
        """Return the times at which formulas of time and given signals have kinks or jumps."""
        own = kinks.break_times(segment.plan, segment.base, begin, end)
        if len(own) == kinks.MOST:
            text = f"the formulas of time have kinks or jumps after t = {own[-1]:g} s, too"
            self.task.report.warning("W0526", text)
        first, last = np.searchsorted(self._given, begin, "left"), np.searchsorted(self._given, end, "right")
        given = self._given[first:last]
        return distinct(np.concatenate([own, given])) if len(own) and len(given) else own if len(own) else given


def _report_steps(found: Stepped, report: Report) -> None:
    """Say what the error of time stepping is estimated to be."""
    if np.isnan(found.error):
        return
    text = f"time stepping with steps of {found.step:.3g} s: positions are off by about {100 * found.error:.2g} % of"
    if found.error > ACCEPTED:
        hint = "the error is proportional to the step: `--step` asks for a shorter one"
        report.warning("W0555", f"{text} their ranges", hint=hint)
    else:
        report.note("N0555", f"{text} their ranges, estimated from steps twice as long")


def _times_ahead(segment: Segment, end: float) -> np.ndarray:
    """Return the output times of a segment that are still ahead, up to a time."""
    times = segment.recorder.times
    return times[segment.recorder.reached : np.searchsorted(times, end, "right")]
