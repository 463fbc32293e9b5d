"""The laws of one run on its way: the mode that holds, the functions whose roots end it, and what happens there."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import JENKINS, NONE, Switched
from lmoc.ir.mode import law_rows, mode_word
from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import ContactKinematics, Instant
from lmoc.numerics.laws.manifold import drift, project, resisted
from lmoc.numerics.laws.mode import STILL, free_mode
from lmoc.numerics.laws.mode_roots import ModeRoots
from lmoc.numerics.laws.reading import reader
from lmoc.numerics.laws.rest import held_velocities
from lmoc.numerics.laws.transition import Transition, Trigger, transition
from lmoc.numerics.observe.event import Event
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Roots
from lmoc.numerics.problem.mode import Mode
from lmoc.numerics.problem.status import Status, Stopped
from lmoc.numerics.signals.signals import Constant, Signal

AT_ONCE = 1e-10  # s behind the start within which a law opens as the run begins
KEPT = 1e-14  # share of its terms by which what is closed may miss zero at output times
NEAR = 1e-10  # a mode with values below zero by more does not hold any longer where a run goes on
ROUNDING = 1e-13  # share of the forces that hold a body by which they may miss each other
OVERLAP = 1e-8  # a gap is negative where it is by this share of the lengths of the scene …
_SERIES = 3  # impacts by which the end of a series is known
OVERLAP_ROUNDING = 1e-12  # … and by more than what start values may be wrong by that are differences


class LawSwitching:
    """The state of the laws of one run.

    Parameters
    ----------
    plan : of the reduction of a switched form
    values, base, signals : of the run, with all laws open

    Attributes
    ----------
    mode : Mode
    """

    def __init__(self, plan: Plan, values: Array, base: Array, signals: Mapping[int, Signal]) -> None:
        self.kinematics = ContactKinematics(plan, values, base, signals)
        self.now: Instant | None = None  # where the present segment begins
        self.mode = free_mode(self.kinematics.table)
        self.touched = np.zeros(self.kinematics.form.count, bool)  # laws whose motion was zero there
        self.forces = np.zeros(self.kinematics.form.count)  # of the laws, where the present mode has begun
        self.idle = np.zeros(self.kinematics.form.count)  # roots in sequence at which nothing has happened to a law
        self.rounding = np.zeros(len(plan.states))  # of the states' rates, by the forces that hold there
        self.laws = law_rows(plan.reduced.flat, self.kinematics.form.laws)
        self.reader = reader(self.kinematics)
        self.begun = -np.inf  # s, where the first mode was found
        self.impacts = [deque(maxlen=_SERIES) for _ in range(self.kinematics.form.count)]  # s, the latest of each law
        self.undecided: list[tuple[float, list[str]]] = []  # s, and the laws of impacts whose order would matter
        self.let_go = Trigger.nothing(self.kinematics.form.count)  # the laws that have reached their end …
        self.let_go_at = -np.inf  # … at this time, in s
        self.unresolved: Array | float = 0.0  # what the integrator tells the states apart by no more
        self.second = np.zeros(0, int)  # the laws whose forces have a lower limit as well
        self.ledger = _ledger(self.kinematics)
        self.held = np.zeros(len(plan.states), bool)  # velocities that the closed laws keep at zero
        self._signals: tuple[Mode, dict[int, Signal]] | None = None

    # ------------------------------------------------------------------ the mode as values

    def signals(self) -> dict[int, Signal]:
        """Return the values of the mode, by flat variables."""
        mode = self.mode
        if self._signals is not None and self._signals[0] is mode:
            return self._signals[1]
        pairs = mode.inputs(self.kinematics.form)
        values = {int(v): Constant(float(k)) for vs, ks in pairs for v, k in zip(vs, ks, strict=True)}
        self._signals = mode, values
        return values

    # ------------------------------------------------------------------ what ends a mode

    def roots(self, t: float, x: Array, base: Array, signals: Mapping[int, Signal]) -> Roots:
        """Return the functions that are positive as long as the mode holds: one a law, two for stuck friction.

        Parameters
        ----------
        t, x : where the segment begins
        base, signals : those of the segment
        """
        evaluate = self.reader(base, signals)
        found = ModeRoots(self.kinematics, self.mode, self.touched, self.idle)
        self.second = found.second
        apart = found.apart(self.now, found.values(evaluate(np.array([t]), x[None]))[0])
        return Roots(lambda times, states: found.values(evaluate(times, states), apart), np.ones(len(apart)))

    # ------------------------------------------------------------------ what stays closed

    @property
    def drifting(self) -> NDArray[np.bool_]:
        """(2, n) gaps and rates of closed laws that the integrator keeps at zero within its errors alone."""
        closed, table = self.mode.closed, self.kinematics.table
        gaps, rates = closed & table.unilateral & (table.degree >= 1), closed & (table.degree == 2)
        return self.kinematics.scene.curved & np.array([gaps, rates])

    def kept(self, t: float, x: Array, share: float = KEPT) -> Array:
        """Return a state moved onto what is closed: the same array where it is there, NaN where there is no way.

        Parameters
        ----------
        share : of the terms of a gap, or of a rate, by which it may miss zero
        """
        chosen, now = self.drifting, self.kinematics.at(t, x)
        value = np.abs(np.stack([now.gap, now.rate])[chosen])
        if (value <= share * np.stack([now.gap_scale, now.rate_scale])[chosen]).all():
            return x
        try:
            return project(self.kinematics, now, *chosen)
        except Contradiction:
            return np.full(len(x), np.nan)

    # ------------------------------------------------------------------ what happens

    def start(self, t: float, x: Array) -> tuple[Array, list[Event]]:
        """Return the state at the start, on what is closed there, and what happened on the way."""
        self.begun = t
        return self._take(t, x, Trigger.nothing(len(self.mode.closed)), at_start=True)

    def resume(self, t: float, x: Array, base: Array, signals: Mapping[int, Signal]) -> tuple[Array, list[Event]]:
        """Return the state with which a run goes on in the mode in which another one has ended, as `start`.

        Where that mode does not hold with the present parameters and inputs, the next one is found as at an event.

        Parameters
        ----------
        base, signals : with the mode
        """
        self.now = now = self.kinematics.at(t, x)
        still = np.abs(now.rate) <= STILL * now.rate_scale
        self.touched = np.where(self.kinematics.table.unilateral, now.gap <= STILL * now.gap_scale, still)
        values = self.roots(t, x, base, signals).values(np.array([t]), x[None])[0]
        if (values >= -NEAR).all():
            self._hold()
            return x, []
        return self.happen(t, x, np.zeros(len(values), bool))

    def go_on(self, before: LawSwitching, t: float, x: Array) -> None:
        """Take over the mode at the same place from the laws in other coordinates."""
        self.mode, self.touched, self.begun = before.mode, before.touched, before.begun
        self.second = np.flatnonzero(self.mode.closed & ~self.kinematics.table.complementary)
        self.now = now = self.kinematics.at(t, x)
        self.forces = before.forces
        self._hold()
        self.rounding = ROUNDING * np.abs(now.response) @ np.abs(self.forces)

    def renewed(self, base: Array) -> LawSwitching:
        """Return the laws in the same mode with other registers that do not change between events."""
        made = LawSwitching(self.kinematics.plan, self.kinematics.values, base, self.kinematics.signals)
        made.mode, made.idle, made.unresolved, made.begun = self.mode, self.idle, self.unresolved, self.begun
        made.kinematics.errors = self.kinematics.errors
        made.let_go, made.let_go_at, made.impacts = self.let_go, self.let_go_at, self.impacts
        made.undecided = self.undecided
        made.second = np.flatnonzero(made.mode.closed & ~made.kinematics.table.complementary)
        made._hold()
        return made

    def happen(self, t: float, x: Array, which: NDArray[np.bool_], jumped: bool = False) -> tuple[Array, list[Event]]:
        """Return the state behind an instant at which root functions vanish, and what happened.

        Parameters
        ----------
        jumped : the states have been changed from outside
        """
        closed = self.mode.closed
        first, second = which[: len(closed)], np.zeros(len(closed), bool)
        second[self.second] = which[len(closed) :]
        direction = np.where(first, -1, 1)  # a force at its upper limit gives way to a motion against it
        trigger = self._with_let_go(t, Trigger(first & ~closed, (first | second) & closed, direction, jumped))
        # a load that grows from zero opens a law in the first instant: that is how the run begins
        at_start = not jumped and bool(which.any()) and t - self.begun <= AT_ONCE
        found = self._take(t, x, trigger, at_start)
        idle = (first | second) & (closed == self.mode.closed) & (not found[1])
        self.idle = np.where(idle, self.idle + 1, 0.0 if found[1] else self.idle)
        return found

    def _with_let_go(self, t: float, trigger: Trigger) -> Trigger:
        """Return a trigger with the laws that have opened at the same time before.

        Nothing has moved since then: a friction would stick again, since its force is still within its limits up to
        rounding.
        """
        if t == self.let_go_at:
            still = self.let_go.opening & ~self.mode.closed & ~trigger.closing
            still &= self.kinematics.table.degree != JENKINS  # whose forces have given way already
            direction = np.where(still, self.let_go.direction, trigger.direction)
            trigger = replace(trigger, opening=trigger.opening | still, direction=direction)
        self.let_go, self.let_go_at = trigger, t
        return trigger

    def part(self, t: float, x: Array, past: Instant) -> bool:
        """Return whether a discrete value changes any motion of the laws at an instant.

        Parameters
        ----------
        past : the instant with the discrete values before

        Raises
        ------
        Stopped
            A closed gap jumps to less than zero: more than an impulse would be needed.
        """
        now, table, closed = self.kinematics.at(t, x), self.kinematics.table, self.mode.closed
        with np.errstate(invalid="ignore"):
            change = np.nan_to_num(now.gap - past.gap)
            moved = closed & table.unilateral & (np.abs(change) > OVERLAP * np.maximum(now.gap_scale, past.gap_scale))
            turned = np.abs(now.rate - past.rate) > STILL * np.maximum(now.rate_scale, past.rate_scale)
        for k in np.flatnonzero(moved & (change < 0))[:1].tolist():
            reason = f"the gap of '{self.laws[k][0]}', which is closed, jumps to {now.gap[k]:.6g} at t = {t:.6g} s"
            raise Stopped(Status.CONTRADICTION, f"{reason} (give a ramp of finite length instead of a step)")
        return bool((moved | turned).any())

    def strike(self, t: float, before: Array, x: Array) -> Array:
        """Return states that a step has moved, with the impulses of closed laws that keep them closed.

        What steps does so ever faster, and what is closed does not bounce on that way: the impact is plastic.
        """
        now = self.kinematics.at(t, x)
        if (x == before).all():
            return now.x
        return resisted(self.kinematics, now, self.mode.closed & ~self._apart_from(now))

    def names(self, which: NDArray[np.bool_]) -> list[str]:
        """Return the names of the parts whose root functions have vanished."""
        rows = np.concatenate([np.arange(len(self.laws)), self.second])[which]
        return list(dict.fromkeys(self.laws[k][0] for k in rows.tolist()))

    def _take(self, t: float, x: Array, trigger: Trigger, at_start: bool = False) -> tuple[Array, list[Event]]:
        before = self.mode
        self._refuse_overlaps(t, x, trigger)
        kept = before.without(self._apart_from(self.kinematics.at(t, x))) if trigger.jumped else before
        try:
            found = transition(self.kinematics, t, x, kept, trigger, self.unresolved)
        except Contradiction as contradiction:
            names = list(dict.fromkeys(self.laws[k][0] for k in contradiction.laws.tolist()))
            reason = f"the laws of {', '.join(names)} contradict each other at t = {t:.6g} s: {contradiction}"
            raise Stopped(Status.CONTRADICTION, reason) from None
        if found.undecided.any():
            self.undecided.append((t, [self.laws[k][0] for k in np.flatnonzero(found.undecided).tolist()]))
        for k in found.impulse.nonzero()[0].tolist():
            self.impacts[k].append(t)
        self.mode, self.now, self.touched = found.mode, found.now, found.touched
        self.forces = found.settled.force
        self.rounding = ROUNDING * np.abs(found.now.response) @ np.abs(self.forces)
        self._hold()
        x = np.where(self.held, 0.0, found.x)
        if self.ledger is not None and (found.impulse.any() or found.lost.any()):
            work, heat = self.ledger
            lost = float(found.lost.sum())
            x[heat] += lost
            x[work] += lost + found.now.stored - found.before.stored
        return x, self._events(t, before, found, at_start)

    def _hold(self) -> None:
        self.held = held_velocities(self.kinematics.rate_forms[self.mode.closed])

    def _allowed(self, now: Instant) -> Array:
        """Return by what gaps may miss zero, or overlap."""
        own = self.kinematics.table.unilateral & (self.kinematics.table.degree >= 1)
        share = OVERLAP * now.gap_scale[own].max(initial=0.0) + OVERLAP_ROUNDING
        if not self.mode.closed.any():
            return np.full(len(own), share)
        return np.maximum(share, np.where(self.mode.closed, drift(self.kinematics, now.slope[0]), 0.0))

    def _apart_from(self, now: Instant) -> NDArray[np.bool_]:
        """Return the closed laws whose gaps are no longer zero: a jump of the states, or of an input, opens them."""
        table = self.kinematics.table
        with np.errstate(invalid="ignore"):
            return self.mode.closed & table.unilateral & (table.degree >= 1) & (now.gap > self._allowed(now))

    def _refuse_overlaps(self, t: float, x: Array, trigger: Trigger) -> None:
        """Raise `Stopped` where a gap is negative that no motion has closed: start values or a jump have put it there.

        States that are moved back onto a gap of zero would differ from those requested.
        """
        table, now = self.kinematics.table, self.kinematics.at(t, x)
        own = table.unilateral & (table.degree >= 1)
        if not own.any():
            return
        moved = own if trigger.jumped else own & ~self.mode.closed
        with np.errstate(invalid="ignore"):
            wrong = moved & ~trigger.closing & (now.gap < -self._allowed(now))
        for k in wrong.nonzero()[0][:1].tolist():
            reason = f"the gap of '{self.laws[k][0]}' is negative, {now.gap[k]:.6g}, at t = {t:.6g} s"
            raise Stopped(Status.CONTRADICTION, reason)

    def _events(self, t: float, before: Mode, found: Transition, at_start: bool) -> list[Event]:
        events = []
        was_held, is_held = before.shown, found.mode.shown
        passing = was_held & is_held & ~found.accumulated & (found.impulse != 0.0)
        passed = tuple((self.laws[k][0], float(found.impulse[k])) for k in passing.nonzero()[0].tolist())
        alone = not (found.impulse[~passing] != 0.0).any()  # nobody else has been hit: they are the impact
        for k, (name, laws) in enumerate(self.laws):
            was, now = was_held[k], is_held[k]
            turned = before.direction[k] * found.mode.direction[k] < 0
            kind = laws.closing if now else laws.opening
            if found.accumulated[k]:
                kind = "accumulation"
            elif was == now and not turned:
                if not found.impulse[k] or (was and now and not alone):
                    continue
                kind = "impact"
            elif at_start and not found.impulse[k]:
                continue  # how it begins is no event
            time = self._end_of_bounces(k, t, found.until) if found.accumulated[k] else t
            events.append(
                Event(
                    time,
                    name,
                    kind,
                    mode_word(laws, was),
                    mode_word(laws, now),
                    float(found.impulse[k]),
                    float(found.lost[k]),
                    f"{found.impact_law}'s law" if found.impulse[k] else "",
                    passed if found.impulse[k] and not alone else (),
                )
            )
        return events


    def _end_of_bounces(self, law: int, t: float, until: float) -> float:
        """Return when the bounces of a law are over that ends them now.

        Without loss of its own they do so with those of others, ever faster: the times between them are a geometric
        series (Aitken's extrapolation).
        """
        times = self.impacts[law]
        if not self.kinematics.table.lossless[law] or len(times) < _SERIES:
            return max(t, until)
        first, second = np.diff(times).tolist()
        return t + second**2 / (first - second) if 0.0 < second < first else t


def all_open(form: Switched) -> dict[int, Signal]:
    """Return the values with which all laws are open and give no force, by flat variables."""
    held = np.concatenate([form.closed, form.push, form.direction[form.direction != NONE]])
    return {int(v): Constant(0.0) for v in held}


def _ledger(kinematics: ContactKinematics) -> tuple[int, int] | None:
    """Return the components of work and heat among the states; None where they are not integrated."""
    plan = kinematics.plan
    flat, own = plan.reduced.flat, plan.reduced.registers.variable[plan.states]
    named = [flat.find(f"ledger.{n}") for n in ("work", "heat")]
    places = [np.flatnonzero((own == int(v[0])) & plan.ledger) for v in named if v is not None]
    if not kinematics.stored or len(places) < 2 or not all(len(p) for p in places):
        return None
    return int(places[0][0]), int(places[1][0])
