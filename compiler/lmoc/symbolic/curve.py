"""States of rest along the curve on which a mechanism with one degree of freedom moves.

Where a coordinate turns back (that of a pendulum seen from the side, of a rocker at its limits) it cannot go on, but
the curve in all coordinates does. It is followed by its tangent, the null space of the closures' Jacobian, and
corrections of shortest length: pseudo-arclength continuation (H. B. Keller, in: Applications of Bifurcation Theory
(1977) 359). A state of rest is where the acceleration along the tangent changes sign. Where the least singular value of
the Jacobian has a minimum of zero, another branch crosses, and the walk goes straight on; where several vanish at once,
the mechanism is free to go on in several ways, and the walk ends.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.support.records import dataclass

Vector = np.ndarray

LONGEST = 0.02  # of a step, in radians or sizes of the mechanism
SHORTEST = 1e-7
MOST_STEPS = 2000  # each way
TURN = 0.05  # rad, of the tangent in a step
CORRECTIONS = 8
EXACT = 1e-11
REACH = 10.0  # how far lengths go, in sizes of the mechanism
HALVINGS = 45
THIRDS = 24  # of an interval in which the least singular value has a minimum
NEAR = 0.05  # of the largest singular value: a least one that may vanish near by
CROSSES = 1e-3  # and one that does
SEVERAL = 10.0  # times as large is another one that vanishes at the same place


@dataclass(frozen=True, eq=False)
class LoopCurve:
    """A mechanism with one degree of freedom in all coordinates of its loops.

    Attributes
    ----------
    evaluate : from (n,) coordinates to their (n,) accelerations with velocities zero, the (n − 1,) closures, which
        vanish, and the (n − 1, n) Jacobian of these
    scale : (n,) units in which coordinates are comparable: 1 of angles, the size of the mechanism of lengths
    turning : (n,) which of them are angles
    redundant : closures have been left out that follow from others; where the Jacobian is singular does not matter then
    """

    evaluate: Callable[[Vector], tuple[Vector, Vector, Vector]]
    scale: Vector
    turning: Vector
    redundant: bool

    def apart(self, y: Vector, other: Vector) -> Vector:
        """Return the difference of two places in units of `scale`, of angles within half a turn."""
        d = (y - other) / self.scale
        return np.where(self.turning, d - 2 * np.pi * np.round(d / (2 * np.pi)), d)


@dataclass(frozen=True, eq=False)
class Spot:
    """A place on the curve.

    Attributes
    ----------
    y : (n,) coordinates
    tangent : (n,) unit vector along the curve, in units of the scale
    acceleration : along the tangent
    singular : (n − 1,) singular values of the Jacobian, of the largest
    """

    y: Vector
    tangent: Vector
    acceleration: float
    singular: Vector

    @property
    def least(self) -> float:
        return float(self.singular[-1])


@dataclass(frozen=True, eq=False)
class Walk:
    """The states of rest on a curve, (n,) each, and in words how far the walk went along it."""

    found: list[Vector]
    end: str


def walk(curve: LoopCurve, start: Vector) -> Walk:
    """Return the states of rest on the curve through a place, both ways from it."""
    here = _spot(curve, start, None)
    if here is None:
        return Walk([], "the closures are singular at the start")
    forward, end, crossed = _one_way(curve, here)
    if end == "":
        others = ", which other branches cross" if crossed else ""
        return Walk(_different(curve, forward), f"all along the closed curve through the start{others}")
    back = Spot(here.y, -here.tangent, -here.acceleration, here.singular)
    backward, other, again = _one_way(curve, back)
    ends = " and ".join(dict.fromkeys([end, other or "a place met before"]))
    others = ", which other branches cross," if crossed or again else ""
    return Walk(_different(curve, forward + backward), f"along the curve through the start{others} up to {ends}")


def _one_way(curve: LoopCurve, here: Spot) -> tuple[list[Vector], str, bool]:
    """Return the states of rest from a place on, what the walk came to, and whether it crossed another branch.

    It came to nothing where it came back to the start.
    """
    found: list[Vector] = []
    crossed = False
    before = begin = here
    step, gone = LONGEST / 4, 0.0
    for _ in range(MOST_STEPS):
        there = _spot(curve, here.y + step * curve.scale * here.tangent, here.tangent)
        if there is None or not _follows(curve, here, there, step):
            step /= 2
            if step < SHORTEST:
                return found, "where it cannot go on", crossed
            continue
        if not curve.redundant:
            lost = _lost_rank(curve, before, here, there)
            if lost > 1:
                return found, "where several branches meet", crossed
            crossed = crossed or lost > 0
        if there.acceleration * here.acceleration <= 0 and here.acceleration != 0:
            found += _refined(curve, here, there)
        elif here.acceleration == 0 and here is begin:
            found.append(here.y)
        gone += step
        back = curve.apart(begin.y, there.y)
        if gone > 4 * LONGEST and np.linalg.norm(back) < 2 * step and there.tangent @ begin.tangent > 0.9:
            if there.tangent @ back <= 0:
                return found, "", crossed
        if np.abs((there.y - begin.y) / curve.scale)[~curve.turning].max(initial=0.0) > REACH:
            return found, f"{REACH:g} of its sizes away", crossed
        before, here, step = here, there, min(1.5 * step, LONGEST)
    return found, f"{MOST_STEPS} steps away", crossed


def _follows(curve: LoopCurve, here: Spot, there: Spot, step: float) -> bool:
    """Return whether a place is the next one on the same branch."""
    moved = float(np.linalg.norm((there.y - here.y) / curve.scale))
    return moved < 1.5 * step and float(here.tangent @ there.tangent) > np.cos(TURN)


def _lost_rank(curve: LoopCurve, before: Spot, here: Spot, there: Spot) -> int:
    """Return how many singular values vanish between three places in a row."""
    if not (here.least <= min(before.least, there.least) and here.least < NEAR):
        return 0
    at = here
    low, high = before.y, there.y
    for _ in range(THIRDS):
        left, right = (_spot(curve, low + k / 3 * (high - low), here.tangent) for k in (1, 2))
        if left is None or right is None:  # too near for the place on the curve to be told
            break
        at = min(at, left, right, key=lambda spot: spot.least)
        low, high = (low, right.y) if left.least < right.least else (left.y, high)
    return int(np.sum(at.singular < SEVERAL * CROSSES)) if at.least < CROSSES else 0


def _spot(curve: LoopCurve, y: Vector, along: Vector | None) -> Spot | None:
    """Return the place on the curve next to another place, None where there is none near by.

    Parameters
    ----------
    along : a tangent before it, which says which way is forward
    """
    for _ in range(CORRECTIONS):
        accelerations, closures, slopes = curve.evaluate(y)
        matrix = slopes * curve.scale
        if not (np.isfinite(closures).all() and np.isfinite(matrix).all()):
            return None
        step = np.linalg.lstsq(matrix, closures, rcond=1e-10)[0]
        if np.abs(step).max(initial=0.0) < EXACT:
            _, singular, right = np.linalg.svd(matrix)
            tangent = right[-1]
            tangent = tangent if along is None or along @ tangent > 0 else -tangent
            acceleration = float(tangent @ (accelerations / curve.scale))
            singular = singular / singular[0] if singular[0] > 0 else singular
            return Spot(y, tangent, acceleration, singular) if np.isfinite(acceleration) else None
        y = y - curve.scale * step
    return None


def _refined(curve: LoopCurve, low: Spot, high: Spot) -> list[Vector]:
    """Return the state of rest between two places by bisection; none where the acceleration has a pole there."""
    least = min(abs(low.acceleration), abs(high.acceleration))
    if high.acceleration == 0:
        return [high.y]
    for _ in range(HALVINGS):
        middle = _spot(curve, 0.5 * (low.y + high.y), low.tangent)
        if middle is None:
            return []
        low, high = (middle, high) if middle.acceleration * low.acceleration > 0 else (low, middle)
    return [low.y] if abs(low.acceleration) <= least else []


def _different(curve: LoopCurve, found: list[Vector]) -> list[Vector]:
    """Return the places that are not the same; angles within a turn."""
    unique: list[Vector] = []
    for y in found:
        if not any(np.abs(curve.apart(y, other)).max(initial=0.0) < 1e-6 for other in unique):
            unique.append(y)
    return unique
