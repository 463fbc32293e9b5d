"""Derivatives along a motion with events: tangents through each segment, and over each instant the saltation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.numerics.events.closeness import located
from lmoc.numerics.events.occasion import Occasion
from lmoc.numerics.observe.slices import slice_of
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory
from lmoc.numerics.run.saltation import ROUNDING, Saltation
from lmoc.numerics.run.sensitivities import (
    Direction,
    OtherSide,
    Part,
    Sensitivities,
    Tangent,
    base_derivatives,
    check_motion,
    methods_for,
    refused,
    sizes_of,
)
from lmoc.numerics.run.surroundings import Surroundings
from lmoc.numerics.run.tangents import Tangents, agree
from lmoc.support.records import replace

_SAME_PLACE = 1e-6  # of a state, and of one: closed loops have other solutions elsewhere
_PLACES = 12, 400  # in a segment at which functions are looked at, at least and at most


def with_events(
    trajectory: Trajectory, first: Tangent, directions: Sequence[Direction], occasions: Sequence[Occasion],
    rtol: float,
) -> Sensitivities:  # fmt: skip
    """Return the derivatives of a motion, smooth or with events.

    Parameters
    ----------
    first : where it starts, behind what happens there
    occasions : the instants at which something happens
    rtol : relative tolerance

    Raises
    ------
    ModelError
        E0575: there are none, and why.
    """
    check_motion(trajectory)
    accumulation = next((e for e in trajectory.events if e.kind == "accumulation"), None)
    if accumulation is not None:
        raise refused(f"the impacts of '{accumulation.name}' accumulate at t = {accumulation.time:.6g} s")
    along = _Along(trajectory, first, directions, {o.segment: o for o in occasions}, rtol)
    for k in range(len(trajectory.segments)):
        along.through(k)
    return Sensitivities(directions, along.parts, rtol)


class _Along:
    """Derivatives on their way from segment to segment.

    Attributes
    ----------
    at : where they stand
    parts : what has been found
    """

    def __init__(
        self, trajectory: Trajectory, first: Tangent, directions: Sequence[Direction], occasions: dict[int, Occasion],
        rtol: float,
    ) -> None:  # fmt: skip
        self.trajectory, self.directions, self.occasions, self.rtol = trajectory, directions, occasions, rtol
        self.segments, self.begin = trajectory.segments, trajectory.segments[0].begin
        self.at, self.parts = first, list[Part]()
        self._methods = methods_for(str(trajectory.stats["solver"]))
        self._bases: dict[int, np.ndarray] = {}
        self._since = self.begin
        self._each = trajectory.stats.get("steps", 0) / max(trajectory.last[0] - self.begin, 1e-300)
        self._saltation: Saltation | None = None
        # where the latest instant has been, before it
        self._left = self.segments[0], first, np.ones(len(first.x))
        self._known: dict[tuple[str, ...], np.ndarray] = {}  # sizes of the states, by the coordinates

    def _sizes(self, segment: SegmentRecord) -> np.ndarray:
        named = tuple(segment.coordinates)
        if named not in self._known:
            same = [s for s in self.segments if s.coordinates == segment.coordinates]
            self._known[named] = sizes_of(same)
        return self._known[named]

    def through(self, k: int) -> None:
        """Go through a segment, and over the instant at its end."""
        segment, occasion, came = self.segments[k], self.occasions.get(k), self._saltation
        sizes = self._sizes(segment)
        sweep = Tangents(segment.observer, self.directions, self.at.base, sizes, self.rtol, self._methods)
        moved, others = self.at, ()
        if came is not None:
            at = self.at = replace(moved, by=moved.by - np.outer(came.delays, sweep.rates(moved.time, moved.x)))
            others = _on_both_sides(self.parts, segment, self._left, (at, sizes), came, self.rtol)
            if _follows_at_once(occasion, at.time, self.begin):
                by = np.repeat(at.by[:, None], len(segment.time), axis=1)
                self.parts.append(Part(segment, by, at.base, sizes, others))
                self._left = segment, at, sizes
                around = Surroundings(occasion, self.directions, sizes, came.since)
                self._saltation = Saltation(around, sweep, replace(moved, x=occasion.outcome.x), came.delays)
                self.at = self._saltation.behind
                return
        following = self.segments[k + 1] if k + 1 < len(self.segments) else None
        end = following.begin if following is not None else max(self.at.time, self.trajectory.last[0])
        times, states, tangents = self._sweep(segment, sweep, end, occasion is not None, others)
        place, self._saltation = Tangent(end, states[-1], tangents[:, -1], self.at.base), None
        if occasion is not None:
            around = Surroundings(occasion, self.directions, sizes, self._since)
            around.check(self.at.time, times, states, tangents, self.at.base, sweep)
            self._since = occasion.outcome.time
            if following is not None and occasion.behind is not None:
                place = replace(place, x=occasion.outcome.x)
                self._saltation = Saltation(around, sweep, place)
                self._left, place = (segment, place, sizes), self._saltation.behind
            elif following is None:
                around.check_end(place, sweep, self.rtol)
        elif following is not None:
            place = _in_other_coordinates(segment, following, place, sweep, self._bases)
        self.at = place

    def _sweep(
        self, segment: SegmentRecord, sweep: Tangents, end: float, looked_at: bool, others: tuple[OtherSide, ...]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Go to the end of a segment; return times with the states and their derivatives.

        Parameters
        ----------
        looked_at : between output times too, where something happens at its end
        others : what is on the other side of the instant at its beginning
        """
        at, sizes = self.at, self._sizes(segment)
        grid = np.linspace(at.time, end, _places(self._each * (end - at.time)))[1:] if looked_at else [end]
        times, own = np.unique(np.concatenate([segment.time, grid]), return_inverse=True)
        states, tangents, bent = sweep.go(at, times)
        own = own[: len(segment.time)]
        agree(sweep.plan, states[own], segment.table, sizes, 10 * sweep.rtol)
        for moving, place in bent:
            near = np.flatnonzero(np.abs(segment.time - place.time) <= ROUNDING * abs(place.time))
            others += tuple(OtherSide(k, segment, place, sizes, moving, "") for k in near.tolist())
        sweep.check_slopes(times, states, tangents)
        self.parts.append(Part(segment, tangents[:, own], at.base, sizes, others))
        return times, states, tangents


def _on_both_sides(
    parts: list[Part], segment: SegmentRecord, left: tuple[SegmentRecord, Tangent, np.ndarray],
    right: tuple[Tangent, np.ndarray], came: Saltation, rtol: float,
) -> tuple[OtherSide, ...]:  # fmt: skip
    """Return what is before an instant, for outputs behind it; outputs before it are given what is behind.

    Parameters
    ----------
    segment : behind the instant
    left, right : the places on both sides of it with the sizes of the states, and the segment before
    """
    if not came.moving.any():
        return ()
    before = [
        OtherSide(k, segment, *right, came.moving, came.said) for k in came.near(parts[-1].segment.time, rtol).tolist()
    ]
    if before:
        parts[-1] = replace(parts[-1], others=(*parts[-1].others, *before))
    behind = came.near(segment.time, rtol).tolist()
    return tuple(OtherSide(k, *left, came.moving, came.said) for k in behind)


def _follows_at_once(occasion: Occasion | None, time: float, start: float) -> bool:
    """Return whether an instant is the one before it, but for rounding, and the run goes on behind it.

    A condition that an event has made true may be false again as soon as the motion turns back there.
    """
    if occasion is None or occasion.behind is None:
        return False
    return occasion.outcome.time - time <= located(time, start)


def _places(steps: float) -> int:
    return int(min(max(_PLACES[0], 4 * steps), _PLACES[1]))


def _in_other_coordinates(
    segment: SegmentRecord, following: SegmentRecord, at: Tangent, sweep: Tangents, bases: dict[int, np.ndarray]
) -> Tangent:
    """Return the same place with its derivatives in the coordinates that follow: these are functions of the others.

    Parameters
    ----------
    bases : derivatives of what follows from parameters alone, by the plan
    """
    observer, plan = segment.observer, following.observer.plan
    table, places = plan.reduced.registers, np.array([at.time])
    jets = zip(table.variable[plan.states].tolist(), table.order[plan.states].tolist(), strict=True)
    register_of = observer.plan.reduced.register_of
    registers = np.array([observer.derivative(v, n) if n else register_of[v] for v, n in jets])
    if registers.min(initial=0) < 0:
        raise refused(f"the coordinates change at t = {at.time:.6g} s to some that are no variables")
    x = observer.followed(slice_of(observer.plan, registers))(places, at.x[None])[0]
    found, by = sweep.others(at, registers)
    if not (np.abs(found - x) <= _SAME_PLACE * (1.0 + np.abs(x))).all() or not np.isfinite(by).all():
        raise refused(f"the coordinates change at t = {at.time:.6g} s, where closed loops have no derivatives")
    if id(plan) not in bases:
        bases[id(plan)] = base_derivatives(following.observer, sweep.directions)
    base, events = bases[id(plan)].copy(), plan.reduced.flat.events
    if events is not None:  # which discrete variables take along
        to, of = (s.observer.plan.reduced.register_of[events.discrete] for s in (following, segment))
        base[:, to] = at.base[:, of]
    return Tangent(at.time, x, by, base)
