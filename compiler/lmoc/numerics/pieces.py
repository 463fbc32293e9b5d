"""One run as a sequence of pieces: start, integrate, change over, integrate, … until its end.

A piece has one reduction and one system. What ends it before the end of the run (other coordinates are better, a root)
says what the next one is; states pass from one to the next by the variables they stand for.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, RunInterrupted, SimulationError
from lmoc.numerics.coordinates.change import (
    Place,
    all_unknowns,
    block_unknowns,
    continued,
    registers_at,
    with_solutions,
)
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.failures.chatter import FRICTION_HINT, Jump, chatters, jumps
from lmoc.numerics.failures.checks import run_checks
from lmoc.numerics.failures.diagnosis import fastest, first_not_finite, lost_ahead, moving_risks, suspects, unsolved
from lmoc.numerics.integrate import choice
from lmoc.numerics.integrate.base import Outcome, Problem
from lmoc.numerics.integrate.standing import standing
from lmoc.numerics.integrate.status import Status, Stopped
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.observer import Observer, find
from lmoc.numerics.observe.recorder import kept_variables
from lmoc.numerics.observe.trajectory import End, Piece, Trajectory
from lmoc.numerics.options import MOREAU
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals import kinks
from lmoc.numerics.signals.activity import Lookout, lookout
from lmoc.numerics.signals.signals import break_times
from lmoc.numerics.sizes import assumed_sizes
from lmoc.numerics.start.initialization import initial_state, seed_blocks
from lmoc.numerics.start.singular import StartSingular
from lmoc.numerics.start.targets import targets
from lmoc.numerics.task import Cost, Stretch, Task
from lmoc.support.distinct import distinct

if TYPE_CHECKING:
    from lmoc.numerics.coordinates.changes import Changes, Way
    from lmoc.numerics.events.happenings import Happenings
    from lmoc.numerics.formulations.watch import LoopWatch

_FINER = 0.1  # factor on the tolerances of pieces behind a change of coordinates
_SAME = 1e-14  # of the time: roots behind a jump are found a few digits of the last place behind it
_NO_TIME = 1e-15  # of the time: a shorter piece is too short for the solvers, and nothing moves in it
_FINEST = 1e-14  # relative tolerance


def run_pieces(
    task: Task, plan: Plan, system: System, base: np.ndarray, initial: Mapping[str, float] | End | Place
) -> Trajectory:
    """Run from the start to the end.

    Parameters
    ----------
    plan, system, base : of the first piece; base as from `Plan.base`
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
) -> Place:
    """Return where a run would start. Parameters and errors as of `run_pieces`."""
    run = _Run(task, plan, system, base)
    x = run._start(initial)
    return Place(run.stretch.observer, registers_at(run.stretch.observer, system, task.span.start, x))


class _Run:
    """One run on its way."""

    def __init__(self, task: Task, plan: Plan, system: System, base: np.ndarray) -> None:
        self.task, self.report = task, task.report
        options, span = task.options, task.span
        observer = Observer(plan, task.values, base, task.signals)
        ledger = _ledger_names(observer) if options.energy else ()
        keep = None if options.keep is None else (*options.keep, *ledger)
        self.variables = None if keep is None else kept_variables(observer.flat, keep)
        self.rtol = options.tolerance(observer.flat.experiment)
        self.deadline = None if options.max_seconds is None else clock.monotonic() + options.max_seconds
        self.progress = None if task.progress is None else lambda t: task.progress(t, span.end)
        self.stretch = Stretch(observer, system, span.start, span.times, 0, self.variables)
        self.pieces: list[Piece] = []
        self.ended: Status | None = None  # an event has ended the run
        self.cost = Cost()
        self.longest = np.inf if options.max_step is None else options.max_step
        self.lost = ""  # why the run cannot go on, where that is known better than from its status
        self.happenings: Happenings | None = None
        self.impacts: list[Event] = []  # of velocities that contradict each other at the start
        self.tolerances: tuple[Plan, np.ndarray] | None = None
        self.lookout: Lookout | None = None

    def go(self, initial: Mapping[str, float] | End | Place) -> Trajectory:
        began, lowered = self.task.clock
        x = self._start(initial)
        started = clock.perf_counter()
        outcome = self._integrate(x, self.stretch.begin)
        while True:
            if outcome.status is Status.COORDINATES:
                outcome = self._with_other_coordinates(outcome)
                continue
            if self.happenings is None or outcome.status.failed:
                break
            try:
                x = self._behind(outcome)
            except KeyboardInterrupt:
                self.ended = Status.INTERRUPTED
                break
            if x is None:
                break
            outcome = self._integrate(x, self.stretch.begin)
        if self.ended is not None:
            outcome = replace(outcome, status=self.ended)
        self._finish(outcome)
        stats = self.cost.stats | {
            "seconds": clock.perf_counter() - began,
            "lower_seconds": lowered - began,
            "start_seconds": started - lowered,
            "states": self.pieces[0].observer.plan.state_count,
            "rtol": self.rtol,
        }
        if self.stretch.loops is not None:
            stats |= self.stretch.loops.stats
        self._note_changes()
        notes = tuple(dict.fromkeys((*self.pieces[0].observer.plan.notes, *self.report.diagnostics)))
        last = outcome.time, outcome.x
        crossing = None if self.happenings is None else self.happenings.crossing
        run = Trajectory(tuple(self.pieces), self.variables, last, stats, self._records(), notes, crossing)
        if outcome.status.failed:
            failure = RunInterrupted if outcome.status is Status.INTERRUPTED else SimulationError
            raise failure(self._explain(outcome), outcome.time, run)
        return run_checks(run)

    # ------------------------------------------------------------------ the start

    def _start(self, initial: Mapping[str, float] | End | Place) -> np.ndarray:
        stretch, report, span = self.stretch, self.report, self.task.span
        plan, observer, system = stretch.plan, stretch.observer, stretch.system
        signals = self.task.signals
        if isinstance(initial, Place):
            states = partial(initial.states, plan)
        elif isinstance(initial, End):
            states = partial(continued, plan, initial)
        else:
            wanted = targets(observer.flat, observer.values, initial, report)
            report.check()
            seed_blocks(plan, stretch.base, wanted)

            def states(base: np.ndarray) -> np.ndarray:
                return initial_state(plan, base, signals, observer.values, span.start, wanted, report, self.impacts)

        if plan.reduced.switched is None and plan.reduced.flat.events is None:
            x = states(stretch.base)
        else:
            x = self._start_of_events(states, initial)
        report.check()
        system.prepare(self.stretch.base, self.stretch.observer.signals)
        self._check_start(x)
        self._record_start(x)
        return x

    def _record_start(self, x: np.ndarray) -> None:
        """Keep the state where a piece begins, if that is asked for: at an event, the one behind it."""
        recorder, begin = self.stretch.recorder, self.stretch.begin
        if len(recorder.times) and _is_same(recorder.times[0], begin):
            recorder(0, x[None])

    # ------------------------------------------------------------------ events

    def _start_of_events(self, states: Callable[[np.ndarray], np.ndarray], initial: object) -> np.ndarray:
        """The states at the start of a run with events, behind what happens there."""
        from lmoc.numerics.events.happenings import Happenings

        task, stretch = self.task, self.stretch
        span = task.span.start, task.span.end
        self.changes.passes = False
        self.happenings = Happenings(stretch.plan, task.values, stretch.base, task.signals, span, self.report)
        try:
            x = self.happenings.start(states, initial)
        except Stopped as stopped:
            self.report.error("E0535", f"the start has no solution: {stopped.reason}")
            self.report.check()
        self.report.check()
        self._begin(task.span.start)
        return x

    def _begin(self, time: float) -> None:
        """Begin a piece with the values that hold now between events."""
        old, now = self.stretch, self.happenings
        observer = Observer(old.plan, self.task.values, now.base(), now.signals)
        self.stretch = Stretch(observer, old.system, time, self.task.span.times, old.reached, self.variables)
        self.stretch.mode, self.stretch.rounding = now.mode, now.rounding
        old.system.prepare(observer.base, now.signals)

    def _behind(self, outcome: Outcome) -> np.ndarray | None:
        """Return the state behind what has ended a piece, and begin the next one; None at the end of the run."""
        stretch, time = self.stretch, outcome.time
        try:
            self._stand_at(outcome)
            x = None if outcome.status.failed else self.happenings.after(outcome)
        except Stopped as stopped:
            self.ended, self.lost = stopped.status, stopped.reason
            if stopped.status is Status.OK:
                told = f"the model has ended the run at t = {time:.6g} s: {stopped.reason}"
                self.report.diagnostics.append(Diagnostic("N0552", told))
            return None
        if x is None:
            return None
        recorder = stretch.recorder
        if recorder.reached and _is_same(recorder.times[recorder.reached - 1], time):
            recorder.reached -= 1  # the value at an event is the one behind it
        self.pieces.append(stretch.piece())
        self._begin(time)
        self._record_start(x)
        return x

    def _records(self) -> tuple[Event, ...]:
        return (*self.impacts, *(() if self.happenings is None else self.happenings.records))

    def _check_start(self, x: np.ndarray) -> None:
        """All derivatives must be finite at the start, else the run says what is not.

        Equations that no derivative needs must have a solution too; of their other values those that are not finite
        are only warned of, since the motion does not depend on them.
        """
        stretch, time, hint = self.stretch, self.task.span.start, "look at the start values, and at divisions by zero"
        derivative = np.empty(len(x))
        stretch.system.rhs(time, x, derivative)
        needed = not (np.isfinite(derivative).all() and np.isfinite(x).all())
        program = None if needed else stretch.plan.full_program
        near = stretch.system.registers
        found, span, nonlinear = first_not_finite(stretch.observer, time, x, program, near, near is not None)
        if needed or nonlinear:
            self.report.error("E0535", f"{found} at the start", span, hint=hint)
            raise StartSingular(self.report.diagnostics, stretch.plan.reduced.state_names, span)
        elif found:
            self.report.warning("W0537", f"{found} at the start", span, hint=hint)

    # ------------------------------------------------------------------ the way

    def _integrate(self, x: np.ndarray, begin: float, way: Way | None = None) -> Outcome:
        """Integrate the piece under way, from a state to its end.

        Parameters
        ----------
        way : bounds the steps, where the run has been told how to go on
        """
        stretch, span = self.stretch, self.task.span
        recorder, options = stretch.recorder, self.task.options
        now = self.happenings
        end = span.end if now is None else now.until
        done = recorder.reached
        times = recorder.times[done : np.searchsorted(recorder.times, end, "right")]
        if options.solver == MOREAU:
            return self._march(x, begin)
        roots = None if now is None else now.roots(begin, x)
        if not len(x) and roots is None:
            recorder(done, np.zeros((len(times), 0)))
            return self.cost.add(Outcome(end, x, len(times)), stretch.system, "none", "no states")
        if begin == end:
            return self.cost.add(Outcome(begin, x, 0), stretch.system, "none", "only the start")
        if end - begin <= _NO_TIME * max(abs(begin), abs(end)):
            recorder(done, np.tile(x, (len(times), 1)))
            return self.cost.add(Outcome(end, x, len(times)), stretch.system, "none", "only an instant")
        status = self._judge_the_beginning(begin, x)
        if status is not Status.OK:
            return Outcome(begin, x, 0, status)
        whole = span.start, span.end
        self.lookout = lookout(stretch.plan, stretch.base, self.task.signals, whole, self.lookout)
        self._watch_loops(begin, x)

        def sink(first: int, states: np.ndarray) -> None:
            recorder(first + done, states if stretch.loops is None else stretch.loops.output(times[first:], states))

        # what follows from the states is known less well than they are, where one choice after the other divides by it
        finer = _FINER if stretch.watch is not None and self.pieces else 1.0
        problem = Problem(
            stretch.system,
            begin,
            x,
            end,
            times,
            max(self.rtol * finer, _FINEST),
            self._atol(x) * finer,
            sink,
            max_step=self.longest if now is None else min(self.longest, now.longest_step),
            max_steps=min(options.max_steps, options.requested.form.most_steps),
            deadline=self.deadline,
            progress=self.progress,
            lookout=self.lookout if way is None else way.bounded(self.lookout),
            breaks=self._breaks(begin, end),
            guard=stretch.watch or stretch.loops,
            roots=roots,
            correction=None if stretch.loops is None else stretch.loops.correction,
            index_one=None if stretch.loops is None else stretch.loops.index_one,
            held=self._held if self._jumps else None,
            step=options.step_length(span),
        )
        if not len(x):
            return self.cost.add(standing(problem), stretch.system, "none", "no states")
        implicit = problem.index_one is not None
        outcome, method = choice.run(problem, "ida" if implicit else options.solver)
        if implicit:
            method["reason"] = f"for formulation {options.formulation}"
        if stretch.loops is not None and outcome.status.failed:
            self.lost = stretch.loops.why(outcome.status)
        stretch.largest = None if roots is None else roots.largest
        return self.cost.add(outcome, stretch.system, method["solver"], method["reason"])

    def _breaks(self, begin: float, end: float) -> np.ndarray:
        """Return the times at which formulas of time and given signals have kinks or jumps."""
        stretch = self.stretch
        own = kinks.break_times(stretch.plan, stretch.base, begin, end)
        if len(own) == kinks.MOST:
            self.report.warning("W0526", f"the formulas of time have kinks or jumps behind t = {own[-1]:g} s, too")
        given = break_times(self.task.signals, begin, end, kinks.MOST // 10)
        return distinct(np.concatenate([own, given]))

    def _march(self, x: np.ndarray, begin: float) -> Outcome:
        """Go to the end by steps of equal length, in which the laws' impulses take the place of events."""
        old, options, span = self.stretch, self.task.options, self.task.span
        observer = Observer(old.plan, self.task.values, self.happenings.open, self.task.signals)
        self.stretch = stretch = Stretch(observer, old.system, begin, span.times, old.first, self.variables)
        self._record_start(x)
        old.system.prepare(observer.base, observer.signals)
        recorder, steps = stretch.recorder, self.happenings.steps()
        done = recorder.reached
        problem = Problem(
            stretch.system,
            begin,
            x,
            span.end,
            recorder.times[done:],
            self.rtol,
            np.zeros(len(x)),
            lambda first, states: recorder(first + done, states),
            deadline=self.deadline,
            progress=self.progress,
            step=options.step_length(span),
        )
        outcome = steps.march(problem)
        self.happenings.records += steps.records
        return self.cost.add(outcome, stretch.system, MOREAU, "asked for")

    @cached_property
    def _jumps(self) -> tuple[Jump, ...]:
        return jumps(self.stretch.observer.flat)

    def _chatter(self, t: float, x: np.ndarray) -> str:
        """Describe the jump of an equation that keeps the motion at a place; empty where none does."""
        stretch, span = self.stretch, self.task.span
        return chatters(self._jumps, stretch.observer, stretch.system, (t, x), span.end - span.start)

    def _held(self, t: float, x: np.ndarray) -> bool:
        return bool(self._chatter(t, x))

    @cached_property
    def changes(self) -> Changes:
        """The changes of coordinates so far; most scenes have none, and do not import what they take."""
        from lmoc.numerics.coordinates.changes import Changes

        return Changes(self.task, self.variables)

    def _judge_the_beginning(self, begin: float, x: np.ndarray) -> Status:
        """Judge the coordinates where the piece begins, if what they divide by changes along the motion."""
        stretch = self.stretch
        if stretch.plan.reduced.constraints is None or stretch.watch is not None or not len(x):
            return Status.OK
        from lmoc.numerics.coordinates.changes import singular_start
        from lmoc.numerics.coordinates.watch import CoordinateWatch

        stretch.watch = CoordinateWatch(stretch.system, stretch.base)
        self.changes.bar(stretch)
        status = stretch.watch.begin(begin, x)
        if status is not Status.OK and not self.pieces:
            raise singular_start(stretch, self.report)
        return status

    def _with_other_coordinates(self, outcome: Outcome) -> Outcome:
        """Go on from where the coordinates have ceased to be good."""
        if self.stretch.loops is not None:
            return self._in_shorter_steps(self.stretch.loops, outcome)
        rtol, atol = self.rtol * _FINER, self._atol(outcome.x) * _FINER
        way = self.changes.onward(self.stretch, outcome, rtol * np.abs(outcome.x) + atol)
        if way is None:
            self.lost = self.changes.reason
            return replace(outcome, status=Status.SINGULAR)
        if way.stretch is not self.stretch:
            self._finish(outcome)
            self.pieces += way.between
            self.stretch = way.stretch
            if self.happenings is not None:
                self._adopt(way)
            self.stretch.system.prepare(self.stretch.base, self.stretch.observer.signals)
        return self._integrate(way.x, max(outcome.time, self.stretch.begin), way)

    def _adopt(self, way: Way) -> None:
        """Have events and laws go on in the coordinates of a new piece."""
        task, now, made = self.task, self.happenings, way.stretch
        unknowns = all_unknowns(made.plan)
        base = with_solutions(made.plan.base(task.values, task.signals), unknowns, made.base[unknowns])
        now.adopt(made.plan, base, made.begin, way.x)
        observer = Observer(made.plan, task.values, now.base(), now.signals)
        self.stretch = Stretch(observer, made.system, made.begin, task.span.times, made.first, self.variables)
        self.stretch.mode = now.mode

    def _stand_at(self, outcome: Outcome) -> None:
        """Let events and laws begin at the solutions of the nonlinear blocks where the piece has ended."""
        unknowns, system = self.stretch.plan.once(block_unknowns), self.stretch.system
        if len(unknowns) and self._registers(outcome) is not None:
            self.happenings.stand_at(unknowns, system.registers[unknowns])

    def _atol(self, x: np.ndarray) -> np.ndarray:
        """(n,) the absolute tolerances of the coordinates in use, from where these came into use."""
        if self.tolerances is None or self.tolerances[0] is not self.stretch.plan:
            self.tolerances = self.stretch.plan, self._absolute_tolerances(x)
        return self.tolerances[1]

    def _watch_loops(self, begin: float, x: np.ndarray) -> None:
        """Have the closures watched, in a formulation where all coordinates of the loops are states."""
        task, stretch = self.task, self.stretch
        if stretch.loops is None and stretch.plan.reduced.in_all_coordinates:
            from lmoc.numerics.formulations.watch import LoopWatch

            scale = assumed_sizes(stretch.plan, task.values, x, task.sizes)
            stretch.loops = LoopWatch(stretch.observer, scale, task.options.requested.form, task.span)
            stretch.loops.begin(begin, x)

    def _in_shorter_steps(self, loops: LoopWatch, outcome: Outcome) -> Outcome:
        """Go on from before a step that has led too far where closures nearly depend on each other."""
        longest = loops.length()
        if longest is None:
            self.lost = loops.reason
            return replace(outcome, status=Status.SINGULAR)
        self.longest = min(longest, np.inf if self.task.options.max_step is None else self.task.options.max_step)
        return self._integrate(outcome.x, outcome.time)

    def _absolute_tolerances(self, x: np.ndarray) -> np.ndarray:
        """(n,); those of the ledger are no finer than what the scene holds at the start has to be known."""
        plan, atol, rtol = self.stretch.plan, self.task.options.atol, self.rtol
        if atol is not None:
            result = np.full(len(x), atol, float)
        else:
            result = rtol * 1e-3 * assumed_sizes(plan, self.task.values, x, self.task.sizes)
        if plan.ledger.any():
            observer, begin = self.stretch.observer, np.array([self.stretch.begin])
            stored = observer(find(observer.flat, "ledger.stored"), begin, x[None])
            result[plan.ledger] = np.fmax(result[plan.ledger], rtol * np.abs(stored[0]))
        return result

    def _check_way(self, outcome: Outcome) -> None:
        """Values that the motion does not depend on may be lost on the way, as a square root: the run tells it."""
        stretch, recorder = self.stretch, self.stretch.recorder
        times, _ = recorder.taken()
        if any(d.code == "W0537" for d in self.report.diagnostics) or not len(times):
            return
        rows = np.zeros(0, int)
        if self.variables is None:
            rows = suspects(stretch.observer, times, recorder.table)
        if stretch.plan.once(moving_risks).others or self.variables is not None:
            rows = np.append(rows, len(times) - 1)
        for k in rows.tolist():
            time, near = float(times[k]), None
            if k == len(times) - 1:
                time, x, near = outcome.time, outcome.x, self._registers(outcome)
            else:
                x = recorder.table[k]
            known, program = near is not None, stretch.plan.full_program
            found, span, nonlinear = first_not_finite(stretch.observer, time, x, program, near, known)
            if found and not nonlinear:  # nonlinear equations are solved along the way, not from their start
                self.report.warning("W0537", f"{found} at t = {times[k]:g} s", span)
                return

        found = unsolved(stretch.observer, *recorder.sampled())
        if found is not None:
            sentence, span, time = found  # type: ignore[str-unpack]
            self.report.warning("W0537", f"{sentence} at t = {time:g} s", span)

    def _registers(self, outcome: Outcome) -> np.ndarray | None:
        """The registers at the end, where the system keeps them."""
        system, rate = self.stretch.system, np.empty(len(outcome.x))
        if system.registers is None:
            return None
        count = system.evaluations
        system.rhs(outcome.time, outcome.x, rate)
        system.evaluations = count
        return system.registers if np.isfinite(rate).all() else None

    def _finish(self, outcome: Outcome) -> None:
        """Close the piece under way; one without extent leaves nothing behind."""
        if not outcome.status.failed:
            self._check_way(outcome)
        piece = self.stretch.piece(outcome)
        if len(piece.time) or outcome.time > piece.begin or outcome.status is not Status.COORDINATES:
            self.pieces.append(piece)

    def _note_changes(self) -> None:
        """Say how often coordinates have changed, and between which."""
        names = [tuple(p.coordinates) for p in self.pieces]
        changes = sum(a != b for a, b in pairwise(names))
        if changes:
            sets = "; ".join(", ".join(n) for n in dict.fromkeys(names))
            often = "once" if changes == 1 else f"{changes} times"
            self.report.note("N0632", f"coordinates changed {often}, between {sets}")
            self.cost.stats["coordinate_changes"] = changes
        passed = self.changes.passed if "changes" in self.__dict__ else []
        if passed:
            often = "a singular position was" if len(passed) == 1 else f"{len(passed)} singular positions were"
            first = f"at t = {passed[0]:.6g} s" if len(passed) == 1 else f"the first at t = {passed[0]:.6g} s"
            self.report.note("N0633", f"{often} passed, {first}: the motion goes on with continuous velocities")

    def _explain(self, outcome: Outcome) -> str:
        stretch, end = self.stretch, self.task.span.end
        found = ""
        if outcome.status in (Status.CHATTERING, Status.COLLAPSED, Status.TOO_MANY_STEPS) and self._jumps:
            told = "" if self.lost else self._chatter(outcome.time, outcome.x)
            self.lost = f"{told} ({FRICTION_HINT})" if told else self.lost
        if outcome.status in (Status.NOT_FINITE, Status.COLLAPSED) and not self.lost:
            found = lost_ahead(stretch.observer, stretch.system, outcome.time, outcome.x, end)
        if not found and outcome.status is Status.COLLAPSED and self.tolerances is not None and not self.lost:
            sizes, span = self.tolerances[1] / self.rtol, end - self.task.span.start
            found = fastest(stretch.observer, stretch.system, outcome.time, outcome.x, sizes, span)
        detail = f": {found}" if found else ""
        return f"the run stopped at t = {outcome.time:.6g} s of {end:g} s: {self.lost or outcome.status.value}{detail}"



def _is_same(time: float, event: float) -> bool:
    """Return whether an output time is that of an event."""
    return 0 <= event - time <= _SAME * abs(event)


def _ledger_names(observer: Observer) -> tuple[str, ...]:
    names = ("ledger.stored", "ledger.work", "ledger.heat")
    return names if all(observer.flat.find(n) is not None for n in names) else ()
