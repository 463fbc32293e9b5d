"""Many runs of one scene from beginning to end: the legs that single runs would make, in C, many at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import replace

import numpy as np

from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.lanes.legs import FOUND, Legs
from lmoc.numerics.lanes.scene import Runs, starts, tolerances
from lmoc.numerics.limits import FINEST
from lmoc.numerics.observe.recorder import Recorder, sampled_places
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory
from lmoc.numerics.options.options import RunOptions, TimeSpan
from lmoc.numerics.problem.base import Outcome, PlanCost, Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.steps import taylor
from lmoc.numerics.steps.automatic import Leg, Used, Way, legs, patience
from lmoc.numerics.steps.modes import EIGENVALUES, Modes, shifts
from lmoc.numerics.task.sizes import assumed_sizes, is_small, too_loose
from lmoc.support import budget

_TOGETHER = 64  # runs that go through C without a word from Python
_OVER, _ENOUGH = (next(n for n, of in FOUND.items() if of is own) for own in (Status.OK, Status.TOO_MANY_STEPS))


def go(
    runs: Runs, system: EngineSystem, options: RunOptions, span: TimeSpan, initial: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the states (runs, times, n) and which runs (runs,) have come to their end as single runs would.

    The others have failed, or are of a kind that Python looks at: nothing is said of them.
    """
    plan, begin, end = runs.plan, span.start, span.end
    x, good = starts(runs, begin, initial)
    rtol = options.tolerance(plan.reduced.flat.experiment)
    atol = np.full(x.shape, np.nan)
    if good.any():
        atol = tolerances(runs, begin, np.where(good[:, None], x, 0.0), rtol, options.atol)
    recorder = Recorder(runs.observer(0), span.times, None)  # which knows whether the start is an output time
    recorder.record_start(begin, x[0])
    first = recorder.reached
    states = np.full((runs.count, len(span.times), x.shape[1]), np.nan)
    states[:, :first], out = x[:, None], states[:, first:]
    longest = np.inf if options.max_step is None else options.max_step
    system.prepare(runs.base[0], runs.signals)
    times = span.times[first:]
    if end > begin:
        if options.solver == "auto":
            made = _automatic(runs, system, (begin, end), times, out, longest, options.max_steps)
        else:
            made = _named(runs, system, (begin, end), times, out, longest, options)
        good = made(x, good, max(rtol, FINEST), atol)
    if options.atol is None:
        good = good & _right_size(runs, states, span, rtol, good)
    return states, good


Made = Callable[[np.ndarray, np.ndarray, float, np.ndarray], np.ndarray]  # returns which have come to their end


def _named(
    runs: Runs, system: EngineSystem, span: tuple[float, float], times: np.ndarray, out: np.ndarray, longest: float,
    options: RunOptions,
) -> Made:  # fmt: skip
    """Return what makes runs with one method."""

    def made(x: np.ndarray, good: np.ndarray, rtol: float, atol: np.ndarray) -> np.ndarray:
        order = taylor.order_for(rtol) if options.solver == "taylor" else None
        own = Legs(system, runs.base, x, *span, times, out, longest, np.inf, order)
        own.atol[:], own.state["rtol"], own.state["most"] = atol, rtol, options.max_steps
        _walk(own, np.flatnonzero(good))
        return good & (own.state["found"] == 0)

    return made


def _walk(own: Legs, which: np.ndarray, goes_on: bool = False) -> None:
    for a in range(0, len(which), _TOGETHER):
        own.walk(which[a : a + _TOGETHER], goes_on)
        budget.moved_on(f"run {a}")


def _automatic(
    runs: Runs, system: EngineSystem, span: tuple[float, float], times: np.ndarray, out: np.ndarray, longest: float,
    most: int,
) -> Made:  # fmt: skip
    """Return what makes runs by the rules of `auto`, as far as DOP853 and the first steps along a series make them."""

    def made(x: np.ndarray, good: np.ndarray, rtol: float, atol: np.ndarray) -> np.ndarray:
        own = Legs(system, runs.base, x, *span, times, out, longest, patience(system))
        together = _Together(own, system, Problem(
            system, span[0], x[0], span[1], times, rtol, atol[0], lambda first, states: None,
            max_step=longest, max_steps=most, patience=patience(system),
        ))  # fmt: skip
        return together.go(x, atol, good)

    return made


Going = Generator[Leg, None, tuple[Outcome, Used]]
Asked = list[tuple[Leg, np.ndarray]]  # legs, and the runs that are to make them


def _of(asked: Asked, name: str) -> np.ndarray:
    """Return the runs that go on with a method."""
    return np.concatenate([np.zeros(0, int), *(which for leg, which in asked if leg.name == name)])


class _Together:
    """Runs by the rules of `auto`, each leg of all of them in one go."""

    def __init__(self, own: Legs, system: EngineSystem, problem: Problem) -> None:
        self.own, self.problem, self.n = own, problem, system.n
        self.series: dict[int, Legs] = {}  # along series, by their orders
        self.asked = np.zeros(0)  # absolute tolerances of the runs as a whole
        self.begun = np.zeros(0)  # where they begin
        self.under_way: dict[int, tuple[Way, Going]] = {}  # of those that have come to the end of their first leg
        self.jacobians: dict[int, np.ndarray] = {}  # where runs stand that are judged
        # sparse blocks keep the order of their pivots from leg to leg
        self.alone = any(b.pattern is not None for b in system.kernel.tape.blocks)

    def go(self, x: np.ndarray, atol: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Return which of the runs have come to their end."""
        self.begun, self.asked, which = x, atol, np.flatnonzero(good)
        ended = np.zeros(len(x), bool)
        for part in which[:, None] if self.alone else (which,):
            if len(part):
                self._go(part, ended)
        return ended

    def _go(self, part: np.ndarray, ended: np.ndarray) -> None:
        """Go through all legs of some of the runs; with which they begin depends on none of their numbers."""
        way = self._way(part)
        leg, first = next(legs(way)), True
        self._set_out(part, way, leg)
        asked: Asked = [(leg, part)]
        while asked := [(leg, which) for leg, which in asked if leg.name == "dop853" or self._suits_series(leg)]:
            _walk(self.own, _of(asked, "dop853"), self.alone and not first)
            for order, which in self._along_series(_of(asked, "taylor")).items():
                _walk(self._of_order(order), which)
            asked, first = list(self._next(asked, ended)), False

    def _way(self, which: np.ndarray | int) -> Way:
        """Return the way of one run, or of several as far as it is the same for all of them."""
        problem = replace(
            self.problem, x=self.begun[which], atol=self.asked[which], spent={self.problem.system.plan: PlanCost()}
        )
        return Way(problem, lambda p, outcome: Modes(p, outcome, lambda *_: self._jacobian(which)))

    def _suits_series(self, leg: Leg) -> bool:
        """Return whether C makes a leg along a series."""
        return leg.name == "taylor" and not self.alone

    def _along_series(self, which: np.ndarray) -> dict[int, np.ndarray]:
        """Return runs that go along series by their orders."""
        asks, at = np.unique(self.own.state["rtol"][which], return_inverse=True)
        orders = np.array([taylor.order_for(rtol) for rtol in asks.tolist()], int)
        return {order: which[orders[at] == order] for order in np.unique(orders).tolist()}

    def _of_order(self, order: int) -> Legs:
        if order not in self.series:
            p, own = self.problem, self.own
            given = p.t, p.end, own.times, own.out, p.max_step, p.patience
            self.series[order] = Legs(p.system, own.base, own.x, *given, order, own)
        return self.series[order]

    def _set_out(self, which: np.ndarray | int, way: Way, leg: Leg) -> None:
        own, before, state = self.own, way.outcome, self.own.state
        (state["rtol"][which], own.atol[which]), own.x[which] = way.tolerances(leg), before.x
        state["time"][which], state["step"][which] = before.time, way.first_step(leg)
        state["most"][which], state["overrun"][which] = way.steps(leg)
        state["shortest"][which] = leg.shortest
        state["reached"][which] = before.reached

    def _look_around(self, judged: np.ndarray) -> None:
        """Take the Jacobians where runs stand that are to be judged."""
        if len(judged) and self.n <= EIGENVALUES:
            shift = shifts(self.own.x[judged], self.asked[judged], self.problem.rtol)
            found = self.own.differences(judged, shift, self.alone)
            self.jacobians = dict(zip(judged.tolist(), found, strict=True))

    def _jacobian(self, k: int) -> np.ndarray | None:
        if self.n > EIGENVALUES or not np.isfinite(self.jacobians[k]).all():
            return None
        return self.jacobians[k]

    def _next(self, asked: Asked, ended: np.ndarray) -> Iterator[tuple[Leg, np.ndarray]]:
        """Yield the next legs of the runs that have arrived and go on; those that Python looks at are dropped."""
        arrived: list[tuple[Leg, np.ndarray]] = []
        for leg, which in asked:
            found = self.own.state["found"][which]
            ended[which[found == _OVER]] = True  # whatever would follow
            arrived.append((leg, which[found == _ENOUGH]))
        self._look_around(np.concatenate([which for _, which in arrived]))
        for leg, k in ((leg, k) for leg, which in arrived for k in which.tolist()):
            if k not in self.under_way:
                way = self._way(k)
                self.under_way[k] = way, legs(way)
                next(self.under_way[k][1])
            (way, rule), state = self.under_way[k], self.own.state[k]
            counts = {"steps": int(state["steps"]), "rejected": int(state["rejected"])}
            reached, time = int(state["reached"]) - way.outcome.reached, float(state["time"])
            status, x = FOUND[_ENOUGH], self.own.x[k].copy()
            way.arrive(leg, Outcome(time, x, reached, status, counts, float(state["step"])))
            following = next(rule, None)
            if following is not None:
                self._set_out(k, way, following)
                yield following, np.array([k])


def _right_size(runs: Runs, states: np.ndarray, span: TimeSpan, rtol: float, good: np.ndarray) -> np.ndarray:
    """Return which runs are as large as their tolerances were chosen for, or cannot be followed more closely."""
    plan = runs.plan
    places = sampled_places(len(span.times), states.shape[2])
    samples = states if len(places) == len(span.times) else states[:, places]  # which would be a copy
    sizes = assumed_sizes(plan, runs.values, samples[:, 0], {})
    tops = np.fmax(np.fmax.reduce(samples, axis=1), -np.fmin.reduce(samples, axis=1))
    small = is_small(tops, sizes, plan.ledger) & good
    right = ~small
    for k in np.flatnonzero(small).tolist():
        observer = runs.observer(k)
        segment = SegmentRecord(observer, span.start, span.times, states[k], (span.times[places], samples[k]))
        run = Trajectory((segment,), None, (span.end, states[k, -1]), {})
        right[k] = too_loose(run, observer.values, {}, rtol) is None
    return right
