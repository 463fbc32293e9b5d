"""Transitions: what happens to the laws of a scene at an instant, at the start or where a law reaches its end.

In this order: the states are moved onto the constraints of what is closed or closing; where something closes with a
velocity, impulses change the velocities; then the forces decide which laws hold from here on (`mode.settle`, and
`jenkins` where the law acts between springs).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import JENKINS
from lmoc.numerics.laws.complementarity import FREE, LOWER, Array
from lmoc.numerics.laws.cones import Friction
from lmoc.numerics.laws.contradiction import Contradiction, solving
from lmoc.numerics.laws.impact import Impact, collide, depends_on_order
from lmoc.numerics.laws.instant import ContactKinematics, Instant, LawTable, Mask
from lmoc.numerics.laws.jenkins import decide, relax
from lmoc.numerics.laws.manifold import project
from lmoc.numerics.laws.mode import STILL, Settled, settle
from lmoc.numerics.limits import LOCATED
from lmoc.numerics.problem.mode import Mode
from lmoc.support.records import dataclass

AT_ONCE = 1e-10  # s; gaps that would close within that time close together
TOUCHING = 1e-14  # gaps below this share of the lengths that make them are zero
TURNING = 1e-8  # s; a velocity that its accelerations undo in that time has come to zero by itself, not by a jump
BOUNCES_LEFT = 1e-9  # s; where all bounces to come would take less, they are over …
LEAST_HEIGHT = 1e-14  # … as where they are lower than this share of the lengths that make the gap …
_TOGETHER = 1e4  # … or as this many where gaps that cannot be told from zero close among bounces without loss
_HOLDS = 1e-6  # share of what a law alone would have to hold: beyond it a force is none of rounding
_RESOLVED = 1e3  # … or than this many errors that the integrator allows itself


@dataclass(frozen=True, eq=False)
class Trigger:
    """The reason for the end of a segment.

    Attributes
    ----------
    closing : (n,) open laws whose gap or sliding velocity has come to zero
    opening : (n,) laws whose force has come to its end here; those that have opened at the same time before among them
    direction : (n,) in which friction among them begins to slide
    jumped : the states have been changed from outside: what is closed may move
    """

    closing: Mask
    opening: Mask
    direction: NDArray[np.int64]
    jumped: bool = False

    @classmethod
    def nothing(cls, count: int) -> Trigger:
        return cls(np.zeros(count, bool), np.zeros(count, bool), np.zeros(count, int))


@dataclass(frozen=True, eq=False)
class Transition:
    """The consequences of an instant.

    Attributes
    ----------
    before, now : the instants before and behind the impulses, moved onto what is closed
    settled : the new mode with its forces
    impulse, lost : (n,) along the laws, and the energy that each takes out
    impact_law : name of the law of impact, empty without one
    touched : (n,) laws whose motion, the gap or the velocity that closes it, is zero
    accumulated : (n,) laws whose bounces are over
    until : s, when those bounces would have ended
    undecided : (n,) laws that would be left with other rates if they were hit one after the other
    """

    before: Instant
    now: Instant
    settled: Settled
    impulse: Array
    lost: Array
    impact_law: str
    touched: Mask
    accumulated: Mask
    until: float
    undecided: Mask

    @property
    def x(self) -> Array:
        return self.now.x

    @property
    def mode(self) -> Mode:
        return self.settled.mode


def transition(
    kinematics: ContactKinematics, t: float, x: Array, mode: Mode, trigger: Trigger, unresolved: Array | float = 0.0
) -> Transition:
    """Return what follows at an instant.

    Parameters
    ----------
    unresolved : (states,) what the integrator tells the states apart by no more, such as a multistep method that has
        just begun

    Raises
    ------
    Contradiction
        The laws contradict each other.
    """
    table = kinematics.table
    now = kinematics.at(t, x)
    holding = mode.closed & (_turning(now) | (not trigger.jumped))
    held = mode.closed | trigger.closing
    touching = table.unilateral & (table.degree >= 1) & (held | _about_to_close(now))
    at_rest = holding | (trigger.closing & _turning(now))
    still = (at_rest & ~table.unilateral) | holding  # up to what integration leaves of zero: no impact
    before = now = project(kinematics, now, touching, still & (table.degree == 2))
    striking = table.impulsive & (touching | ~table.unilateral)  # an open ratchet may be driven back by an impact
    sharing = striking | _rubbing(table, striking)
    impact, over, until, further = None, np.zeros(len(held), bool), -np.inf, 0.0
    least = _least_rate(now)
    if (now.rate[striking] < -least[striking]).any():
        impact = _impact(table, before, sharing, mode.closed, table.restitution)
        now = _behind(kinematics, before, sharing, impact)
        least = np.maximum(np.maximum(least, _least_rate(now)), _rounded(before, sharing, impact))
        apart = unresolved if isinstance(unresolved, np.ndarray) else np.full(len(x), unresolved)
        errors = np.abs(now.slope[0]) @ apart
        lowest = np.maximum(LEAST_HEIGHT * now.gap_scale, _RESOLVED * errors)
        over, until = _bounces_over(table, now, mode, striking, trigger, least, lowest)
        if over.any():
            impact = _impact(table, before, sharing, mode.closed, np.where(over, 0.0, table.restitution))
            now = _behind(kinematics, before, sharing, impact)
        least = np.maximum(least, _least_rate(now))
        thrown = _thrown_for_nothing(table, now, mode, touching, least, trigger, lowest)
        if thrown.any():
            resting = table.impulsive & touching & (np.abs(now.rate) <= least)
            now, further = _together(kinematics, now, thrown | resting)
            least = np.maximum(least, _least_rate(now))
    if impact is None:  # what has been closed is at rest, however slow the scene
        least = np.where(holding, np.inf, least)
    relaxed = relax(kinematics, now, mode, trigger.opening, trigger.direction)
    now = relaxed.now
    candidate = _candidates(table, now, touching, least)
    now = kinematics.without_rounding(now, candidate & table.unilateral)
    settled = _settled(table, now, mode, candidate, trigger)
    closed = settled.mode.closed
    now = project(kinematics, now, closed & table.unilateral & (table.degree >= 1), closed & (table.degree == 2))
    sprung = table.degree == JENKINS
    if sprung.any():
        settled = replace(settled, mode=decide(kinematics, replace(relaxed, now=now), settled.mode))
    impulse, lost = np.zeros(len(held)), np.zeros(len(held))
    if impact is not None:
        impulse[sharing], lost[sharing] = impact.impulse, impact.lost
        lost[impulse.argmax()] += further  # what all later impacts take counts as this one's
        rubbing = (sharing & table.contact).nonzero()[0]  # what friction takes counts as its contact's
        np.add.at(lost, table.normal[rubbing], lost[rubbing])
        impulse[rubbing] = lost[rubbing] = 0.0
    lost += relaxed.lost
    touched = touching | (candidate & ~table.unilateral) | sprung
    undecided = _undecided(table, before, sharing, impact, over)
    law = impact.law if impact else ""
    return Transition(before, now, settled, impulse, lost, law, touched, over, until, undecided)


def _settled(table: LawTable, now: Instant, mode: Mode, candidate: Mask, trigger: Trigger) -> Settled:
    """Return the mode that holds from here on.

    A force that has come to zero by itself is zero up to rounding, and its law opens. Where other laws open at the same
    instant it may have to hold after all: as of two that a jump of a load has set free.
    """
    at_limit = np.where(trigger.opening, trigger.direction, 0)
    releasing = trigger.opening & ~table.dry & candidate
    if releasing.any() and np.count_nonzero(mode.closed) > 1:
        try:
            found = settle(table, now, mode, candidate, _sliding(table, now, candidate, trigger), at_limit)
        except Contradiction:
            found = None
        if found is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                alone = np.abs(now.bias / np.diag(now.delassus))
            releasing &= ~(found.mode.closed & found.unique & (found.force > _HOLDS * np.nan_to_num(alone)))
    left = candidate & ~releasing
    return settle(table, now, mode, left, _sliding(table, now, left, trigger), at_limit, releasing)


def resisted(kinematics: ContactKinematics, now: Instant, closed: Mask) -> Instant:
    """Return an instant behind impulses by which closed laws resist rates that would close them further."""
    striking = kinematics.table.impulsive & closed
    if not (now.rate[striking] < -_least_rate(now)[striking]).any():
        return now
    sharing = striking | _rubbing(kinematics.table, striking)
    return _behind(kinematics, now, sharing, _impact(kinematics.table, now, sharing, closed, np.zeros(len(closed))))


def _turning(now: Instant) -> Mask:
    """Return whose rates are what the location of a root leaves of zero."""
    return np.abs(now.rate) <= STILL * now.rate_scale + TURNING * now.acceleration


def _least_rate(now: Instant) -> Array:
    """Return the rates below which a motion is at rest: rounding of the velocities, and of the time of the event."""
    return STILL * now.rate_scale + LOCATED * max(1.0, abs(now.t)) * now.acceleration


def _rounded(before: Instant, sharing: Mask, impact: Impact) -> Array:
    """Return the rates that are zero behind impulses that cancel, such as those that a body at rest passes on."""
    return STILL * np.abs(before.delassus[:, sharing]) @ np.abs(impact.impulse)


# ---------------------------------------------------------------------- impulses


def _rubbing(table: LawTable, striking: Mask) -> Mask:
    """Return which frictions have their contacts among the laws that strike."""
    return table.contact & (table.degree == 2) & striking[np.where(table.contact, table.normal, 0)]


def _impact(table: LawTable, now: Instant, striking: Mask, held: Mask, restitution: Array) -> Impact:
    which = striking.nonzero()[0]
    rows = table.contact[which].nonzero()[0]
    normal = which.searchsorted(table.normal[which[rows]])
    friction = Friction(rows, normal, now.stick[which[rows]])
    with solving(which, "no impulses keep them"):
        matrix, rate = now.delassus[which[:, None], which], now.rate[which]
        at_rest = held[which] & (np.abs(rate) <= _least_rate(now)[which])  # up to rounding, which would cost energy
        rate = np.where(at_rest, 0.0, rate)
        side = np.where(held[which] | (rate < 0.0), FREE, LOWER)  # what is closed takes part in most impacts
        return collide(matrix, rate, restitution[which], friction, side)


def _undecided(table: LawTable, now: Instant, sharing: Mask, impact: Impact | None, over: Mask) -> Mask:
    """Return the laws of an impact that would have another outcome if they were hit one after the other."""
    found = np.zeros(len(sharing), bool)
    if impact is None or np.count_nonzero(impact.impulse) < 2 or over.any() or (sharing & table.contact).any():
        return found
    which = np.flatnonzero(sharing)
    matrix, e = now.delassus[np.ix_(which, which)], table.restitution[which]
    if depends_on_order(matrix, now.rate[which], e, impact.rate):
        found[which] = impact.impulse != 0.0
    return found


def _behind(kinematics: ContactKinematics, now: Instant, striking: Mask, impact: Impact) -> Instant:
    """Return the instant behind an impact; the ledger's components do not take part."""
    change = now.response[:, striking] @ impact.impulse
    change[kinematics.plan.ledger] = 0.0
    return kinematics.at(now.t, now.x + change)


def _bounces_over(
    table: LawTable, now: Instant, mode: Mode, striking: Mask, trigger: Trigger, least: Array, lowest: Array
) -> tuple[Mask, float]:
    """Return which laws have bounced for the last time, and when all their further bounces would be over."""
    leaving = striking & (now.rate > least)
    if not (leaving & trigger.closing & (table.restitution > 0.0)).any():
        return np.zeros(len(leaving), bool), -np.inf
    level = _level(table, now, mode, _candidates(table, now, striking & ~leaving, least), trigger)
    over, until = _last_bounces(table, now, leaving & trigger.closing, level, lowest)
    return over | _last_elastic(table, now, leaving, striking, level, trigger, lowest), until


def _last_bounces(table: LawTable, now: Instant, leaving: Mask, level: Array, lowest: Array) -> tuple[Mask, float]:
    """Return the same of laws that lose energy by themselves.

    A law that leaves with rate r under an acceleration −a comes back after 2·r/a; all further bounces together take
    2·r/(a·(1 − e)).
    """
    e = table.restitution
    leaving = leaving & (e > 0.0) & ~table.lossless & (level < 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(leaving, 2 * now.rate / (-level * (1.0 - e)), np.inf)
    over = (left < BOUNCES_LEFT) | (leaving & (now.rate**2 <= -2 * level * lowest))
    return over, now.t + float(left[over].max(initial=-np.inf))


def _last_elastic(
    table: LawTable, now: Instant, leaving: Mask, striking: Mask, level: Array, trigger: Trigger, lowest: Array
) -> Mask:
    """Return which laws have bounced for the last time with a law of e = 1 that other laws take the energy from.

    Alone, such a law bounces for ever. Beside one that takes energy, as a ball on another one on a steel floor, all
    bounces tend to rest together; when their heights are no longer told from zero, neither are the gaps between them.
    """
    elastic = leaving & trigger.closing & table.lossless
    taking = striking & ~table.lossless
    elastic &= (now.delassus[:, taking] != 0.0).any(axis=1)
    low = leaving & (level < 0.0) & (now.rate**2 <= -2 * level * _TOGETHER * lowest)
    return low if (elastic & low).any() else np.zeros(len(leaving), bool)


def _level(table: LawTable, now: Instant, mode: Mode, candidate: Mask, trigger: Trigger) -> Array:
    """Return the level quantities to which the forces lead that act while these laws are the candidates."""
    sliding = _sliding(table, now, candidate, trigger)
    return settle(table, now, mode, candidate, sliding, np.zeros(len(candidate), int)).level


def _thrown_for_nothing(
    table: LawTable, now: Instant, mode: Mode, touching: Mask, least: Array, trigger: Trigger, lowest: Array
) -> Mask:
    """Return closed laws that an impact opens by a gap that cannot be told from zero, before they close again.

    Two strings without restitution may throw each other open in turn, ever shorter: that ends with both of them taut.
    """
    thrown = touching & table.impulsive & mode.closed & (now.rate > least)
    if not thrown.any():
        return thrown
    resting = _candidates(table, now, touching & ~thrown, least) & ~thrown
    level = _level(table, now, mode, resting, trigger)
    return thrown & (level < 0.0) & (now.rate**2 <= -2 * level * lowest)


def _together(kinematics: ContactKinematics, now: Instant, held: Mask) -> tuple[Instant, float]:
    """Return the instant behind the impulses that bring these laws to rest, as all further impacts together do.

    The second value is the energy that they take, in J.
    """
    which = np.flatnonzero(held)
    impulse = np.linalg.lstsq(now.delassus[np.ix_(which, which)], -now.rate[which], rcond=None)[0]
    change = now.response[:, which] @ impulse
    change[kinematics.plan.ledger] = 0.0
    return kinematics.at(now.t, now.x + change), -0.5 * float(impulse @ now.rate[which])


# ---------------------------------------------------------------------- what could be closed


def _candidates(table: LawTable, now: Instant, touching: Mask, least: Array) -> Mask:
    """Return the laws that could be closed without a jump."""
    reached = touching | ~table.unilateral
    still = (np.abs(now.rate) <= least) & reached
    return (table.degree == 0) | ((table.degree == 1) & reached) | ((table.degree == 2) & still)


def _sliding(table: LawTable, now: Instant, candidate: Mask, trigger: Trigger) -> NDArray[np.int64]:
    """Return the directions of friction that slides: as it moves or, just set free, as its last force has pulled."""
    slides = ~table.complementary & ~candidate & (table.degree != JENKINS)
    direction = np.where(slides, np.sign(now.rate), 0.0)
    return np.where(slides & trigger.opening, trigger.direction, direction).astype(int)


def _about_to_close(now: Instant) -> Mask:
    with np.errstate(invalid="ignore"):
        return now.gap <= TOUCHING * now.gap_scale - AT_ONCE * np.minimum(now.rate, 0.0)
