"""The next mode: which laws hold once everything at an instant is taken together.

Laws that could be closed without a jump, a gap and its rate at zero, a sliding velocity at zero, are candidates.
Their forces solve one complementarity problem on the level at which each is felt, dry friction between its limits.
What reaches a sticking limit has its slipping limit from there on, and the problem is solved again; friction that ends
at a limit slides. Several frictions on one motion share the load up to the sum of their limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import FREE, LOWER, Array, Sides, solve
from lmoc.numerics.laws.cones import Friction, solve_with_cones
from lmoc.numerics.laws.contradiction import Contradiction, solving
from lmoc.numerics.laws.instant import Instant, LawTable, Mask
from lmoc.numerics.limits import AT_LIMIT
from lmoc.numerics.problem.mode import Mode
from lmoc.structure.laws.switched import POSITION
from lmoc.support.records import dataclass

IMPLIED = 1e-9  # what elimination leaves of the diagonal of a law that depends on others
STILL = 1e-11  # rates below this share of the velocities that make them are zero
ROUNDING = 1e-10  # by which a contact friction may pass its limit and still stick
RESTING = 1e-9  # share of its terms below which an acceleration is zero
HELD = 0.1  # of the acceleration by this share of its limit: if it is less, others hold friction at its limit


@dataclass(frozen=True, eq=False)
class Settled:
    """A mode with its forces.

    Attributes
    ----------
    mode : Mode
    force, level : (n,) forces of the laws, and the level quantities that they lead to
    unique : (n,) whether the force is determined
    """

    mode: Mode
    force: Array
    level: Array
    unique: Mask


def settle(
    table: LawTable,
    now: Instant,
    mode: Mode,
    candidate: Mask,
    sliding: NDArray[np.int64],
    at_limit: NDArray[np.int64],
    opening: Mask | None = None,
) -> Settled:
    """Return the mode that holds from an instant on.

    Parameters
    ----------
    mode : the one before; where both sides of a law would do, it stays where it was
    candidate : (n,) laws that could be closed from here on
    sliding : (n,) direction of friction that is no candidate
    at_limit : (n,) direction in which stuck friction begins to slide that has just reached its limit, else 0
    opening : (n,) laws that could be closed but open here; others may hold their motion

    Raises
    ------
    Contradiction
        No forces satisfy the laws, such as a body pressed between two stops, or Painlevé's paradox.
    """
    if not candidate.any() and (opening is None or not opening.any()):
        return _all_open(table, now, sliding)
    try:
        found = _by_pivoting(table, now, mode, candidate, sliding, at_limit, opening)
        if not _slides_backwards(table, now, candidate, found):
            return found
    except Contradiction:
        if not _rubbing(table, candidate).any():
            raise
    turned = _by_cones(table, now, candidate, sliding)
    return _by_pivoting(table, now, mode, candidate & (turned == sliding), turned, at_limit, opening)


def _all_open(table: LawTable, now: Instant, sliding: NDArray[np.int64]) -> Settled:
    """Return the mode in which no law is closed: forces are those of sliding friction."""
    direction, nobody = np.where(table.complementary, 0, sliding), np.zeros(len(sliding), bool)
    force = _sliding_forces(table, now, direction)[0]
    mode = Mode(nobody, direction, nobody, np.zeros(len(sliding)))
    return Settled(mode, force, now.bias + now.delassus @ force, ~nobody)


def _by_pivoting(
    table: LawTable,
    now: Instant,
    mode: Mode,
    candidate: Mask,
    sliding: NDArray[np.int64],
    at_limit: NDArray[np.int64],
    opening: Mask | None,
) -> Settled:
    """Return the mode by block pivoting, with each friction beyond its limit set free; otherwise as `settle`."""
    stuck = candidate.copy()
    released = np.zeros_like(candidate)
    pinned = np.where(candidate & table.dry, at_limit, 0)  # at the limit: do others hold more?
    direction = np.where(stuck | table.complementary, 0, sliding)
    side = np.where(mode.closed | candidate, FREE, LOWER)
    share = 1.0 - AT_LIMIT if pinned.any() else 1.0
    while True:
        limit = share * np.where(released, np.minimum(now.slip, now.stick), now.stick)
        bounds = _bounds(table, candidate, limit, np.where(released, 0, pinned))
        force, side, unique = _forces(table, now, stuck, direction, side, bounds)
        level = now.bias + now.delassus @ force
        alone = np.diag(now.delassus) * AT_LIMIT * limit  # its acceleration, were there nobody else to hold more
        spare = table.dry & ~released & (limit > 0.0) & (np.abs(level) <= HELD * alone)
        passes = stuck & table.dry & (side != FREE) & ~released & ~spare
        weaker = passes & ((now.slip < now.stick) | (pinned != 0))
        slips = stuck & table.contact & _beyond_cone(table, now, force)
        if not weaker.any() and not slips.any():
            break
        released |= passes
        direction[slips] = -np.sign(force[slips]).astype(int)
        stuck &= ~slips
    closed = stuck & ((side == FREE) | spare)
    slides = stuck & table.dry & ~closed
    onwards = np.where(level < 0.0, -1, 1)  # without a force, friction slides as it is moved
    direction[slides] = np.where(force == 0.0, onwards, -np.sign(force))[slides].astype(int)
    terms = np.abs(now.bias) + np.abs(now.delassus) @ np.abs(force)
    open_ = (candidate if opening is None else candidate | opening) & ~closed
    resting = open_ & (np.abs(level) <= RESTING * terms) & (table.degree == POSITION)
    resting |= (direction != 0) & candidate
    implied = np.zeros_like(closed)
    if resting.any() or (closed & (side != FREE)).any() or not unique[closed].all():
        implied = _implied(table, now, direction, closed, resting, side)
        # where a motion turns, a force in its direction may do nothing for an instant: nobody holds it there
        implied &= closed | (np.abs(level) <= RESTING * terms)
    push = np.where(closed & implied, np.where(side == FREE, force, force / share), 0.0)
    return Settled(Mode(closed, direction, implied, push), force, level, unique)


def _rubbing(table: LawTable, candidate: Mask) -> Mask:
    """Return the contact friction among the candidates whose contact is one, too."""
    return candidate & table.contact & candidate[table.normal]


def _slides_backwards(table: LawTable, now: Instant, candidate: Mask, found: Settled) -> bool:
    """Return whether contact friction that has been set free would slide against the direction of its force."""
    force, onwards = found.force, found.level * found.mode.direction
    terms = np.abs(now.bias) + np.abs(now.delassus) @ np.abs(force)
    freed = _rubbing(table, candidate) & (found.mode.direction != 0)
    return bool((onwards[freed] < -RESTING * terms[freed]).any())


def _by_cones(table: LawTable, now: Instant, candidate: Mask, sliding: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the directions of sliding, (n,), with those of contact friction that cannot hold, by Lemke's algorithm."""
    active = np.flatnonzero(candidate)
    constant, share = _sliding_forces(table, now, sliding)
    spread = np.eye(len(candidate))[:, active] + share[:, active]
    lower, upper = _bounds(table, candidate, now.stick, np.zeros_like(sliding))[:, active]
    rough = np.flatnonzero(_rubbing(table, candidate)[active])
    normal = np.searchsorted(active, table.normal[active[rough]])
    friction = Friction(rough, normal, now.stick[active[rough]])
    q = now.bias[active] + now.delassus[active] @ constant
    with solving(active, "no forces keep them"):
        found = solve_with_cones(now.delassus[active] @ spread, q, lower, upper, friction)
    turned = sliding.copy()
    slides = rough[found.side[rough] != FREE]
    turned[active[slides]] = -found.side[slides]
    return turned


def _forces(
    table: LawTable, now: Instant, stuck: Mask, direction: NDArray[np.int64], side: Sides, bounds: Array
) -> tuple[Array, Sides, Mask]:
    """Solve for the forces of the laws in `stuck`; those of sliding friction follow from them."""
    n = len(stuck)
    active = np.flatnonzero(stuck)
    constant, share = _sliding_forces(table, now, direction)
    matrix = now.delassus[np.ix_(active, active)]
    if share.any():
        matrix = matrix + now.delassus[active] @ share[:, active]
    q = now.bias[active] + now.delassus[active] @ constant
    with solving(active, "no forces keep them"):
        found = solve(matrix, q, bounds[0, active], bounds[1, active], side[active])
    sides, unique, force = np.full(n, LOWER), np.ones(n, bool), constant + share[:, active] @ found.x
    sides[active], unique[active] = found.side, found.unique
    force[active] += found.x
    return force, sides, unique


def _bounds(table: LawTable, candidate: Mask, limit: Array, pinned: NDArray[np.int64]) -> Array:
    """Return the bounds (2, n) of forces; equal ones for friction that is pinned to its limit.

    The limits of contact friction follow from other forces and are looked at afterwards; that of an open contact is 0.
    """
    airborne = table.contact & ~candidate[table.normal]
    upper = np.where(table.dry, limit, np.where(airborne, 0.0, np.inf))
    lower = np.where(table.complementary, 0.0, -upper)
    at = -pinned * np.nan_to_num(limit)
    return np.where(pinned != 0, at, np.stack([lower, upper]))


def _implied(
    table: LawTable, now: Instant, direction: NDArray[np.int64], closed: Mask, resting: Mask, side: Sides
) -> Mask:
    """Return the closed and resting laws that depend on other closed ones, by Gaussian elimination.

    Complementarities come first, so that friction rather than these is found to depend on others, and friction at its
    limit rather than friction that can hold more.

    Only the sum of what dependent laws do is determined. An implied one keeps the force that it has, and the others
    do the rest until one of them reaches its limit.
    """
    _, share = _sliding_forces(table, now, direction)
    friction = closed & ~table.complementary
    groups = closed & table.complementary, friction & (side == FREE), friction & (side != FREE), resting
    order = np.concatenate([np.flatnonzero(g) for g in groups])
    whole = now.delassus + now.delassus @ share if share.any() else now.delassus
    matrix = whole[np.ix_(order, order)]
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    work = matrix / np.outer(scale, scale)
    implied = np.zeros(len(closed), bool)
    for k, law in enumerate(order):
        if work[k, k] <= IMPLIED:
            implied[law] = True
            continue
        if resting[law]:  # it begins to move, and holds nothing
            continue
        others = k + 1 + np.flatnonzero(work[k + 1 :, k])
        work[others] -= np.outer(work[others, k] / work[k, k], work[k])
    return implied


def _sliding_forces(table: LawTable, now: Instant, direction: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the forces of sliding friction: constants, and shares of the other laws' forces."""
    n = len(direction)
    slides = direction != 0
    constant, share = np.zeros(n), np.zeros((n, n))
    dry = slides & table.dry
    constant[dry] = -direction[dry] * now.slip[dry]
    on = (slides & table.contact).nonzero()[0]
    share[on, table.normal[on]] = -direction[on] * now.slip[on]
    return constant, share


def _beyond_cone(table: LawTable, now: Instant, force: Array) -> Mask:
    """Return which contact friction pulls with more than its share of the normal force."""
    contact, beyond = table.contact, np.zeros(len(force), bool)
    limit = now.stick[contact] * np.maximum(force[table.normal[contact]], 0.0)
    beyond[contact] = np.abs(force[contact]) > limit * (1 + ROUNDING)
    return beyond


def free_mode(table: LawTable) -> Mode:
    """Return the mode in which every law is open and no friction slides."""
    n = len(table.kind)
    return Mode(np.zeros(n, bool), np.zeros(n, int), np.zeros(n, bool), np.zeros(n))
