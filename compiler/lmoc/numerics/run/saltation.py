"""Derivatives of a motion with events: over each event leads the flow from a little before it to a little after it.

That flow, between two fixed times, is smooth where the event is transversal, whatever happens at it (an impact, a law
that changes its mode, a ``when``); its derivative is the saltation matrix between two short ways (Leine and Nijmeijer,
Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, section 7.2). It comes from differences of order four
of short runs with a fine tolerance. Where the motion grazes, or a mode is on its edge, other things happen in some of
these, or their differences to both sides do not agree: there the motion has no derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import End, SegmentRecord, Trajectory
from lmoc.numerics.run.sensitivities import (
    STEP,
    Direction,
    Part,
    Sensitivities,
    Sweep,
    Tangent,
    agree,
    base_derivatives,
    check_motion,
    difference,
    refused,
    shifted,
    sizes_of,
)

Flow = Callable[[End, float, Mapping[str, object]], Trajectory]  # from where, until when, with which parameters

_ASIDE = 0.25  # of the way to the next event, how far before and behind one the flow is looked at
_SHRINK, _TRIES = 8.0, 5  # of that way, and of differences, where they are too coarse
_SMOOTH = 1e-3  # share by which differences of two orders may differ: those of the higher one are good to its square
_BOTH_SIDES = 0.05  # share by which those to both sides may
_NOISE = 1e-7  # of the sizes, what does not count in that
_LITTLE = 1e-6  # of a quantity's size, by which a run is changed to see whether the same happens
_AT_END = 1e-4  # of the run: what happens in that part before its end may happen behind it
_CLOSE = 1e-9  # of the run: events that are closer are not told apart


def with_events(
    trajectory: Trajectory, first: Tangent, directions: Sequence[Direction], explicit: bool, flow: Flow,
    wholes: Callable[[Direction, float], Trajectory],
) -> Sensitivities:  # fmt: skip
    """Return the derivatives of a motion, smooth or with events.

    Parameters
    ----------
    first : where it starts, behind what happens there
    explicit : whether the method of the run was
    flow : runs of the same scene from other places
    wholes : the run as a whole with one of the quantities changed

    Raises
    ------
    ModelError
        E0575: there are none, and why.
    """
    check_motion(trajectory)
    segments = _lasting(trajectory)
    _check_sequence(trajectory, directions, wholes)
    rtol, at, parts = float(trajectory.stats["rtol"]), first, []
    for k, segment in enumerate(segments):
        sizes = sizes_of([s for s in segments if s.coordinates == segment.coordinates])
        sweep = Sweep(segment.observer, directions, at.base, sizes, rtol, explicit)
        following = segments[k + 1] if k + 1 < len(segments) else None
        event = None
        if following is not None and following.reduced is segment.reduced:
            event = _Event(segments, k, trajectory, directions, sizes, flow)
        until = [] if following is None else [following.begin if event is None else event.time - event.aside]
        times = np.append(segment.time, until)
        states, tangents = _both_ways(sweep, at, times)
        count = len(segment.time)
        agree(states[:count], segment.table, sizes, 10 * sweep.rtol)
        parts.append(Part(segment, tangents[:, :count], at.base, sizes))
        if following is not None:
            last = Tangent(float(times[-1]), states[-1], tangents[:, -1], at.base)
            at = event.over(last) if event is not None else _in_other_coordinates(segment, following, last, directions)
    return Sensitivities(directions, parts)


def _in_other_coordinates(
    segment: SegmentRecord, following: SegmentRecord, at: Tangent, directions: Sequence[Direction]
) -> Tangent:
    """Return the same place with its derivatives in the coordinates that follow: these are functions of the others."""
    plan, sizes = following.observer.plan, sizes_of([segment])
    table, places = plan.reduced.registers, np.array([at.time])
    jets = list(zip(table.variable[plan.states].tolist(), table.order[plan.states].tolist(), strict=True))

    def states(observer: Observer, x: np.ndarray) -> np.ndarray:
        reduced = observer.plan.reduced
        registers = [observer.derivative(v, n) if n else int(reduced.register_of[v]) for v, n in jets]
        if min(registers) < 0:
            raise refused(f"the coordinates change at t = {at.time:.6g} s to some that are no variables")
        return np.array([observer.register(r, places, x[None])[0] for r in registers])

    def derivative(which: int, direction: Direction) -> np.ndarray:
        moved = np.max(np.abs(at.by[which]) / sizes, initial=0.0)
        step = STEP * min(direction.size, 1.0 / moved if moved > 0 else np.inf)

        def changed(change: float) -> np.ndarray:
            own = shifted(segment.observer, direction, change, at.base[which])
            return states(own, at.x + change * at.by[which])

        return difference(changed, step)

    by = np.stack([derivative(k, direction) for k, direction in enumerate(directions)])
    return Tangent(at.time, states(segment.observer, at.x), by, base_derivatives(following.observer, directions))


def _check_sequence(
    trajectory: Trajectory, directions: Sequence[Direction], wholes: Callable[[Direction, float], Trajectory]
) -> None:
    """See that the same events follow each other for values a little larger and smaller: else one of them just happens.

    Raises
    ------
    ModelError
        E0575: it does not.
    """
    flat, (end, _) = trajectory.flat, trajectory.last
    if trajectory.observer.plan.reduced.switched is None and flat.events is None:
        return
    early = trajectory.segments[0].begin + (1 - _AT_END) * (end - trajectory.segments[0].begin)

    def told(run: Trajectory) -> list[str]:
        return [f"{event.name} {event.kind}" for event in run.events if event.time < early]

    mine = told(trajectory)
    for direction in directions:
        for change in (-_LITTLE * direction.size, _LITTLE * direction.size):
            try:
                other = told(wholes(direction, change))
            except (ModelError, SimulationError):  # as beyond a bound
                continue
            if other != mine:
                raise refused(
                    f"a value of '{direction.name}' other by a millionth leads to other events: the motion grazes, "
                    "or a mode is on its edge"
                )


def _lasting(trajectory: Trajectory) -> list[SegmentRecord]:
    """Return the segments without those that have no extent."""
    last = {segment.begin: segment for segment in trajectory.segments}
    found = list(last.values())
    if sum(len(segment.time) for segment in found) != len(trajectory.time):
        raise refused("an output time lies between two events at one instant")
    accumulation = next((e for e in trajectory.events if e.kind == "accumulation"), None)
    if accumulation is not None:
        raise refused(f"the impacts of '{accumulation.name}' accumulate at t = {accumulation.time:.6g} s")
    return found


def _both_ways(sweep: Sweep, at: Tangent, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states (times, n) and tangents (m, times, n) before and behind a place."""
    order = np.argsort(times, kind="stable")
    split = int(np.searchsorted(times[order], at.time))
    before, behind = order[:split][::-1], order[split:]
    states, tangents = np.empty((len(times), sweep.n)), np.empty((sweep.m, len(times), sweep.n))
    for part in (before, behind):
        states[part], tangents[:, part] = sweep.go(at, times[part])
    return states, tangents


class _Event:
    """One instant at which something happens, between two segments.

    Attributes
    ----------
    time, aside : s, when, and how far before and behind it the flow is looked at
    """

    def __init__(
        self, segments: Sequence[SegmentRecord], k: int, trajectory: Trajectory, directions: Sequence[Direction],
        sizes: np.ndarray, flow: Flow,
    ) -> None:  # fmt: skip
        self.segment, self.directions, self.sizes, self.flow = segments[k], directions, sizes, flow
        self.time = segments[k + 1].begin
        following = segments[k + 2].begin if k + 2 < len(segments) else np.inf
        room = min(self.time - self.segment.begin, following - self.time)
        if room < _CLOSE * (trajectory.last[0] - segments[0].begin):
            raise refused(f"two events follow each other at t = {self.time:.6g} s")
        self.aside = _ASIDE * room

    def over(self, at: Tangent) -> Tangent:
        """Return the place behind the event, with its derivatives, from the one before it."""
        until = 2 * self.time - at.time
        reference = self._run(at, 0, 0.0, until)
        for _ in range(_TRIES):
            if reference is None or len({e.time for e in reference.events}) <= 1:
                break
            until = self.time + (until - self.time) / _SHRINK
            reference = self._run(at, 0, 0.0, until)
        if reference is None:
            raise refused(f"the motion over the event at t = {self.time:.6g} s cannot be repeated")
        found = [self._derivative(at, k, reference, until) for k in range(len(self.directions))]
        n = len(at.x)
        return Tangent(
            until, self._result(at, 0, 0.0, reference)[:n], np.stack([f[:n] for f in found]),
            np.stack([f[n:] for f in found]),
        )  # fmt: skip

    def _run(self, at: Tangent, which: int, change: float, until: float) -> Trajectory | None:
        """Return the short run with one quantity changed; None where there is none."""
        segment, direction = self.segment, self.directions[which]
        x, observer = at.x + change * at.by[which], shifted(segment.observer, direction, change, at.base[which])
        values = observer(np.arange(observer.flat.count), np.array([at.time]), x[None])[0]
        begin = End(at.time, tuple(segment.coordinates), x, values, segment.mode)
        try:
            return self.flow(begin, until, direction.parameters(change))
        except (ModelError, SimulationError):
            return None

    def _result(self, at: Tangent, which: int, change: float, run: Trajectory) -> np.ndarray:
        """Return the states at the end of a short run, and what does not change any more (n + registers,)."""
        segment, ledger = run.segments[-1], self.segment.observer.plan.ledger
        x = run.last[1].copy()
        x[ledger] += (at.x + change * at.by[which])[ledger]  # which each run begins anew
        return np.concatenate([x, segment.observer.base])

    def _derivative(self, at: Tangent, which: int, reference: Trajectory, until: float) -> np.ndarray:
        """Return the derivatives (n + registers,) behind the event by one quantity."""
        size = self.directions[which].size
        moved = np.max(np.abs(at.by[which]) / self.sizes, initial=0.0)
        step = STEP * min(size, 1.0 / moved if moved > 0 else np.inf)
        middle = self._result(at, which, 0.0, reference)
        for _ in range(_TRIES):
            around = self._around(at, which, step, reference, until)
            found = None if around is None else self._agreed(middle, around, step)
            if found is not None:
                return found
            step /= _SHRINK
        name, what = self.directions[which].name, ", ".join(_told(reference)) or "what happens"
        raise refused(
            f"at t = {self.time:.6g} s ({what}) the motion has no derivative by '{name}': it grazes, or a mode is on "
            "its edge",
            "a value a little larger or smaller leads to another sequence of events",
        )

    def _around(
        self, at: Tangent, which: int, step: float, reference: Trajectory, until: float
    ) -> dict[int, np.ndarray] | None:
        """Return the results of runs with a quantity changed by some steps, ahead where there is nothing behind.

        None where other things happen in them.
        """
        for places in ((-2, -1, 1, 2), (1, 2, 3, 4)):
            found = {}
            for k in places:
                run = self._run(at, which, k * step, until)
                if run is None or not _alike(run, reference):
                    break
                found[k] = self._result(at, which, k * step, run)
            if len(found) == len(places):
                return found
            if found:  # there is something behind: something else
                return None
        return None

    def _agreed(self, middle: np.ndarray, around: dict[int, np.ndarray], step: float) -> np.ndarray | None:
        """Return the derivatives; None where differences of two orders, or to both sides, do not agree."""
        known = np.isfinite(middle)
        f = {0: np.where(known, middle, 0.0)} | {k: np.where(known, own, 0.0) for k, own in around.items()}
        if -1 in f:
            low = (f[1] - f[-1]) / (2 * step)
            high = (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step)
            sides = np.abs(f[1] - 2 * f[0] + f[-1]) / step
        else:
            low = (-3 * f[0] + 4 * f[1] - f[2]) / (2 * step)
            high = (-25 * f[0] + 48 * f[1] - 36 * f[2] + 16 * f[3] - 3 * f[4]) / (12 * step)
            sides = np.zeros_like(low)
        n = len(self.sizes)
        noise = _NOISE * self.sizes / step
        size = np.max(np.abs(high[:n]) / self.sizes, initial=0.0) * self.sizes
        good = (np.abs(high - low)[:n] <= _SMOOTH * size + noise) & (sides[:n] <= _BOTH_SIDES * size + noise)
        return high if good.all() else None


def _alike(run: Trajectory, reference: Trajectory) -> bool:
    """Return whether the same happens in two runs."""
    mine, other = run.segments[-1], reference.segments[-1]
    return mine.coordinates == other.coordinates and mine.words == other.words and _told(run) == _told(reference)


def _told(run: Trajectory) -> list[str]:
    """Return what happens in a run."""
    return [f"{event.name} {event.kind}" for event in run.events]
