"""Friction between springs, without a mass or a damper that would make its velocity a state (Jenkins' element).

Its force is a state, and what its law decides about are rates. While the force is within its limits the friction
sticks. At a limit, with the sliding direction d and the rate p of what the force exceeds the limit by,

    p ≥ 0 ⟂ velocity for d = 1,   p ≤ 0 ⟂ velocity for d = −1,   velocities = bias + W·p,

is one complementarity problem for all such friction of a scene, for springs pass rates on to each other. W is the
compliance of the springs, and the answer Prandtl's and Reuss's: elastic steps within the limits, slip along them (W. D.
Iwan, A distributed-element model for hysteresis, J. Appl. Mech. 33, 1966; J. J. Moreau, Evolution problem associated
with a moving convex set, J. Differential Equations 26, 1977).

A force beyond its limit, because the limit has jumped or slips at less than it has held, gives way at once: the springs
move by as much as brings all forces within their limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import JENKINS
from lmoc.ir.program import needed_steps
from lmoc.numerics.laws.complementarity import FREE, LOWER, UPPER, Array, LCPSolution, NoSolution, solve
from lmoc.numerics.laws.contradiction import solving
from lmoc.numerics.laws.instant import ContactKinematics, Instant, LawTable, Mask
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.mode import Mode
from lmoc.numerics.signals.signals import sample
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.support.records import dataclass

_AT_LIMIT = 1e-8  # share of a limit within which a force is at it: so well is it known at usual tolerances
_SHORTLY = 1e-7  # s, or this share of the time: where a velocity that turns has its new sign
_INSTANT = 1e-7  # share of the springs' own movement that is left out where forces jump
_MOVED = 1e-13  # share of the forces below which they have not been moved


@dataclass(frozen=True, eq=False)
class Relaxed:
    """Sprung friction within its limits.

    Attributes
    ----------
    now : the instant behind what has given way
    at_lower, at_upper : (n,) whose force is at its lower limit, at its upper one
    lost : (n,) J, what giving way has cost
    """

    now: Instant
    at_lower: Mask
    at_upper: Mask
    lost: Array

    def behind(self, now: Instant) -> Relaxed:
        """Return the same at another instant."""
        return replace(self, now=now)


class JenkinsRates:
    """The forces of Jenkins friction as they follow from the states, and its velocities in a mode of the others.

    Parameters
    ----------
    plan : of the switched form
    """

    def __init__(self, plan: Plan) -> None:
        form, place = plan.reduced.switched, plan.reduced.register_of
        own = form.degree == JENKINS
        self.force, self.velocity = place[form.force[own]], place[form.level[own]]
        self.program = needed_steps(plan.full_program, np.concatenate([self.force, self.velocity]), plan.count)
        self.interpreter = Interpreter(self.program, plan.count)
        self.by_push = Jacobian(self.program, place[form.push[own]], self.velocity, plan.count)

    def forces(self, kinematics: ContactKinematics, now: Instant) -> Array:
        """Return the forces (k,) with all laws open."""
        return self._filled(kinematics, now, kinematics.base)[self.force]

    def velocities(self, kinematics: ContactKinematics, now: Instant, mode: Mode) -> tuple[Array, Array]:
        """Return the velocities (k,) in a mode, and what rates of the forces change of them, (k, k)."""
        base, place = kinematics.base.copy(), kinematics.plan.reduced.register_of
        for variables, value in mode.inputs(kinematics.form):
            base[place[variables]] = value
        w = self._filled(kinematics, now, base)
        matrix = np.zeros((len(self.velocity), len(self.velocity)))
        matrix[self.by_push.rows, self.by_push.columns] = self.by_push.values(w, now.t)
        return w[self.velocity], matrix

    def _filled(self, kinematics: ContactKinematics, now: Instant, base: Array) -> Array:
        plan, w = kinematics.plan, base.copy()
        w[plan.states] = now.x
        for register, (variable, order) in zip(plan.sampled, plan.samplers, strict=True):
            w[register] = sample(kinematics.signals[variable], order, np.array([now.t]))[0]
        self.interpreter.reset()
        self.interpreter.run(w, now.t)
        return w


def relax(
    kinematics: ContactKinematics, now: Instant, mode: Mode, opening: Mask, direction: NDArray[np.int64]
) -> Relaxed:
    """Bring the forces of Jenkins friction within their limits.

    Parameters
    ----------
    mode : the one before
    opening, direction : laws that begin to slide here, and the direction in which they do

    Raises
    ------
    Contradiction
        No movement of the springs does.
    """
    table = kinematics.table
    own = (table.degree == JENKINS).nonzero()[0]
    at_lower, at_upper, lost = np.zeros_like(opening), np.zeros_like(opening), np.zeros(len(opening))
    if not len(own):
        return Relaxed(now, at_lower, at_upper, lost)
    rates = kinematics.plan.once(JenkinsRates)
    force = rates.forces(kinematics, now)
    compliance = now.delassus[np.ix_(own, own)]
    released = opening[own] | ~mode.closed[own]
    pinned = np.where(opening[own] & table.dry[own], -direction[own], 0)  # begins to slide, at the limit of sliding
    while True:
        lower, upper = _limits(table, now, own, released)
        least = np.where(pinned > 0, upper, lower) - force
        most = np.where(pinned < 0, lower, upper) - force
        with solving(own, "no movement of the springs keeps them"):
            found = solve(compliance, np.zeros(len(own)), least, most, np.full(len(own), FREE))
        yields = ~released & (found.side != FREE)
        if not yields.any():
            break
        released |= yields
        pinned = np.where(yields, found.side, pinned)
    scale = np.abs(force) + np.where(np.isfinite(upper), upper, 0.0)
    rate = _onwards(kinematics, now, own).rate[own]
    if not _moves(compliance, rate, force + found.x, lower, upper, scale):
        with solving(own, "no rates of their forces keep them"):
            found = _jump(compliance, rate, lower - force, upper - force)
    change = np.where(np.abs(found.x) <= _MOVED * scale, 0.0, found.x)
    at_lower[own], at_upper[own] = _at_limits(force + change, lower, upper, scale)
    if change.any():
        lost[own] = -(force + 0.5 * change) * (compliance @ change)
        now = kinematics.at(now.t, now.x + _without_ledger(kinematics, now.response[:, own] @ change))
    return Relaxed(now, at_lower, at_upper, np.maximum(lost, 0.0))


def decide(kinematics: ContactKinematics, relaxed: Relaxed, mode: Mode) -> Mode:
    """Return a mode with what Jenkins friction does in it: stick, or slide in which direction.

    Raises
    ------
    Contradiction
        No rates of the forces satisfy the laws, or they are not determined, as of frictions in a row.
    """
    table, now = kinematics.table, relaxed.now
    jenkins = table.degree == JENKINS
    if not jenkins.any():
        return mode
    own = np.flatnonzero(jenkins)
    at_lower, at_upper = relaxed.at_lower[own], relaxed.at_upper[own]
    onwards = np.where(now.rate[own] < 0.0, -1, 1)
    sliding = np.where(at_lower & at_upper, onwards, np.where(at_upper, -1, 1)) * (at_lower | at_upper)
    sliding[~table.dry[own]] = 0
    direction = mode.direction.copy()
    direction[own] = sliding
    behind = _onwards(kinematics, now, own)
    others = Mode(mode.closed & ~jenkins, direction, mode.implied & ~jenkins, mode.push)
    bias, matrix = kinematics.plan.once(JenkinsRates).velocities(kinematics, behind, others)
    lower, upper = np.where(at_lower, 0.0, -np.inf), np.where(at_upper, 0.0, np.inf)
    with solving(own, "no rates of their forces keep them"):
        found = solve(matrix, bias, lower, upper, np.where(at_upper, UPPER, np.where(at_lower, LOWER, FREE)))
    stuck = (found.side == FREE) & ~(at_lower & at_upper)
    closed = mode.closed.copy()
    closed[own] = stuck
    direction[own] = np.where(stuck, 0, sliding)
    return Mode(closed, direction, mode.implied & ~jenkins, np.where(jenkins, 0.0, mode.push))


def _limits(table: LawTable, now: Instant, own: NDArray[np.int64], slides: Mask) -> tuple[Array, Array]:
    """Return the bounds of the forces; a ratchet between springs only pushes."""
    limit = np.where(slides, now.slip[own], now.stick[own])
    upper = np.where(table.complementary[own], np.inf, limit)
    return np.where(table.complementary[own], 0.0, -upper), upper


def _onwards(kinematics: ContactKinematics, now: Instant, own: NDArray[np.int64]) -> Instant:
    """Return an instant at which velocities that are prescribed and just turn have their new signs."""
    if (np.abs(now.rate[own]) > _SHORTLY * now.rate_scale[own]).any():
        return now
    return kinematics.at(now.t + _SHORTLY * max(1.0, abs(now.t)), now.x)


def _at_limits(force: Array, lower: Array, upper: Array, scale: Array) -> tuple[Mask, Mask]:
    return force <= lower + _AT_LIMIT * scale, force >= upper - _AT_LIMIT * scale


def _moves(compliance: Array, rate: Array, force: Array, lower: Array, upper: Array, scale: Array) -> bool:
    """Return whether the rates of the forces, at constant limits, are determined: each friction sticks or slides."""
    at_lower, at_upper = _at_limits(force, lower, upper, scale)
    try:
        found = solve(compliance, rate, np.where(at_lower, 0.0, -np.inf), np.where(at_upper, 0.0, np.inf))
    except NoSolution:
        return False
    return bool(found.unique.all())


def _jump(compliance: Array, rate: Array, least: Array, most: Array) -> LCPSolution:
    """Return the changes of forces that rise at once to where one slides, for what moves them does not yield.

    They are those of a step of time that is too short for anything else to move.
    """
    stiffest = np.diag(compliance).max() / max(np.abs(rate).max(), np.finfo(float).tiny)
    room = (most - least)[np.isfinite(most - least)].max(initial=0.0)
    found = solve(compliance, rate * (_INSTANT * stiffest * room), least, most)
    free = found.side == FREE
    change = np.where(found.side == LOWER, least, np.where(found.side == UPPER, most, 0.0))
    pushed = compliance[np.ix_(free, ~free)] @ change[~free]
    change[free] = np.linalg.lstsq(compliance[np.ix_(free, free)], -pushed, rcond=None)[0]
    return replace(found, x=change)


def _without_ledger(kinematics: ContactKinematics, change: Array) -> Array:
    change[kinematics.plan.ledger] = 0.0
    return change
