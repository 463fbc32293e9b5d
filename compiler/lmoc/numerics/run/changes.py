"""Leaving coordinates that have become bad: for better ones, by shorter steps, or with the end of the run."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from heapq import merge

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.coordinates.change import carried_over, registers_at, with_solutions
from lmoc.numerics.coordinates.passage import Passage, passage
from lmoc.numerics.coordinates.watch import CoordinateWatch
from lmoc.numerics.limits import PACE
from lmoc.numerics.observe.observer import Aside, Observer, Path
from lmoc.numerics.observe.trajectory import SegmentRecord
from lmoc.numerics.options.formulations import STEPPED_IN_C
from lmoc.numerics.plan.activity import Lookout
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System
from lmoc.numerics.run.branches import standing
from lmoc.numerics.start.singular import BESIDE, StartSingular, starts_singular
from lmoc.numerics.task.task import Segment, Task
from lmoc.support.records import dataclass

_OFTEN = 3  # changes of coordinates after which …
_AHEAD = 8  # … all are integrated where so many more lie ahead, which cost about as much as the way to all, …
_FAR = 0.1  # … and the smallest singular value of the constraints is no smaller, so that steps in C can begin there
_WIDER = 2.0  # by which the smallest singular value must be larger with other constraints left out
_NEARER = 3.0  # by which it must be smaller for that to be tried again
_MANY = 100  # continuations after which it is judged whether they get on
BUSY = (
    "a singular position lies ahead, in which the constraints depend on each other and branches of the motion meet; "
    "the motion cannot be followed over it, since a law or an event changes it just there"
)
AHEAD = (
    "a singular position lies ahead, in which the constraints depend on each other: several branches of the motion may "
    "meet there, none of which continues it smoothly, and no coordinates determine {lost}"
)


class ShortSteps(Lookout):
    """Bounds the steps on the way to a place, and beyond it as another lookout does."""

    def __init__(self, beyond: Lookout, until: float, longest: float) -> None:
        super().__init__()
        self._beyond, self._until, self._longest = beyond, until, longest

    @property
    def is_known(self) -> bool:
        """Return whether everything has been looked at."""
        return self._beyond.is_known

    @property
    def is_free(self) -> bool:
        """Return whether nothing bounds the steps."""
        return False

    def edges(self, begin: float, end: float) -> Iterator[float]:
        """Yield the times between two where other bounds begin."""
        own = [self._until] if begin < self._until < end else []
        yield from merge(own, self._beyond.edges(begin, end))

    def longest(self, begin: float, end: float) -> float:
        """Return the longest step between two edges."""
        bound = self._longest if (begin + end) / 2 < self._until else np.inf
        return min(bound, self._beyond.longest(begin, end))


@dataclass(frozen=True, eq=False)
class Continuation:
    """The continuation of a run.

    Attributes
    ----------
    segment : the segment under way, or a new one
    x : (n,) its state
    until, longest : s, up to when the steps are no longer than that
    between : what lies between the segment that has been under way and a new one
    """

    segment: Segment
    x: np.ndarray
    until: float = -np.inf
    longest: float = np.inf
    between: tuple[SegmentRecord, ...] = ()

    def bounded(self, lookout: Lookout) -> Lookout:
        """Return what bounds the steps."""
        return lookout if self.until == -np.inf else ShortSteps(lookout, self.until, self.longest)


class Changes:
    """The choices of coordinates that one run has tried.

    Attributes
    ----------
    reason : why it cannot go on
    happens : whether a law or an event does on a passage; None in a run without any
    passed : s, the times at which it has passed a place where the constraints depend on each other
    together : s, when it has gone over to all coordinates of the loops; None where it has not
    returned : s, when it has come back from them; None where it has not
    """

    def __init__(self, task: Task, variables: np.ndarray | None) -> None:
        self.task, self.variables, self.reason = task, variables, ""
        self.happens: Callable[[Passage, np.ndarray], bool] | None = None
        self.passed: list[float] = []
        self.together: float | None = None
        self.returned: float | None = None
        self._watch: CoordinateWatch | None = None  # over the last choice of coordinates
        self._minimal: tuple[Plan, System] | None = None  # what it has been in before
        self._times: list[float] = []  # of changes of coordinates
        self._tried: set[tuple[float, tuple[str, ...]]] = set()  # coordinates, and since when
        self._refused: set[int] = set()  # flat variables that cannot be states
        self._in_vain = -np.inf, 0.0  # s, up to when no other constraints were better left out; smallest singular value
        self._busy = False  # whether something happens on the last passage found
        self._stalled, self._stalled_at = 0, -np.inf  # how often it has not come on, and from where
        self._continued: deque[float] = deque(maxlen=_MANY)  # s, where it has gone on in another way

    def watch_over(self, segment: Segment, t: float, x: np.ndarray, first: bool) -> Status:
        """Watch the coordinates of a segment from its beginning; return how they are judged there.

        Parameters
        ----------
        t, x : s, (n,)
        first : whether the run begins there

        Raises
        ------
        StartSingular
            The run begins where nothing tells how it goes on.
        """
        segment.watch = watch = CoordinateWatch(segment.system, segment.base)
        if self._watch is not None:
            watch.inherit(self._watch)
        self._watch = watch
        watch.bar(self._refused)
        status = watch.begin(t, x)
        if status is not Status.OK and first and not watch.determines:
            raise _singular_start(segment, self.task.report)
        return status

    def onward(self, segment: Segment, outcome: Outcome, tolerance: np.ndarray) -> Continuation | None:
        """Return how to go on from where an integration has ended; None where no coordinates serve.

        Parameters
        ----------
        tolerance : (n,) of the state
        """
        watch, t = segment.watch, outcome.time
        self._stalled = self._stalled + 1 if t == self._stalled_at else 0
        self._stalled_at = t
        watch.go_back()
        if self._hardly_gets_on(t):
            self._nowhere(segment, in_vain=True)
            return None
        if watch.lost_rank:
            continuation = self._leaving_out_others(segment, outcome) or self._beyond(segment, tolerance)
        else:
            continuation = self._changed(segment, outcome)
        if continuation is not None:
            return continuation
        if not (watch.lost_rank or watch.judge.passed()):
            watch.judge.tolerate()
            return Continuation(segment, outcome.x)
        longest, until = watch.judge.shorter(self._stalled, self.task.span.end - self.task.span.start)
        if longest > 0.0:
            return Continuation(segment, outcome.x, until, longest)
        self._nowhere(segment)
        return None

    def apart(self, segment: Segment, outcome: Outcome) -> Continuation | None:
        """A segment in few coordinates again; None where the run has been in all coordinates from its start."""
        self.returned = outcome.time
        return None if self._minimal is None else self._begun(segment, outcome, *self._minimal)

    def _hardly_gets_on(self, t: float) -> bool:
        """Return whether the last continuations have hardly come on."""
        self._continued.append(t)
        many = len(self._continued) == _MANY
        return many and t - self._continued[0] < _MANY * PACE * (self.task.span.end - self._continued[0])

    def _all_together(self, segment: Segment, outcome: Outcome) -> Continuation | None:
        """A segment in all coordinates of the loops, where they change too often; once in a run.

        A change costs as much as hundreds of steps in C, and each one restarts the integration.
        """
        task, t = self.task, outcome.time
        span, requested = task.span, task.options.requested
        self._times += [t] * (t not in self._times)
        if self.together is not None or len(self._times) < _OFTEN or self.happens is not None or self.passed:
            return None
        ahead = (len(self._times) - 1) * (span.end - t) / (t - self._times[0])
        suits = requested.form.name == "auto" and task.options.solver in STEPPED_IN_C
        if ahead < _AHEAD or segment.watch.margin < _FAR or not suits or task.others is None:
            return None
        made = task.others.of_loops(segment.observer.signals, task.options.energy)
        continuation = None if made is None else self._begun(segment, outcome, *made)
        if continuation is not None:
            self._minimal, self.together = (segment.plan, segment.system), t
        return continuation

    def _leaving_out_others(self, segment: Segment, outcome: Outcome) -> Continuation | None:
        """A new segment in which other constraints are the redundant ones; None where that is no better.

        What is left of them may lose its rank at a place where all together do not.
        """
        task, watch, reduced = self.task, segment.watch, segment.plan.reduced
        if task.others is None or not reduced.left_out or self.happens is not None:
            return None
        until, margin = self._in_vain
        if watch.accepted.t <= until and watch.margin > margin / _NEARER:
            return None
        place, own = watch.accepted, reduced.constraints.variable
        values = segment.observer(own, np.array([place.t]), place.x[None])[0]
        at = {reduced.flat.variable_name(v): x for v, x in zip(own.tolist(), values.tolist(), strict=True)}
        signals, own_margin = segment.observer.signals, _margin(segment.system, segment.base, place.t, place.x)
        for plan, system in task.others.leaving_out_others(reduced, at, signals, task.options.energy):
            continuation = self._begun(segment, outcome, plan, system)
            if continuation is None or plan.reduced.constraints is None:
                continue
            system.prepare(continuation.segment.base, signals)
            if _margin(system, continuation.segment.base, place.t, continuation.x) > _WIDER * own_margin:
                return continuation
        self._in_vain = 2 * watch.singular - place.t, watch.margin
        watch.go_back()
        return None

    def _beyond(self, segment: Segment, tolerance: np.ndarray) -> Continuation | None:
        """A new segment behind a place where the constraints depend on each other; None where none is found.

        Output times in between become segments of their own, each with the solutions of its blocks.
        """
        watch, end = segment.watch, self.task.span.end
        place, width = watch.accepted, 2 * (watch.singular - watch.accepted.t)
        found = None
        if 0 < width < end - self.task.span.start:
            found = passage(segment.system, (place.t, place.x, place.solutions), width, tolerance)
        busy = found is not None and self.happens is not None and self.happens(found, watch.unknowns)
        self._busy = busy or (self._busy and found is None)  # nearer, rounding may hide it
        if found is None or busy:
            watch.go_back()
            return None
        singular = watch.singular_within(found)
        if singular is not None:
            self.passed.append(singular)
        watch.go_back()
        begin = min(float(found.times[-1]), end)
        between = self._standing(segment, place.t, found.solutions[0], segment.reached)
        ahead = between.recorder.times
        times = ahead[ahead < begin] if begin < end else ahead  # no other segment follows the last one
        states, solutions = found.at(times)
        aside = None if singular is None else Aside(singular, found.width, found.at)
        between.observer.path = Path(times, states, watch.unknowns, solutions, aside)
        if len(times):
            between.recorder(0, states)
        states, solutions = found.at(np.array([begin]))
        made = self._standing(segment, begin, solutions[0], between.reached)
        return Continuation(made, states[0], between=(between.record(),) if len(times) else ())

    def _standing(self, segment: Segment, time: float, solutions: np.ndarray, first: int) -> Segment:
        """A segment that begins with these solutions of the blocks."""
        place = segment.watch.accepted
        old, task = standing(segment, place.t, place.x), self.task
        base = with_solutions(old.base, segment.watch.unknowns, solutions)
        observer = Observer(old.plan, old.values, base, old.signals)
        made = Segment(observer, segment.system, time, task.span.times, first, self.variables)
        made.mode = segment.mode
        return made

    def _changed(self, segment: Segment, outcome: Outcome) -> Continuation | None:
        """A new segment with better coordinates, or with all of them; None where there are no better ones."""
        continuation = self._all_together(segment, outcome)
        if continuation is not None:
            return continuation
        for variables, names in self._candidates(segment):
            key = outcome.time, tuple(sorted(names))
            if key in self._tried:  # it has begun here with them already
                continue
            self._tried.add(key)
            others, energy = self.task.others, self.task.options.energy
            made = None if others is None else others.system(names, segment.observer.signals, energy)
            continuation = None if made is None else self._begun(segment, outcome, *made)
            if continuation is not None:
                return continuation
            own = segment.plan.reduced.constraints
            self._refused |= variables - set(own.variable[own.rows :].tolist())
        return None

    def _candidates(self, segment: Segment) -> Iterator[tuple[set[int], list[str]]]:
        reduced = segment.plan.reduced
        segment.watch.bar(self._refused)
        for columns in segment.watch.better():
            variables = reduced.constraints.variable[columns].tolist()
            yield set(variables), [reduced.flat.variable_name(v) for v in variables]

    def _begun(self, segment: Segment, outcome: Outcome, plan: Plan, system: System) -> Continuation | None:
        """A segment with another system; None where its states are not known at the place."""
        task, old = self.task, standing(segment, outcome.time, outcome.x)
        w = registers_at(old, segment.system, outcome.time, outcome.x)
        base = plan.base(task.values, old.signals)
        x = carried_over(old, w, plan, base)
        if not np.isfinite(x).all():
            return None
        observer = Observer(plan, task.values, base, old.signals)
        made = Segment(observer, system, outcome.time, task.span.times, segment.reached, self.variables)
        return Continuation(made, x)

    def _nowhere(self, segment: Segment, in_vain: bool = False) -> None:
        """Say why the run cannot go on: `in_vain` where one choice has followed the other."""
        reduced, watch = segment.plan.reduced, segment.watch
        names, lost = ", ".join(reduced.state_names), reduced.flat.variable_name(watch.lost())
        if watch.lost_rank:
            self.reason = BUSY if self._busy else AHEAD.format(lost=lost)
        elif in_vain:
            self.reason = (
                f"the coordinates {names} and others have been exchanged {_MANY} times without progress; none of them "
                f"determines {lost} well here"
            )
        else:
            self.reason = (
                f"the coordinates {names} do not determine {lost} shortly after; choose some that determine "
                "the rest throughout, by states=[…] (--states) or stateSelect"
            )


def _margin(system: System, base: np.ndarray, t: float, x: np.ndarray) -> float:
    """The smallest singular value of the constraints at a place, in the sizes they have there; 0 where the coordinates
    do not serve.
    """
    watch = CoordinateWatch(system, base)
    return watch.margin if watch.begin(t, x) is Status.OK else 0.0


def _singular_start(segment: Segment, report: Report) -> StartSingular:
    """Return the error where the coordinates do not serve at the start."""
    reduced, variable = segment.plan.reduced, segment.watch.lost()
    names, span = ", ".join(reduced.state_names), reduced.flat.declared_at(variable)
    message = f"the coordinates {names} do not determine {reduced.flat.variable_name(variable)} at the start"
    hint = "choose others, by states=[…] (--states) or stateSelect"
    singular = starts_singular(segment, segment.watch.accepted.t, segment.watch.accepted.x)
    if singular:
        message, hint = f"{singular}: {message}", BESIDE
    report.error("E0535", message, span, hint=hint)
    return StartSingular(report.diagnostics, reduced.state_names, span)
