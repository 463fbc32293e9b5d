"""Impacts: the impulses with which closed and closing laws stop each other, all at the same instant.

The rates r of the laws change by the impulses Λ through the Delassus matrix W of the whole constrained system,
r⁺ = r⁻ + W·Λ. Newton's law with restitution asks of every law that touches

    0 ≤ Λ ⟂ r⁺ + e·min(r⁻, 0) ≥ 0,

for all laws simultaneously (F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter
8). With different e, or through friction, that can create energy (T. R. Kane, Stanford Mechanics Alumni Club
Newsletter, 1984; C. Glocker, Multibody System Dynamics 29, 2013) or, for laws that depend on each other, contradict
itself. Poisson's law then decides: a plastic impact compresses, and at least e times its impulses is given back.

Friction of a contact takes part with |Λt| ≤ μ·Λn: it stops the sliding if that is enough, and else gives all it can
against it (Coulomb's law on impulses, J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics,
1988). Its limits follow from the other impulses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import (
    FREE,
    LOWER,
    NEGLIGIBLE,
    Array,
    LCPSolution,
    NoSolution,
    Sides,
    slack,
    solve,
)
from lmoc.numerics.laws.cones import NO_FRICTION, Friction, solve_with_cones
from lmoc.support.records import dataclass

NEWTON, POISSON = "Newton", "Poisson"
MOST_LIMITS = 12  # limits of friction tried one after the other before `cones`
CREATED = 1e-12  # energy gained beyond this share of the energy that the impact turns over counts as created


@dataclass(frozen=True, eq=False)
class Impact:
    """The effect of an impact.

    Attributes
    ----------
    impulse : (n,) along the laws, ≥ 0
    rate : (n,) after the impact
    lost : (n,) energy that each law takes out: −Λ·(r⁻ + r⁺)/2 for resting supports
    law : NEWTON or POISSON
    unique : (n,) whether the impulse is determined
    """

    impulse: Array
    rate: Array
    lost: Array
    law: str
    unique: NDArray[np.bool_]


def collide(
    delassus: Array, rate: Array, restitution: Array, friction: Friction = NO_FRICTION, side: Sides | None = None
) -> Impact:
    """Return the impact of laws that touch.

    Parameters
    ----------
    delassus : (n, n) change of the rates by unit impulses
    rate : (n,) before the impact
    restitution : (n,) coefficients, 0 … 1; 0 for friction
    side : (n,) a guess where the impulses are between their bounds

    Raises
    ------
    NoSolution
        A moving body is caught between fixed ones, or no impulses satisfy the laws of friction.
    """
    try:
        newton = _newton(delassus, rate, restitution, friction, side)
    except NoSolution:
        return _poisson(delassus, rate, restitution, friction)
    turned = float(np.abs(newton.impulse) @ (np.abs(rate) + np.abs(newton.rate)))
    return newton if -newton.lost.sum() <= CREATED * turned else _poisson(delassus, rate, restitution, friction)


def _newton(delassus: Array, rate: Array, restitution: Array, friction: Friction, side: Sides | None) -> Impact:
    wanted = restitution * np.minimum(rate, 0.0)
    wanted[friction.rows] = 0.0
    found = _solved(delassus, rate + wanted, np.zeros(len(rate)), friction, side)
    return _impact(rate, found.x, found.w - wanted, NEWTON, found.unique)


def _poisson(delassus: Array, rate: Array, restitution: Array, friction: Friction) -> Impact:
    compression = _solved(delassus, rate, np.zeros(len(rate)), friction)
    rest = np.abs(compression.w) <= slack(delassus, rate, compression.x)
    left = np.where(rest, 0.0, compression.w)  # laws that depend on each other would contradict each other by rounding
    expansion = _solved(delassus, left, restitution * compression.x, friction)
    impulse = compression.x + expansion.x
    return _impact(rate, impulse, expansion.w, POISSON, compression.unique & expansion.unique)


def _solved(delassus: Array, q: Array, least: Array, friction: Friction, side: Sides | None = None) -> LCPSolution:
    """Solve for impulses, at least some of the laws without friction; the limits of friction follow from the answer.

    Where sides repeat, so that each friction either sticks or gives its share of its normal impulse, the impulses
    follow at once. Where none repeat, Lemke's algorithm decides.
    """
    upper = np.full(len(q), np.inf)
    if not len(friction.rows):
        return solve(delassus, q, least, upper, side)
    lower, side = least.copy(), None
    lower[friction.rows] = upper[friction.rows] = 0.0
    found = solve(delassus, q, lower, upper)
    for _ in range(MOST_LIMITS):
        upper[friction.rows] = friction.share * found.x[friction.normal]
        lower[friction.rows] = -upper[friction.rows]
        found = solve(delassus, q, lower, upper, side)
        if side is not None and (found.side == side).all():
            exact = _with_sides(delassus, q, least, friction, found)
            if exact is not None:
                return exact
        side = found.side
    found = solve_with_cones(delassus, q, least, np.full(len(q), np.inf), friction)
    exact = _with_sides(delassus, q, least, friction, found)
    return found if exact is None else exact


def _with_sides(delassus: Array, q: Array, least: Array, friction: Friction, found: LCPSolution) -> LCPSolution | None:
    """Return the solution in which everything is on the side found; None where that is none."""
    n, side = len(q), found.side
    matrix, right = np.eye(n), np.where(side == LOWER, least, 0.0)
    free = side == FREE
    matrix[free], right[free] = delassus[free], -q[free]
    sliding = ~free[friction.rows]
    rows, normal = friction.rows[sliding], friction.normal[sliding]
    matrix[rows, normal] -= np.where(side[rows] == LOWER, -1.0, 1.0) * friction.share[sliding]
    right[rows] = 0.0
    x = np.linalg.lstsq(matrix, right, rcond=None)[0]
    w = delassus @ x + q
    limit = friction.share * x[friction.normal]
    lower, upper = least.copy(), np.full(n, np.inf)
    lower[friction.rows], upper[friction.rows] = -limit, limit
    allowed = NEGLIGIBLE * (np.abs(delassus) @ np.abs(x) + np.abs(q))
    size = NEGLIGIBLE * (np.abs(x).max() + np.abs(found.x).max())
    good = np.abs(matrix @ x - right).max() <= max(size, allowed.max())
    good &= bool((x >= lower - size).all() and (x <= upper + size).all())
    good &= bool((w[side == LOWER] >= -allowed[side == LOWER]).all())
    good &= bool((w[(side != LOWER) & ~free] <= allowed[(side != LOWER) & ~free]).all())
    w[free] = 0.0
    return LCPSolution(x, w, side, found.unique) if good else None


def _impact(before: Array, impulse: Array, after: Array, law: str, unique: NDArray[np.bool_]) -> Impact:
    return Impact(impulse, after, -0.5 * impulse * (before + after), law, unique)
