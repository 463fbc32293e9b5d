"""Time stepping of scenes with laws: steps of equal length, with impulses in place of events.

The scheme of J. J. Moreau (1988) and M. Jean (1999) in the form of V. Acary and B. Brogliato, Numerical Methods for
Nonsmooth Dynamical Systems, 2008, chapter 10. In each step of length h the forces of the laws are impulses Λ,

    x' = x + A⁻¹·(h·f(t + θ·h, x) + R·Λ),    A = 1 − h·θ·∂f/∂x,    θ = 1/2,

where R is the effect of the forces on the states' rates. The rates r' at the end of the step solve one complementarity
problem for all laws that are reached: 0 ≤ Λ ⟂ r' + e·min(r, 0) ≥ 0, and −h·limit ≤ Λ ≤ h·limit for friction. Gaps that
are negative afterwards are moved back along M⁻¹·Gᵀ (V. Acary, Projected event-capturing time-stepping schemes, CMAME
256, 2013). The order is one, whatever happens within a step, and the cost does not depend on how many laws open and
close.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.ir.law import Laws, Switched
from lmoc.ir.mode import mode_word
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Report
from lmoc.numerics.laws.complementarity import FREE, LOWER, Array, NoSolution, Sides, solve
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Mask
from lmoc.numerics.limits import LOOK
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.readout import readout_of
from lmoc.numerics.options.options import MOREAU
from lmoc.numerics.problem.base import Expired, Outcome, Problem, Properties, Watch
from lmoc.numerics.problem.status import Status, interruption
from lmoc.numerics.signals.signals import Function
from lmoc.structure.laws.switched import POSITION
from lmoc.support.records import dataclass

PROPERTIES = Properties(
    MOREAU, "Moreau–Jean", "time stepping", "1", "1", "own",
    stability="A", implicit=True, lengths="fixed", steps=False,
    needs="laws whose forces act on rates, and no other events",
    good_for="scenes of many contacts that open and close all the time, at low accuracy",
)  # fmt: skip

THETA = 0.5
STILL = 1e-11  # rates below this share of the velocities that make them are zero (``LMOC_STILL``)
_GENERIC = 2  # other points at which the effect of the forces is compared, to see whether it is constant
_SAME = 1e-12  # what it may differ by there


class Recorded:
    """The force of a law as the steps have found it: constant in each of them, zero where there is none yet."""

    def __init__(self) -> None:
        self.ends: list[float] = []
        self.values: list[float] = []

    def __call__(self, t: float) -> float:
        k = int(np.searchsorted(self.ends, t))
        return self.values[k] if k < len(self.values) else 0.0


def recorded(form: Switched) -> dict[int, Function]:
    """Return the forces of all laws as signals that the steps fill, by flat variables."""
    return {int(v): Function(Recorded(), "force") for v in form.push}


def refuse(reduced: Reduced, report: Report) -> None:
    """Report a scene that time stepping is not made for."""
    form, reason = reduced.switched, ""
    if form is None:
        reason = "the scene has no laws"
    elif reduced.flat.events is not None:
        reason = "the scene has events of its own (when, if, discrete variables)"
    elif reduced.constraints is not None:
        reason = "the coordinates of the scene may have to change during the run"
    elif any(laws.normal is not None for laws in form.laws):
        reason = "a friction depends on the normal force of a contact"
    elif (form.degree != POSITION).any():
        reason = "a law acts on something that has no mass"
    if reason:
        hint = "without --solver the run locates each event"
        report.error("E0540", f"solver '{MOREAU}' cannot be used: {reason}", hint=hint)


@dataclass(frozen=True, eq=False)
class _State:
    """Where the steps stand.

    Attributes
    ----------
    gap, rate : (n,)
    closed : (n,) laws with an impulse and no rate in the last step
    """

    t: float
    x: Array
    gap: Array
    rate: Array
    closed: Mask


class TimeStepping:
    """The steps of one run.

    Parameters
    ----------
    kinematics : of the laws, all open
    forces : one for each law; they are filled on the way
    rows : name of the part and group of each law
    ledger : components of work and heat among the states, -1 without

    Attributes
    ----------
    records : what has happened, at the ends of steps
    """

    def __init__(
        self,
        kinematics: ContactKinematics,
        forces: list[Recorded],
        rows: list[tuple[str, Laws]],
        ledger: tuple[int, int],
    ) -> None:
        self.kinematics, self.forces, self.rows, self.heat = kinematics, forces, rows, ledger[1]
        self.records: list[Event] = []
        self.side: Sides = np.full(len(rows), LOWER)
        self.now: Instant | None = None
        self.constant = False
        gaps, rates = kinematics.registers[:2]
        registers = np.concatenate([np.where(gaps >= 0, gaps, rates), rates])
        self._motions = readout_of(kinematics.plan, registers).bind(kinematics.base, kinematics.signals)
        self._jacobian: Array = np.zeros((0, 0))
        self._inverse: Array = np.zeros((0, 0))

    def march(self, problem: Problem) -> Outcome:
        """Make steps to the end of a problem; the forces are those of these steps."""
        for force in self.forces:
            force.ends.clear()
            force.values.clear()
        count = max(1, round((problem.end - problem.t) / problem.step))
        edges = np.linspace(problem.t, problem.end, count + 1)
        watch, reached = Watch(problem), 0
        self.now = self.kinematics.at(problem.t, problem.x)
        self.constant = self._is_constant(self.now)
        touching = (self.now.gap <= STILL * self.now.gap_scale) | ~self.kinematics.table.unilateral
        still = np.abs(self.now.rate) <= STILL * self.now.rate_scale
        state = _State(problem.t, problem.x, self.now.gap, self.now.rate, touching & still)
        for k in range(count):
            if k % LOOK == 0 and watch.expired(state.t):
                return Outcome(state.t, state.x, reached, Status.TOO_LONG, {"steps": k})
            try:
                after = self._step(problem, state, float(edges[k + 1]))
            except NoSolution:
                return Outcome(state.t, state.x, reached, Status.CONTRADICTION, {"steps": k})
            except (Expired, KeyboardInterrupt):
                return Outcome(state.t, state.x, reached, interruption(), {"steps": k})
            if not np.isfinite(after.x).all():
                return Outcome(state.t, state.x, reached, Status.NOT_FINITE, {"steps": k})
            last = int(np.searchsorted(problem.times, after.t, "right"))
            if last > reached:
                share = ((problem.times[reached:last] - state.t) / (after.t - state.t))[:, None]
                problem.sink(reached, state.x + share * (after.x - state.x))
                reached = last
            state = after
        return Outcome(state.t, state.x, reached, Status.OK, {"steps": count})

    # ------------------------------------------------------------------ one step

    def _step(self, problem: Problem, state: _State, end: float) -> _State:
        system, table, h = problem.system, self.kinematics.table, end - state.t
        now = self.now if self.constant else self.kinematics.at(state.t, state.x)
        middle, rate = state.t + THETA * h, np.empty(len(state.x))
        system.rhs(middle, state.x, rate)
        jacobian = system.jacobian(middle, state.x)
        inverse = self._inverted(jacobian, h)
        effect = inverse @ self._effect(now)
        free = state.x + inverse @ (h * rate)
        _, loose = self.motions(end, free)
        slope = now.slope[1] @ effect
        reached = ~table.unilateral | (state.gap + 0.5 * h * state.rate <= STILL * now.gap_scale)
        impulse, side = self._impulses(now, state, h, slope, loose, reached)
        x = self._corrected(now, end, free + effect @ impulse, jacobian @ now.response, reached)
        gap, after = self.motions(end, x)
        lost = -0.5 * impulse * (state.rate + after)
        if self.heat >= 0:
            x[self.heat] += lost.sum()
        holds = np.abs(after) <= STILL * (np.abs(loose) + np.abs(state.rate)) + STILL * now.rate_scale
        closed = np.where(table.complementary, (impulse > 0.0) & holds, (side == FREE) & holds)
        for force, value in zip(self.forces, (impulse / h).tolist(), strict=True):
            force.ends.append(end)
            force.values.append(value)
        self._record(end, state, closed, np.where(table.complementary, impulse, 0.0), lost)
        return _State(end, x, gap, after, closed)

    def _impulses(
        self, now: Instant, state: _State, h: float, matrix: Array, loose: Array, reached: Mask
    ) -> tuple[Array, Sides]:
        """Return the impulses of all laws, and where they are between their bounds."""
        table = self.kinematics.table
        limit = np.where(state.closed, now.stick, now.slip)
        upper = np.where(table.complementary, np.inf, h * limit)[reached]
        lower = np.where(table.complementary[reached], 0.0, -upper)
        wanted = loose + np.where(table.unilateral, table.restitution * np.minimum(state.rate, 0.0), 0.0)
        found = solve(matrix[np.ix_(reached, reached)], wanted[reached], lower, upper, self.side[reached])
        impulse, side = np.zeros(len(reached)), np.full(len(reached), LOWER)
        impulse[reached], side[reached] = found.x, found.side
        self.side = side
        return impulse, side

    def _corrected(self, now: Instant, t: float, x: Array, pushed: Array, reached: Mask) -> Array:
        """Return states whose gaps are not negative: moved by as little as the masses allow.

        Parameters
        ----------
        pushed : (states, n) second derivatives of the states by the forces: those of positions say how to move them
        """
        gap, _ = self.motions(t, x)
        own = np.flatnonzero(reached & self.kinematics.table.unilateral & (gap < 0.0))
        if not len(own):
            return x
        own = np.flatnonzero(reached & self.kinematics.table.unilateral)
        positions = (now.slope[0] != 0.0).any(axis=0)
        moved = np.where(positions[:, None], pushed[:, own], 0.0)
        found = solve(now.slope[0][own] @ moved, gap[own], np.zeros(len(own)), np.full(len(own), np.inf))
        return x + moved @ found.x

    def _inverted(self, jacobian: Array, h: float) -> Array:
        """Return (1 − h·θ·∂f/∂x)⁻¹, kept as long as the matrix does not change."""
        if jacobian.shape != self._jacobian.shape or (jacobian != self._jacobian).any():
            self._jacobian = jacobian
            self._inverse = np.linalg.inv(np.eye(len(jacobian)) - h * THETA * jacobian)
        return self._inverse

    # ------------------------------------------------------------------ the laws' quantities

    def motions(self, t: float, x: Array) -> tuple[Array, Array]:
        """Return gaps and rates."""
        gap, rate = np.split(self._motions(np.array([t]), x[None])[0], 2)
        return np.where(self.kinematics.table.unilateral, gap, np.nan), rate

    def _effect(self, now: Instant) -> Array:
        """Return the effect of the forces on the states' rates; their heat is entered from the impulses."""
        response = now.response.copy()
        if self.heat >= 0:
            response[self.heat] = 0.0
        return response

    def _is_constant(self, now: Instant) -> bool:
        """Return whether the effect of the forces is the same everywhere, by generic points."""
        dice = np.random.default_rng(1)
        fields: tuple[Callable[[Instant], Array], ...] = (
            lambda i: i.slope, lambda i: i.delassus, self._effect, lambda i: i.slip, lambda i: i.stick
        )  # fmt: skip
        for _ in range(_GENERIC):
            away = now.x + dice.uniform(0.5, 1.5, len(now.x)) * (1.0 + np.abs(now.x))
            other = self.kinematics.at(now.t + dice.uniform(0.5, 1.5), away)
            for field in fields:
                if not np.allclose(field(now), field(other), rtol=_SAME, atol=0.0, equal_nan=True):
                    return False
        return True

    def _record(self, t: float, state: _State, closed: Mask, impulse: Array, lost: Array) -> None:
        bounced = ~closed & (impulse > 0.0) & ~state.closed
        for k in np.flatnonzero((closed != state.closed) | bounced).tolist():
            name, laws = self.rows[k]
            was, now = bool(state.closed[k]), bool(closed[k])
            kind = "impact" if bounced[k] else laws.closing if now else laws.opening
            taken = impulse[k] if now or bounced[k] else 0.0
            words = mode_word(laws, was), mode_word(laws, now)
            self.records.append(Event(t, name, kind, *words, float(taken), max(float(lost[k]), 0.0) if taken else 0.0))
