"""Linear complementarity problems with bounds, by block principal pivoting.

Given a square matrix M, a vector q and bounds, find x and w = M·x + q with, for every component,

    x = lower and w ≥ 0,   or   lower < x < upper and w = 0,   or   x = upper and w ≤ 0.

The force of a string has the bounds (0, ∞), stuck friction (−limit, limit). Exchanging all components that violate
their conditions at once takes a handful of factorizations, whatever the number of components (J. J. Júdice and F. M.
Pires, A block principal pivoting algorithm for large-scale strictly monotone linear complementarity problems,
Computers & Operations Research 21, 1994). Should the number of violations stop falling, one component at a time is
exchanged, the last in order, which ends for every P-matrix (K. G. Murty, Note on a Bard-type scheme, Opsearch 11,
1974).

Constraints that depend on each other make M only semidefinite: w is then unique and x is not. The proximal point
method (R. T. Rockafellar, SIAM J. Control Optim. 14, 1976) turns that into a few problems with M + ε·D, each warm-
started from the one before: where a solution exists the iterates converge to one at the rate ε, and where none exists
they grow without bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.coupling import groups
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Sides = NDArray[np.int64]

LOWER, FREE, UPPER = -1, 0, 1
PROXIMAL = 1e-6  # ε, as a share of the diagonal
MOST_PROXIMAL = 8  # steps; the error falls by ε in each, so that a solvable problem takes two or three
APART_FROM = 12  # components from which on it is looked whether a problem falls into several
PATIENCE = 8  # block exchanges without fewer violations before components are exchanged one at a time
DEPENDENT = 1e-11  # singular values below this share of the largest one are those of dependent constraints
NEGLIGIBLE = 1e-11  # violations below this share of the terms they are the sum of count as none …
ROUNDING = 1e-14  # … and below this one of the largest terms of all


@dataclass(frozen=True, eq=False)
class LCPSolution:
    """The answer to a problem.

    Attributes
    ----------
    x, w : (n,)
    side : (n,) LOWER, FREE or UPPER: where each component of x is
    unique : (n,) whether a component of x is determined; w always is
    """

    x: Array
    w: Array
    side: Sides
    unique: NDArray[np.bool_]


class NoSolution(Exception):
    """The problem has no solution, or none was found; `x` is the last iterate."""

    def __init__(self, x: Array) -> None:
        super().__init__("the complementarity problem has no solution")
        self.x = x


def solve(matrix: Array, q: Array, lower: Array, upper: Array, side: Sides | None = None) -> LCPSolution:
    """Solve one problem.

    Parameters
    ----------
    matrix : (n, n), positive semidefinite; a P-matrix need not be symmetric
    q, lower, upper : (n,); bounds may be infinite
    side : (n,) where to begin, such as the answer to the problem before

    Raises
    ------
    NoSolution
        Such as a body that is pressed between two fixed ones.
    """
    n = len(q)
    if n == 0:
        return LCPSolution(np.zeros(0), np.zeros(0), np.zeros(0, int), np.zeros(0, bool))
    if n == 1 and matrix[0, 0] > 0.0:
        return _alone(matrix[0, 0], q[0], lower[0], upper[0], LOWER if side is None else side[0])
    if n >= APART_FROM:
        apart = groups((matrix != 0.0) | (matrix != 0.0).T)
        if len(apart) > 1:
            return _one_by_one(matrix, q, lower, upper, np.full(n, LOWER) if side is None else side, apart)
    diagonal = np.diag(matrix).copy()
    diagonal[diagonal <= 0.0] = diagonal.max() if diagonal.max() > 0.0 else 1.0
    shift = PROXIMAL * diagonal
    regular = matrix + np.diag(shift)
    x = np.clip(np.zeros(n), lower, upper)
    side = np.full(n, LOWER) if side is None else side
    for _ in range(MOST_PROXIMAL):
        before = x
        x, side = _pivot(regular, q - shift * before, lower, upper, side)
        x = _polished(matrix, q, x, side)
        w = matrix @ x + q
        allowed = slack(matrix, q, x)
        solved = np.abs(w[side == FREE]) <= allowed[side == FREE]
        if solved.all() and not len(_violated(x, w, side, lower, upper, allowed, diagonal)):
            w[side == FREE] = 0.0
            x = np.clip(x, lower, upper)
            return LCPSolution(x, w, side, _determined(matrix, side))
    raise NoSolution(x)


def _one_by_one(
    matrix: Array, q: Array, lower: Array, upper: Array, side: Sides, apart: list[NDArray[np.int64]]
) -> LCPSolution:
    """Solve a problem that falls into several, each for the components of a group."""
    n = len(q)
    x, w, sides, unique = np.zeros(n), np.zeros(n), np.full(n, LOWER), np.ones(n, bool)
    for own in apart:
        try:
            found = solve(matrix[np.ix_(own, own)], q[own], lower[own], upper[own], side[own])
        except NoSolution as failed:
            x[:] = 0.0
            x[own] = failed.x
            raise NoSolution(x) from None
        x[own], w[own], sides[own], unique[own] = found.x, found.w, found.side, found.unique
    return LCPSolution(x, w, sides, unique)


def _alone(slope: float, q: float, lower: float, upper: float, side: int) -> LCPSolution:
    """Solve a problem of one component, which stays on its side where both would do."""
    zero = -q / slope
    beyond = (1 if side == FREE else -1) * 2 * (NEGLIGIBLE + ROUNDING) * abs(zero)
    if lower < upper and lower - beyond <= zero <= upper + beyond and not (side != FREE and zero in (lower, upper)):
        x, side, w = min(max(zero, lower), upper), FREE, 0.0
    else:
        x, side = (lower, LOWER) if zero <= lower + abs(beyond) or lower == upper else (upper, UPPER)
        w = slope * x + q
    return LCPSolution(np.array([x]), np.array([w]), np.array([side]), np.ones(1, bool))


def _pivot(matrix: Array, q: Array, lower: Array, upper: Array, side: Sides) -> tuple[Array, Sides]:
    """Solve a problem whose matrix is a P-matrix."""
    n = len(q)
    side = _at_finite_bounds(side, lower, upper)
    fewest, patience = n + 1, PATIENCE
    for _ in range(100 + 2000 * n):
        x = _point(matrix, q, lower, upper, side)
        w = matrix @ x + q
        violated = _violated(x, w, side, lower, upper, slack(matrix, q, x), np.diag(matrix))
        if not len(violated):
            return x, side
        if len(violated) < fewest:
            fewest, patience = len(violated), PATIENCE
        elif patience:
            patience -= 1
        else:
            violated = violated[-1:]
        side = side.copy()
        side[violated] = _other_side(x, side, lower, violated)
    raise NoSolution(x)


def slack(matrix: Array, q: Array, x: Array) -> Array:
    """Return by how much each component of w may be wrong: a share of its terms, and rounding of the others'."""
    terms = np.abs(matrix) @ np.abs(x) + np.abs(q)
    return NEGLIGIBLE * terms + ROUNDING * terms.max()


def _at_finite_bounds(side: Sides, lower: Array, upper: Array) -> Sides:
    side = np.where((side == LOWER) & ~np.isfinite(lower), FREE, side)
    side = np.where((side == UPPER) & ~np.isfinite(upper), FREE, side)
    return np.where(lower == upper, LOWER, side)


def _point(matrix: Array, q: Array, lower: Array, upper: Array, side: Sides) -> Array:
    """Return x with its components at their bounds or, where they are free, such that w = 0."""
    x = np.where(side == LOWER, lower, np.where(side == UPPER, upper, 0.0))
    free = np.flatnonzero(side == FREE)
    if len(free):
        right = -(q[free] + matrix[free] @ x)
        x[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    return x


def _polished(matrix: Array, q: Array, x: Array, side: Sides) -> Array:
    """Return the solution of the unshifted equations w = 0 of the free components that is nearest to x."""
    free = np.flatnonzero(side == FREE)
    if not len(free):
        return x
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix)[free], np.finfo(float).tiny))
    scaled = matrix[np.ix_(free, free)] * np.outer(scale, scale)
    inverse = _inverse(scaled)
    if inverse is None:
        inverse = np.linalg.pinv(scaled, rcond=DEPENDENT)
    x = x.copy()
    for _ in range(2):  # the second one refines
        x[free] -= scale * (inverse @ (scale * (matrix[free] @ x + q[free])))
    return x


def _inverse(matrix: Array) -> Array | None:
    """Return the inverse of a matrix of full rank, None for others."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    condition = np.abs(matrix).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max()
    return inverse if condition < 1.0 / DEPENDENT else None


def _violated(
    x: Array, w: Array, side: Sides, lower: Array, upper: Array, allowed: Array, diagonal: Array
) -> NDArray[np.int64]:
    """Return the components that are not where their conditions want them, by more than `allowed` in w."""
    beyond = allowed / diagonal
    outside = (side == FREE) & ((x < lower - beyond) | (x > upper + beyond))
    pulled = ((side == LOWER) & (w < -allowed)) | ((side == UPPER) & (w > allowed))
    return np.flatnonzero(outside | (pulled & (lower < upper)))


def _other_side(x: Array, side: Sides, lower: Array, which: NDArray[np.int64]) -> Sides:
    free = side[which] == FREE
    return np.where(free, np.where(x[which] < lower[which], LOWER, UPPER), FREE)


def _determined(matrix: Array, side: Sides) -> NDArray[np.bool_]:
    """Return which components do not change along the null space of the free part."""
    unique = np.ones(len(side), bool)
    free = np.flatnonzero(side == FREE)
    if len(free):
        scale = np.sqrt(np.maximum(np.diag(matrix)[free], np.finfo(float).tiny))
        scaled = matrix[np.ix_(free, free)] / np.outer(scale, scale)
        if _inverse(scaled) is not None:
            return unique
        _, values, vectors = np.linalg.svd(scaled)
        null = vectors[values <= DEPENDENT * max(values[0], np.finfo(float).tiny)]
        if len(null):
            unique[free] = np.abs(null).max(axis=0) < 1e-8
    return unique
