"""Transitions: what happens to the laws of a scene at an instant, at the start or where a law reaches its end.

In this order: the states are moved onto the constraints of what is closed or closing; where something closes with a
velocity, impulses change the velocities; then the forces decide which laws hold from here on (`mode.settle`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import LawKind
from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.impact import Impact, collide
from lmoc.numerics.laws.instant import Gauge, Instant, Table
from lmoc.numerics.laws.manifold import Manifold
from lmoc.numerics.laws.mode import Mask, Mode, Settled, settle

AT_ONCE = 1e-10  # s; gaps that would close within that time close together
TOUCHING = 1e-14  # gaps below this share of the lengths that make them are zero
STILL = 1e-11  # rates below this share of the velocities that make them are zero
BOUNCES_LEFT = 1e-9  # s; where all bounces to come would take less, they are over


@dataclass(frozen=True, eq=False)
class Trigger:
    """What has ended a piece.

    Attributes
    ----------
    closing : (n,) open laws whose gap or sliding velocity has come to zero
    opening : (n,) closed laws whose force has come to its end
    direction : (n,) in which friction among them begins to slide
    """

    closing: Mask
    opening: Mask
    direction: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Transition:
    """What follows from an instant.

    Attributes
    ----------
    x : (states,) after impulses
    settled : the new mode with its forces
    impulse, lost : (n,) along the laws, and the energy that each takes out
    impact_law : name of the law of impact, empty without one
    accumulated : (n,) laws whose bounces are over
    until : s, when those bounces would have ended
    """

    x: Array
    settled: Settled
    impulse: Array
    lost: Array
    impact_law: str
    accumulated: Mask
    until: float

    @property
    def mode(self) -> Mode:
        return self.settled.mode


class Transitions:
    """Makes the transitions of one run."""

    def __init__(self, gauge: Gauge) -> None:
        self.gauge, self.table = gauge, gauge.table
        self.manifold = Manifold(gauge)

    def __call__(self, t: float, x: Array, mode: Mode, trigger: Trigger) -> Transition:
        """Return what follows at an instant.

        Raises
        ------
        NoSolution, Unsettled, NoWayBack
            The laws contradict each other.
        """
        table, gaps = self.table, self.table.of(LawKind.UNILATERAL)
        now = self.gauge.at(t, x)
        held = mode.closed | trigger.closing
        touching = gaps & (table.degree >= 1) & (held | _about_to_close(now, self.manifold.scales(t, x)[0]))
        x = self.manifold.project(t, x, touching, held & ~gaps & (table.degree == 2))
        now, scale = self.gauge.at(t, x), self.manifold.scales(t, x)[1]
        striking = table.impulsive & (touching | (held & ~gaps))
        impact, over, until = None, np.zeros(len(gaps), bool), -np.inf
        if (now.rate[striking] < -STILL * scale[striking]).any():
            impact = self._impact(now, striking, table.restitution)
            behind = self._behind(t, x, striking, impact)
            over, until = self._last_bounces(t, behind, mode, striking, trigger)
            if over.any():
                impact = self._impact(now, striking, np.where(over, 0.0, table.restitution))
                behind = self._behind(t, x, striking, impact)
            x, now = behind
            scale = np.maximum(scale, self.manifold.scales(t, x)[1])
        candidate = self._candidates(now, touching, scale) & ~trigger.opening
        settled = settle(table, now, mode, candidate, _sliding(table, now, candidate, trigger))
        closed = settled.mode.closed
        x = self.manifold.project(t, x, closed & gaps & (table.degree >= 1), closed & (table.degree == 2))
        return _transition(x, settled, striking, impact, over, until)

    # ------------------------------------------------------------------ impulses

    def _impact(self, now: Instant, striking: Mask, restitution: Array) -> Impact:
        return collide(now.delassus[np.ix_(striking, striking)], now.rate[striking], restitution[striking])

    def _behind(self, t: float, x: Array, striking: Mask, impact: Impact) -> tuple[Array, Instant]:
        """Return the state behind an impact, and what it gives; the ledger's components do not take part."""
        change = self.gauge.at(t, x).response[:, striking] @ impact.impulse
        change[self.gauge.plan.ledger] = 0.0
        return x + change, self.gauge.at(t, x + change)

    def _last_bounces(
        self, t: float, behind: tuple[Array, Instant], mode: Mode, striking: Mask, trigger: Trigger
    ) -> tuple[Mask, float]:
        """Return which laws have bounced for the last time, and when all their further bounces would be over.

        A law that leaves with rate r under an acceleration −a comes back after 2·r/a; all further bounces together take
        2·r/(a·(1 − e)).
        """
        (_, now), table, e = behind, self.table, self.table.restitution
        leaving = striking & trigger.closing & (now.rate > 0.0) & (e > 0.0) & (e < 1.0)
        if not leaving.any():
            return leaving, -np.inf
        resting = self._candidates(now, striking & ~leaving, np.zeros(len(e)))
        level = settle(table, now, mode, resting, _sliding(table, now, resting, trigger)).level
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(leaving & (level < 0.0), 2 * now.rate / (-level * (1.0 - e)), np.inf)
        over = left < BOUNCES_LEFT
        return over, t + float(left[over].max(initial=-np.inf))

    # ------------------------------------------------------------------ what could be closed

    def _candidates(self, now: Instant, touching: Mask, scale: Array) -> Mask:
        """Return the laws that could be closed without a jump."""
        table, gaps = self.table, self.table.of(LawKind.UNILATERAL)
        still = (np.abs(now.rate) <= STILL * scale) & (touching | ~gaps)
        first = (table.degree == 1) & (touching | ~gaps)
        return (table.degree == 0) | first | ((table.degree == 2) & still)


def _sliding(table: Table, now: Instant, candidate: Mask, trigger: Trigger) -> NDArray[np.int64]:
    """Return the directions of friction that slides: as it moves or, just set free, as its last force has pulled."""
    slides = ~table.complementary & ~candidate
    direction = np.where(slides, np.sign(now.rate), 0.0)
    return np.where(slides & trigger.opening, trigger.direction, direction).astype(int)


def _about_to_close(now: Instant, scale: Array) -> Mask:
    with np.errstate(invalid="ignore"):
        return now.gap <= TOUCHING * scale - AT_ONCE * np.minimum(now.rate, 0.0)


def _transition(
    x: Array, settled: Settled, striking: Mask, impact: Impact | None, over: Mask, until: float
) -> Transition:
    impulse, lost = np.zeros(len(striking)), np.zeros(len(striking))
    if impact is None:
        return Transition(x, settled, impulse, lost, "", over, until)
    impulse[striking], lost[striking] = impact.impulse, impact.lost
    return Transition(x, settled, impulse, lost, impact.law, over, until)
