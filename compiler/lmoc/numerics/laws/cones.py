"""Complementarity problems with the friction of contacts, by Lemke's algorithm.

The limits of a contact's friction are shares of its normal force, so that bounds follow from the answer. Iterating on
them need not converge, however regular the problem. Lemke's algorithm finds an answer wherever the bodies are not
caught between dependent laws (D. E. Stewart and J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Numer. Methods Eng. 39, 1996; C. E. Lemke, Bimatrix
equilibrium points and mathematical programming, Management Science 11, 1965): friction forward and backward, and the
sliding speed, are unknowns of their own,

    0 ≤ Λn ⟂ rn ≥ 0,   0 ≤ β± ⟂ ±rt + λ ≥ 0,   0 ≤ λ ⟂ μ·Λn − β₊ − β₋ ≥ 0,   Λt = β₊ − β₋.

It works on a dense table and is slow beside block pivoting, so that it is asked only where that gives up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import FREE, LOWER, UPPER, Array, LCPSolution, NoSolution
from lmoc.numerics.limits import AT_LIMIT, NO_ENTRY
from lmoc.support.records import dataclass

_MOST_PIVOTS = 50  # a row of the table


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction whose limits are shares of other forces.

    Attributes
    ----------
    rows, normal : (k,) which components it is, and those of its normal forces
    share : (k,) of the normal force, at the most
    """

    rows: NDArray[np.int64]
    normal: NDArray[np.int64]
    share: Array


NO_FRICTION = Friction(np.zeros(0, int), np.zeros(0, int), np.zeros(0))


def solve_with_cones(matrix: Array, q: Array, lower: Array, upper: Array, friction: Friction) -> LCPSolution:
    """Solve a problem as of `complementarity.solve`, in which some bounds are shares of other components.

    Parameters
    ----------
    matrix, q : (n, n), (n,)
    lower, upper : (n,) lower bounds finite; those of the rows of `friction` count for nothing

    Raises
    ------
    NoSolution
        Lemke's algorithm has ended on a ray.
    """
    n = len(q)
    rows, k = friction.rows, len(friction.rows)
    boxed = np.flatnonzero(np.isfinite(upper) & ~np.isin(np.arange(n), rows))
    least = lower.copy()
    least[rows] = 0.0
    size = n + 2 * k + len(boxed)  # components (β₊ for friction), β₋, λ of friction, λ of upper bounds
    back, speed, over = n + np.arange(k), n + k + np.arange(k), n + 2 * k + np.arange(len(boxed))
    big, right = np.zeros((size, size)), np.zeros(size)
    big[:n, :n], right[:n] = matrix, matrix @ least + q
    big[:n, back], big[back, :n] = -matrix[:, rows], -matrix[rows]
    big[np.ix_(back, back)], right[back] = matrix[np.ix_(rows, rows)], -right[rows]
    big[rows, speed] = big[back, speed] = 1.0
    big[speed, rows] = big[speed, back] = -1.0
    big[speed, friction.normal] = friction.share
    right[speed] = friction.share * least[friction.normal]
    big[boxed, over], big[over, boxed], right[over] = 1.0, -1.0, (upper - least)[boxed]
    z = lemke(big, right)
    x = least + z[:n]
    x[rows] -= z[back]
    limit = friction.share * x[friction.normal]
    side = np.where(z[:n] > 0.0, FREE, LOWER)
    side[boxed] = np.where(z[over] > 0.0, UPPER, side[boxed])
    sliding = np.abs(x[rows]) >= limit * (1.0 - AT_LIMIT)
    side[rows] = np.where(sliding, np.where(x[rows] < 0.0, LOWER, UPPER), FREE)
    return LCPSolution(x, matrix @ x + q, side, np.ones(n, bool))


def lemke(matrix: Array, q: Array) -> Array:
    """Return z ≥ 0 with w = matrix·z + q ≥ 0 and z·w = 0; ties are broken lexicographically.

    Raises
    ------
    NoSolution
        The algorithm has ended on a ray: where `matrix` is copositive plus, there is no solution.
    """
    n = len(q)
    if (q >= 0.0).all():
        return np.zeros(n)
    scale = np.maximum(np.abs(matrix).max(axis=1), np.finfo(float).tiny)
    # w/scale − (matrix/scale)·z − z0 = q/scale; columns: w, z, z0, right side
    table = np.column_stack([np.eye(n), -matrix / scale[:, None], -np.ones(n), q / scale])
    basis = np.arange(n)
    row, entering = int(table[:, -1].argmin()), 2 * n
    for _ in range(_MOST_PIVOTS * n):
        leaving = int(basis[row])
        table[row] /= table[row, entering]
        others = np.arange(n) != row
        table[others] -= np.outer(table[others, entering], table[row])
        basis[row] = entering
        if leaving == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basis] = table[:, -1]
            return np.maximum(z[n : 2 * n], 0.0)
        entering = leaving + n if leaving < n else leaving - n
        column = table[:, entering]
        able = np.flatnonzero(column > NO_ENTRY * np.abs(column).max())
        if not len(able):
            break
        row = _least_ratio(table, column, able, basis, n)
    z = np.zeros(2 * n + 1)
    z[basis] = table[:, -1]
    raise NoSolution(z[n : 2 * n])


def _least_ratio(table: Array, column: Array, able: NDArray[np.int64], basis: NDArray[np.int64], n: int) -> int:
    """Return the row that leaves first; the artificial one where it can, and ties by the inverse of the basis."""
    for entries in (table[:, -1], *table[:, :n].T):
        ratio = entries[able] / column[able]
        able = able[ratio <= ratio.min() + NO_ENTRY * np.abs(ratio).max()]
        artificial = able[basis[able] == 2 * n]
        if len(artificial):
            return int(artificial[0])
        if len(able) == 1:
            break
    return int(able[0])
