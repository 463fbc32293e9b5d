"""The loop of every integration: steps, guard, roots, output, progress, deadline, interruption.

A method makes steps and knows values within the last one (`base.Integration`); everything else is here. Where nobody
looks at the steps, a method that can is left alone from one output time to the next (`base.Unattended`).
"""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from lmoc.numerics.limits import LOOK, PACE
from lmoc.numerics.problem.base import Expired, Integration, Outcome, Pieces, Problem, Unattended, Walker, Watch
from lmoc.numerics.problem.status import Status, interruption
from lmoc.numerics.steps.roots import RootFinder
from lmoc.support.records import replace

_PASSED = 100  # steps up to which a piece between two kinks is one of those that C makes one after the other
_BATCH = 200_000  # numbers collected before they are handed on
# steps between two looks at the clock at the most, and rows evaluated in them, by a method that makes them at once
_MANY, _ROWS = 4096, 200_000
_STALL, _GUARDED = 10_000, 1_000  # steps after which it is judged whether they get on, of guarded ones the latter
# numbers of steps, and how many are still ahead at the pace of the latest, and of those before, that have no end in
# sight: a day's work and more; a universe's age, which a layer that is left behind in steps ever longer never asks for
_PACES = (_STALL, 1e10), (1_000, 1e25)
_BY_RULES = (Status.TOO_MANY_STEPS, Status.STIFF, Status.COLLAPSED, Status.NOT_FINITE)
_OK = Status.OK  # attributes of an enumeration are slow to look up


def integrate(problem: Problem, run: Integration) -> Outcome:
    """Integrate to the end of a problem, or to where it ends earlier, with a method that has been started on it.

    Beyond the end of the problem it goes on over kinks, as far as each of the pieces between them takes few steps.
    """
    loop = Loop(problem, run)
    outcome, pieces = loop.go(), problem.pieces
    if pieces is None or loop.is_in_c:
        return outcome
    while pieces.count and outcome.status is _OK:
        piece, pieces = _first(problem, pieces, outcome), pieces.behind(1, _within(pieces))
        if not run.begin_piece(piece):
            return outcome
        before, outcome = outcome, Loop(piece, run, loop.finder).go()
        outcome.reached += before.reached
        outcome.counts = {key: before.counts[key] + count for key, count in outcome.counts.items()}
        if outcome.status in _BY_RULES:  # those by which a method is chosen: from here on
            outcome.status = _OK
            break
    return outcome


def _within(pieces: Pieces) -> int:
    """Return the number of output times in the first piece."""
    return int(np.searchsorted(pieces.times, pieces.bounds[1][0], "right"))


def _first(problem: Problem, pieces: Pieces, outcome: Outcome) -> Problem:
    """Return the problem of the first of some pieces."""
    (begin, end, longest), done = (float(bound[0]) for bound in pieces.bounds), outcome.reached
    return replace(
        problem,
        t=begin,
        x=outcome.x,
        end=end,
        times=pieces.times[: _within(pieces)],
        sink=lambda first, states: problem.sink(first + done, states),
        max_step=longest,
        pieces=None,
    )


class Loop:
    """One integration under way."""

    def __init__(self, problem: Problem, run: Integration, finder: RootFinder | None = None) -> None:
        """
        Parameters
        ----------
        finder : that of the piece before a kink
        """
        self.problem, self.run = problem, run
        self.watch = Watch(problem)
        self.times = problem.times.tolist()
        self.next = (*self.times[:1], math.inf)[0]  # the first output time ahead
        self.handed = self.reached = 0  # output times handed on, and reached
        self.most = max(1, _BATCH // max(1, len(problem.x)))
        if finder is not None:
            finder.begin(problem.t, problem.x)
        elif problem.roots is not None:
            finder = RootFinder(problem.roots, problem.t, problem.x, run.series is not None)
        self.finder = finder
        self.judged = 0, problem.t  # steps and time when it was last looked at whether they get on
        # the same for each of `_PACES`, and whether there was no end in sight
        self.paced = [(0, problem.t, False) for _ in _PACES]
        # where it ends within the last step; before that has been looked at, where it has begun: an interruption may
        # come between a step over a root and the search for it
        self.place: tuple[float, np.ndarray] | None = None

    def go(self) -> Outcome:
        run = self.run
        try:
            with run:
                if self.walker is not None:
                    status = self.go_by_walks(self.walker)
                else:
                    watched = self.problem.needs_steps or self.problem.held is not None
                    unattended = None if watched else run.unattended
                    status = self.go_stepwise() if unattended is None else self.go_unattended(unattended)
        except Expired:
            status = Status.TOO_LONG
        except KeyboardInterrupt:
            status = interruption()
        self.flush()
        if status in (Status.COLLAPSED, Status.NOT_FINITE) and self.problem.guard is not None:
            status = self.problem.guard.stuck(status)
        time, x = self.place or (run.t, run.x.copy())
        found = None if status is not Status.ROOT else self.finder.which
        return Outcome(
            time, x, self.reached, status, run.counts(), run.step_size, run.matrix, run.evaluation, roots=found
        )

    def go_unattended(self, method: Unattended) -> Status:
        """Leave the method alone from one output time to the next."""
        run = self.run
        for k, t in enumerate((*self.times, self.problem.end)):
            status = method.advance(t)
            if status is not Status.OK:
                return status
            if k < len(self.times):
                run.collect_here()
                self.reached += 1
                if self.reached - self.handed >= self.most:
                    self.flush()
            if self.watch.expired(t):
                return Status.TOO_LONG
        return Status.OK

    @property
    def is_in_c(self) -> bool:
        """Return whether nobody looks at the steps."""
        return self.walker is not None and self.problem.compiled_guard is None

    @property
    def walker(self) -> Walker | None:
        """Return what makes many steps at once; None where somebody looks at each of them in Python."""
        problem = self.problem
        if problem.roots is not None or problem.held is not None:
            return None
        alone = problem.guard is None and problem.correction is None
        return self.run.walker if alone or problem.compiled_guard is not None else None

    def go_by_walks(self, method: Walker) -> Status:
        """Have the method make many steps at once, more of them from batch to batch as far as the scene is small."""
        problem, run, guard = self.problem, self.run, self.problem.compiled_guard
        largest = min(max(_ROWS // max(1, problem.system.plan.row_count), LOOK), _MANY)
        allowed, most, status = problem.max_steps, LOOK, _OK
        while run.t < problem.end and status is _OK:
            left = allowed - run.steps - run.rejected
            if left <= 0:
                if allowed > problem.max_steps or not self.is_nearly_there():
                    return Status.TOO_MANY_STEPS
                allowed += problem.overrun
                continue
            number = min(most, left)
            hook = None if guard is None else guard.enter(number)
            if guard is None or hook is not None:
                status = self.walk(method, number, hook)
            if status is Status.DOUBTFUL or (guard is not None and hook is None):
                status = self.step()
            if self.watch.expired(run.t):
                return Status.TOO_LONG
            halted = self.halted(run.steps + run.rejected)
            if halted is not _OK:
                return halted
            most = min(2 * most, largest)
        goes_on = status is _OK and problem.pieces is not None and self.is_in_c
        return self.pass_kinks(method, problem.pieces, largest) if goes_on else status

    def pass_kinks(self, method: Walker, pieces: Pieces, every: int) -> Status:
        """Go on over kinks as far as each of the pieces between them takes few steps."""
        problem, run, stuck = self.problem, self.run, False
        most = min(problem.max_steps, _PASSED), problem.overrun, every
        while pieces.count and not stuck:
            self.flush()
            passed, reached, stuck = method.pass_kinks(pieces, self.most, most)
            self.reached += reached
            pieces = pieces.behind(passed, reached)
            if self.watch.expired(run.t):
                return Status.TOO_LONG
        return _OK

    def walk(self, method: Walker, most: int, hook: int | None) -> Status:
        """Have the method make up to so many steps, and see to their output."""
        problem, run = self.problem, self.run
        room = self.most - (self.reached - self.handed)
        status, reached = method.walk(problem.times[self.reached :], room, most, hook)
        if problem.compiled_guard is not None:
            problem.compiled_guard.leave(run.t, run.x)
        self.reached += reached
        self.next = self.times[self.reached] if self.reached < len(self.times) else math.inf
        if self.reached - self.handed >= self.most:
            self.flush()
        if self.next > run.t:
            return status
        self.show(run.t)
        return status if problem.correction is None else self.correct(status)

    def go_stepwise(self) -> Status:
        problem, run, step = self.problem, self.run, self.step
        if self.finder is None and problem.guard is None:
            step = self.step_unwatched
        end, looked, most = problem.end, 0, problem.max_steps
        while run.t < end:
            done = run.steps + run.rejected
            if done >= most:
                if most > problem.max_steps or not self.is_nearly_there():
                    return Status.TOO_MANY_STEPS
                most += problem.overrun
            if done >= looked:
                looked = done + LOOK
                if self.watch.expired(run.t):
                    return Status.TOO_LONG
                halted = self.halted(done)
                if halted is not _OK:
                    return halted
            status = step()
            if status is not _OK:
                return status
        return Status.OK

    def is_nearly_there(self) -> bool:
        """Return whether as many more steps as are allowed reach the end if they are as long as those so far."""
        problem, t = self.problem, self.run.t
        return self.run.steps * (problem.end - t) < problem.overrun * (t - problem.t)

    def halted(self, done: int) -> Status:
        """Return why the latest steps have hardly got on: a jump of the equations, a singular position; OK else."""
        problem, run = self.problem, self.run
        if self.crawls(done):
            return Status.CRAWLING
        guarded = problem.guard is not None
        if not (guarded or problem.held) or done - self.judged[0] < (_GUARDED if guarded else _STALL):
            return _OK
        (before, at), self.judged = self.judged, (done, run.t)
        whole = guarded and problem.whole > problem.end  # on a short way to a singular position all steps are short
        ahead = (problem.whole if whole else problem.end) - problem.t
        if run.t - at >= (done - before) * PACE * ahead:
            return _OK
        if problem.held is not None and problem.held(run.t, run.x, (run.t - at) / (done - before)):
            return Status.CHATTERING
        status = problem.guard.stuck(Status.CRAWLING) if guarded else _OK
        return _OK if status is Status.CRAWLING else status

    def crawls(self, done: int) -> bool:
        """Return whether the latest steps, and those before, have no end in sight."""
        run = self.run
        for k, (many, hopeless) in enumerate(_PACES):
            before, at, seen = self.paced[k]
            if done - before >= many:
                slow = (done - before) * (self.problem.end - run.t) > hopeless * (run.t - at)
                self.paced[k] = done, run.t, slow
                if slow and seen:
                    return True
        return False

    def step_unwatched(self) -> Status:
        """One step and its output."""
        run = self.run
        run.wanted = self.next
        status = run.step()
        if self.next <= run.t and (status is _OK or status is Status.STIFF):
            self.show(run.t)
        return status

    def step(self) -> Status:
        """One step, looked at by whoever is concerned, and its output."""
        run = self.run
        run.wanted = -math.inf
        self.place = start = (run.t, run.x.copy())
        status = run.step()
        if status not in (Status.OK, Status.STIFF):
            self.place = None
            return status
        judged, end = (Status.OK, None) if self.problem.guard is None else self.judge(start)
        until = run.t if end is None else end[0]
        if self.finder is not None and until > start[0]:  # what is good of a step counts
            found = self.finder.first(run, until)
            if found is not None:
                self.place = found
                self.show(found[0])
                return Status.ROOT
        self.place = end
        if end is not None:
            self.show(until)
            return judged
        if self.next <= run.t:
            self.show(run.t)
        return status if self.problem.correction is None else self.correct(status)

    def judge(self, start: tuple[float, np.ndarray]) -> tuple[Status, tuple[float, np.ndarray] | None]:
        """Have the guard judge the last step; return as well the last good place within it where it is rejected."""
        run, guard, good = self.run, self.problem.guard, start
        looks = run.looks if self.problem.correction is None else 1
        for t in np.linspace(start[0], run.t, looks + 1)[1:].tolist():
            place = (t, run.x) if t == run.t else (t, run.interpolate(np.array([t]))[0])
            judged = guard(*place)
            if judged is not Status.OK:
                return judged, good
            good = place
        return Status.OK, None

    def correct(self, status: Status) -> Status:
        """Move the state as the problem's correction says, and go on from there."""
        x = self.problem.correction(self.run.t, self.run.x)
        if x is self.run.x:
            return status
        if not np.isfinite(x).all():
            return Status.SINGULAR
        self.run.jump(x)
        return status

    def show(self, until: float) -> None:
        """Collect the output times in the last step."""
        last = bisect_right(self.times, until, self.reached)
        if last > self.reached:
            self.run.collect(self.problem.times[self.reached : last])
            self.reached = last
            self.next = self.times[last] if last < len(self.times) else math.inf
            if self.reached - self.handed >= self.most:
                self.flush()

    def flush(self) -> None:
        """Hand on what has been collected."""
        states = self.run.collected()
        first, self.handed = self.handed, self.handed + len(states)
        if len(states):
            self.problem.sink(first, states)
