"""One run as a sequence of segments: start, integrate, change over, integrate, … until its end.

A segment has one reduction and one system. What ends it before the end of the run (other coordinates are better, a
root) says what the next one is; states pass from one to the next by the variables they stand for.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, RunInterrupted, SimulationError
from lmoc.numerics.coordinates.change import (
    RunState,
    all_unknowns,
    block_unknowns,
    registers_at,
    with_solutions,
)
from lmoc.numerics.failures.checks import run_checks
from lmoc.numerics.failures.flood import Flood
from lmoc.numerics.monitors.monitor import Monitors
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.recorder import kept_variables
from lmoc.numerics.observe.trajectory import End, SegmentRecord, Trajectory
from lmoc.numerics.options.options import MOREAU, WHOLE_RUN
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.problem.base import Outcome, on_interrupt
from lmoc.numerics.problem.status import Status, Stopped, interruption
from lmoc.numerics.problem.system import System
from lmoc.numerics.run.account import (
    check_start,
    check_values,
    explanation,
    note_coordinates,
    registers_at_end,
)
from lmoc.numerics.run.branches import idle_solutions, standing
from lmoc.numerics.run.one_segment import Bounds, SegmentSolver
from lmoc.numerics.start.first_states import first_states
from lmoc.numerics.task.sizes import assumed_sizes
from lmoc.numerics.task.task import Segment, Task
from lmoc.numerics.task.tolerances import Tolerances
from lmoc.support.records import replace

if TYPE_CHECKING:
    from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
    from lmoc.numerics.events.memory import Begun
    from lmoc.numerics.events.occasion import Occasion
    from lmoc.numerics.failures.assertions import Assertions
    from lmoc.numerics.run.changes import Changes, Continuation
    from lmoc.numerics.run.segments_in_c import ThroughSegments

ROUNDING = 5e-11  # of the size of the states: tolerances are no finer where constraints almost depend on each other
FINER = 0.1  # factor on the tolerances of segments after a change of coordinates


def run_segments(
    task: Task, plan: Plan, system: System, base: np.ndarray, initial: Mapping[str, float] | End | RunState
) -> Trajectory:
    """Run from the start to the end.

    Parameters
    ----------
    plan, system, base : of the first segment; base as from `Plan.base`
    initial : {name: value}, fixed at the start, or where another run has ended, or where one begins

    Raises
    ------
    ModelError
        The start is wrong.
    SimulationError, RunInterrupted
        The run failed on its way.
    """
    return _Run(task, plan, system, base).go(initial)


def starting_place(
    task: Task, plan: Plan, system: System, base: np.ndarray, initial: Mapping[str, float] | End
) -> RunState:
    """Return where a run would start. Parameters and errors as of `run_segments`."""
    run = _Run(task, plan, system, base)
    x = run._start(initial)
    return RunState(run.segment.observer, registers_at(run.segment.observer, system, task.span.start, x))


class _Run:
    """One run in progress."""

    def __init__(self, task: Task, plan: Plan, system: System, base: np.ndarray) -> None:
        self.task, self.report = task, task.report
        options, span = task.options, task.span
        observer = Observer(plan, task.values, base, task.signals)
        keep = options.keep
        self.variables = None if keep is None else kept_variables(observer.flat, keep, options.energy)
        self.tolerances = Tolerances(task, options.tolerance(observer.flat.experiment))
        self.solver = SegmentSolver(task, self.tolerances)
        self.segment = Segment(observer, system, span.start, span.times, 0, self.variables)
        self.segments: list[SegmentRecord] = []
        self.ended: Status | None = None  # an event has ended the run
        self.longest = self._longest_step = np.inf if options.max_step is None else options.max_step
        # the last segment and where it ends, before what the model does at its end
        self.before_terminal: tuple[SegmentRecord, np.ndarray] | None = None
        self.lost = ""  # why the run cannot go on, where that is known better than from its status
        self.dynamics: HybridDynamics | None = None
        self.flood: Flood | None = None  # with events or laws
        self.impacts: list[Event] = []  # of velocities that contradict each other at the start
        self.begun: tuple[np.ndarray, np.ndarray] | None = None  # states and base before the events of the start
        self.monitors = Monitors()
        self._in_c: tuple[Plan, ThroughSegments | None] | None = None
        self.assertions: Assertions | None = None  # among the monitors; None where none are watched

    def go(self, initial: Mapping[str, float] | End | RunState) -> Trajectory:
        x = self._start(initial)
        self.start = x.copy()
        started = clock.perf_counter()
        outcome = self._to_the_end(x)
        self._finish(outcome)
        run = self._joined(outcome, started)
        if outcome.status.failed:
            failure = RunInterrupted if outcome.status is Status.INTERRUPTED else SimulationError
            if self.assertions is not None and self.assertions.failed is not None:
                raise failure(self.assertions.reason(), outcome.time, run)
            sizes = self.tolerances.sizes(self.segment)
            known = self.lost or self.solver.why_slow(self.segment, outcome)
            text = explanation(self.segment, outcome, self.task.span, self.segments, sizes, known)
            raise failure(text, outcome.time, run)
        return run_checks(run, self.assertions is not None)

    def _to_the_end(self, x: np.ndarray) -> Outcome:
        """Go from segment to segment until the end of the run, or until it fails."""
        outcome = self._segment_from(x)
        while True:
            if outcome.status is Status.COORDINATES:
                outcome = self._with_other_coordinates(outcome)
                continue
            if self.dynamics is None or outcome.status.failed:
                return outcome
            try:
                x = self._after(outcome)
            except KeyboardInterrupt:
                return replace(outcome, status=interruption())
            if x is None:
                return outcome if self.ended is None else replace(outcome, status=self.ended)
            outcome = self._segment_from(x)

    def _segment_from(self, x: np.ndarray) -> Outcome:
        """Integrate the current segment; where it is interrupted outside of the integration, nothing of it is left."""
        try:
            x, stopped = self._through_segments(x)
            if stopped:
                raise KeyboardInterrupt
            return self._integrate(x, self.segment.begin)
        except KeyboardInterrupt:
            begin = self.segment.begin
            self.segment.recorder.forget_after(begin)
            return Outcome(begin, x, 0, interruption())

    def _through_segments(self, x: np.ndarray) -> tuple[np.ndarray, bool]:
        """Go through segments that laws or events end, in C.

        Returns
        -------
        the states where the segment begins that Python is to look at; whether somebody has interrupted it on the way
        """
        segment, now = self.segment, self.dynamics
        if now is None or self.assertions is not None:
            return x, False
        if self._in_c is None or self._in_c[0] is not segment.plan:
            from lmoc.numerics.run.segments_in_c import through_segments

            self._in_c = segment.plan, through_segments(self.task, segment, self.solver, now, self.variables)
        through = self._in_c[1]
        if through is None or segment.watch is not None or not self.solver.along_series(segment):
            return x, False
        stopped: list[object] = []
        with on_interrupt(lambda *_: stopped.append(None)):  # what C has made is taken as a whole
            passed, last, time, x = through(segment, x, self.longest, self.flood.count)
            if passed:
                self.segments += passed
                self.segment = last
                self._begin(time)
                self.segment.recorder.record_start(time, x)
        return x, bool(stopped)

    def _joined(self, outcome: Outcome, started: float) -> Trajectory:
        """Return the segments so far as one trajectory, with statistics and notes."""
        began, lowered = self.task.clock
        first, dynamics = self.segments[0].observer.plan, self.dynamics
        stats = self.solver.cost.stats | {
            "seconds": clock.perf_counter() - began,
            "lower_seconds": lowered - began,
            "start_seconds": started - lowered,
            "states": first.state_count,
            "rtol": self.tolerances.rtol,
        }
        if self.segment.plan.reduced.in_all_coordinates and not self._went_over and self.segment.loops is not None:
            stats |= self.segment.loops.stats
        if self.assertions is not None and not outcome.status.failed:
            self.assertions.tell(outcome.time, self.report)
        note_coordinates(self.segments, self.changes if "changes" in self.__dict__ else None, self.report)
        notes = tuple(dict.fromkeys((*first.notes, *self.report.diagnostics)))
        records = (*self.impacts, *(() if dynamics is None else dynamics.records))
        crossing = None if dynamics is None else dynamics.crossing
        ended, x = self.before_terminal or (None, outcome.x)
        planned = outcome.time if outcome.status.failed else self.task.span.end
        segments, begun = tuple(self.segments), self.begun
        unbooked = (np.inf, "") if dynamics is None else dynamics.stepping.unbooked
        return Trajectory(
            segments,
            self.variables,
            (outcome.time, x),
            stats,
            records,
            notes,
            crossing,
            begun,
            planned,
            unbooked,
            ended,
            self.start,
        )

    # ------------------------------------------------------------------ the start

    def _start(self, initial: Mapping[str, float] | End | RunState) -> np.ndarray:
        segment, report, span = self.segment, self.report, self.task.span
        plan, observer, system = segment.plan, segment.observer, segment.system
        signals = self.task.signals
        near = self.task.near
        states = first_states(observer, span.start, segment.base, initial, report, self.impacts, near)
        steps = bool(stepping_inputs(plan, signals))
        if plan.reduced.switched is None and plan.reduced.flat.events is None and not steps:
            x = states(segment.base)
        else:
            x = self._start_of_events(states, initial)
        report.check()
        system.prepare(self.segment.base, self.segment.observer.signals)
        check_start(self.segment, span.start, x, report)
        self.segment.recorder.record_start(self.segment.begin, x)
        if observer.flat.checks and self.task.options.solver not in (MOREAU, *WHOLE_RUN):
            from lmoc.numerics.failures.assertions import Assertions

            self.assertions = Assertions(observer.flat) or None
            if self.assertions is not None:
                self.monitors.add(self.assertions)
        return x

    # ------------------------------------------------------------------ events

    def _start_of_events(self, states: Callable[[np.ndarray], np.ndarray], initial: object) -> np.ndarray:
        """Return the states at the start of a run with events, after what happens there."""
        from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
        from lmoc.numerics.events.on_passages import happen_on

        task, segment = self.task, self.segment
        span = task.span.start, task.span.end
        self.dynamics = HybridDynamics(segment.plan, task.values, segment.base, task.signals, span, self.report)
        self.monitors.add(self.dynamics)
        self.changes.happens = partial(happen_on, self.dynamics)
        self.flood = Flood(task.span.end, self.dynamics.places, self.report, task.progress)

        def begun(base: np.ndarray) -> np.ndarray:
            x = states(base)
            unknowns = segment.plan.once(block_unknowns)
            self.dynamics.stand_at(unknowns, base[unknowns])
            self.begun = x.copy(), base.copy()
            return x

        going_on = isinstance(initial, End | RunState)
        kept: list[Begun] | None = None if task.occasions is None else []
        try:
            x = self.dynamics.start(states if going_on else begun, initial, task.near, kept)
        except Stopped as stopped:
            self.report.error("E0535", f"the start has no solution: {stopped.reason}", stopped.span, hint=stopped.hint)
            self.report.check()
        self.report.check()
        if kept:
            from lmoc.numerics.events.occasion import at_start

            task.occasions.append(at_start(self.dynamics, span[0], *kept[0], x))
        self._begin(task.span.start)
        return x

    def _begin(self, time: float) -> None:
        """Begin a segment with the values that hold now between events."""
        old, now = self.segment, self.dynamics
        observer = Observer(old.plan, self.task.values, now.base(), now.signals)
        self.segment = Segment(observer, old.system, time, self.task.span.times, old.reached, self.variables)
        self.segment.mode, self.segment.rounding = now.mode, now.rounding
        old.system.prepare(observer.base, now.signals)

    def _after(self, outcome: Outcome) -> np.ndarray | None:
        """Return the state after what has ended a segment, and begin the next one; None at the end of the run."""
        segment, time = self.segment, self.dynamics.instant(outcome)
        which = self.monitors.own(self.dynamics, outcome.roots)
        if time != outcome.time or which is not outcome.roots:
            outcome = replace(outcome, time=time, roots=which)
        try:
            self._stand_at(outcome)
            outcome = self.dynamics.together(outcome, segment.system)
            solver, failed = self.solver, outcome.status.failed
            occasion, told = None if failed else self._occasion(outcome), len(self.dynamics.records)
            x = None if failed else self.dynamics.after(outcome, solver.unresolved, solver.errors)
        except Stopped as stopped:
            self.ended, self.lost = stopped.status, stopped.reason
            if stopped.status is Status.OK:
                text = f"the model has ended the run at t = {time:.6g} s: {stopped.reason}"
                self.report.diagnostics.append(Diagnostic("N0552", text))
            return None
        if x is None:
            return None
        if occasion is not None:
            from lmoc.numerics.events.occasion import behind

            self.task.occasions[-1] = replace(occasion, behind=behind(self.dynamics, x, told))
        self.flood.count(time, self.dynamics.records)
        segment.recorder.take_back(time)
        check_values(segment, outcome, self.variables is None, self.report)
        self.segments.append(segment.record())
        if self.dynamics.is_over:
            self.before_terminal = self.segments[-1], outcome.x
        self._begin(time)
        self.segment.recorder.record_start(self.segment.begin, x)
        return x

    def _occasion(self, outcome: Outcome) -> Occasion | None:
        """Keep what is known before an instant, where somebody asks for it."""
        if self.task.occasions is None:
            return None
        from lmoc.numerics.events.occasion import Occasion

        solver, now = self.solver, self.dynamics
        kept = Occasion(len(self.segments), now, now.memory(), outcome, solver.errors, solver.unresolved)
        self.task.occasions.append(kept)
        return kept

    # ------------------------------------------------------------------ the way

    def _observer(self, continuation: Continuation | None, t: float, x: np.ndarray) -> Observer:
        """The observer of the segment, with the solutions of its blocks where it goes on.

        From those at its beginning Newton's method may come to another branch, where the segment is long.
        """
        segment = self.segment
        observer, watch = segment.observer, segment.watch
        if continuation is None:
            return observer
        if t > segment.begin:
            observer = standing(segment, t, x)
        if watch is None or not len(watch.unknowns):
            return observer
        base = with_solutions(observer.base, watch.unknowns, watch.accepted.solutions)
        return Observer(observer.plan, observer.values, base, observer.signals)

    def _integrate(self, x: np.ndarray, begin: float, continuation: Continuation | None = None) -> Outcome:
        """Integrate the current segment from a state to its end.

        Parameters
        ----------
        continuation : bounds the steps after a change of coordinates
        """
        task, now = self.task, self.dynamics
        if task.options.solver == MOREAU:
            return self._march(x, begin)
        watched = self.monitors
        end, roots = watched.until(task.span.end), watched.watch(self._observer(continuation, begin, x), begin, x)
        if watched.ended is not None:
            return Outcome(begin, x, 0, watched.ended)
        bounds = Bounds(begin, end, self.longest, roots, continuation=continuation)
        outcome = self.solver.at_once(self.segment, x, bounds)
        if outcome is not None:
            return outcome
        status = self._judge_the_beginning(begin, x)
        if status is not Status.OK:
            return Outcome(begin, x, 0, status)
        self._watch_loops(begin, x)
        if now is not None:
            bounds = replace(bounds, longest=min(self.longest, watched.longest_step), kept=now.kept)
        # what follows from the states is known less well than they are, where one choice after the other divides by it
        if self.segments and (self.segment.watch is not None or self._went_over):
            bounds = replace(bounds, finer=FINER)
        outcome = watched.after(self.solver(self.segment, x, bounds))
        if self.segment.loops is not None and outcome.status.failed:
            self.lost = self.segment.loops.why(outcome.status)
            if outcome.status is Status.SINGULAR and self._went_over:
                outcome.status = Status.COORDINATES
        return outcome

    def _march(self, x: np.ndarray, begin: float) -> Outcome:
        """Go to the end by steps of equal length, in which impulses of the laws take the place of events."""
        old, now = self.segment, self.dynamics
        observer = Observer(old.plan, self.task.values, now.open, self.task.signals)
        self.segment = Segment(observer, old.system, begin, self.task.span.times, old.first, self.variables)
        self.segment.recorder.record_start(self.segment.begin, x)
        old.system.prepare(observer.base, observer.signals)
        found = self.solver.march(self.segment, x, now.steps)
        now.records += found.steps.records
        return found.outcome

    @property
    def _went_over(self) -> bool:
        """Return whether the run has gone over to all coordinates of its loops."""
        return "changes" in self.__dict__ and self.changes.together is not None

    @cached_property
    def changes(self) -> Changes:
        """The changes of coordinates so far; most scenes have none, and do not import what they take."""
        from lmoc.numerics.run.changes import Changes

        return Changes(self.task, self.variables)

    def _judge_the_beginning(self, begin: float, x: np.ndarray) -> Status:
        """Judge the coordinates where the segment begins, if what they divide by changes along the motion."""
        segment = self.segment
        if segment.plan.reduced.constraints is None or segment.watch is not None or not len(x):
            return Status.OK
        return self.changes.watch_over(segment, begin, x, first=not self.segments)

    def _with_other_coordinates(self, outcome: Outcome) -> Outcome:
        """Go on from where the coordinates have ceased to be good."""
        loops = self.segment.loops
        if loops is not None:
            continuation = self.changes.apart(self.segment, outcome) if self._went_over and loops.is_near else None
            longest = loops.length() if continuation is None else np.inf
            if continuation is None and longest is not None:  # a step has led too far
                self.longest = min(longest, self._longest_step)
                return self._integrate(outcome.x, outcome.time)
            self.lost, self.longest = loops.reason, self._longest_step
        else:
            sizes = assumed_sizes(self.segment.plan, self.task.values, outcome.x, self.task.sizes)
            tolerance = self.tolerances.rtol * np.abs(outcome.x) + self.tolerances.absolute(self.segment, outcome.x)
            continuation = self.changes.onward(self.segment, outcome, np.maximum(FINER * tolerance, ROUNDING * sizes))
            self.lost = self.changes.reason
        if continuation is None:
            return replace(outcome, status=Status.SINGULAR)
        self.lost = ""
        if continuation.segment is not self.segment:
            self._finish(outcome)
            self.segments += continuation.between
            self.segment = continuation.segment
            if self.dynamics is not None:
                self._adopt(continuation)
            self.segment.system.prepare(self.segment.base, self.segment.observer.signals)
        return self._integrate(continuation.x, max(outcome.time, self.segment.begin), continuation)

    def _adopt(self, continuation: Continuation) -> None:
        """Have events and laws go on in the coordinates of a new segment."""
        task, now, made = self.task, self.dynamics, continuation.segment
        unknowns = made.plan.once(all_unknowns)
        base = with_solutions(made.plan.base(task.values, task.signals), unknowns, made.base[unknowns])
        now.adopt(made.plan, base, made.begin, continuation.x)
        observer = Observer(made.plan, task.values, now.base(), now.signals)
        self.segment = Segment(observer, made.system, made.begin, task.span.times, made.first, self.variables)
        self.segment.mode = now.mode

    def _stand_at(self, outcome: Outcome) -> None:
        """Let events and laws begin at the solutions of the nonlinear blocks where the segment has ended."""
        unknowns = self.segment.plan.once(block_unknowns)
        registers = registers_at_end(self.segment.system, outcome) if len(unknowns) else None
        if registers is not None:
            self.dynamics.stand_at(unknowns, registers[unknowns])
        self.dynamics.stand_at(*idle_solutions(self.segment, outcome.time, outcome.x))

    def _watch_loops(self, begin: float, x: np.ndarray) -> None:
        """Have the closures watched, in a formulation where all coordinates of the loops are states."""
        task, segment = self.task, self.segment
        if segment.loops is None and segment.plan.reduced.in_all_coordinates:
            from lmoc.numerics.formulations.watch import LoopWatch
            from lmoc.numerics.options.formulations import TABLE

            scale = assumed_sizes(segment.plan, task.values, x, task.sizes)
            wanted = task.options.requested.form
            form = TABLE["projected"] if wanted.name == "auto" else wanted
            segment.loops = LoopWatch(segment.observer, scale, form, task.span)
            segment.loops.begin(begin, x)

    def _finish(self, outcome: Outcome) -> None:
        """Close the segment under way; one without extent leaves nothing behind."""
        if not outcome.status.failed:
            check_values(self.segment, outcome, self.variables is None, self.report)
        record = self.segment.record(outcome)
        if len(record.time) or outcome.time > record.begin or outcome.status is not Status.COORDINATES:
            self.segments.append(record)
