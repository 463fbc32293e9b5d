"""The smallest steps that satisfy linear equations: dense for few, by sparse factors for many of few unknowns each."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.structure.linear.generic import spread
from lmoc.support.sizes import DENSE

DAMPING = 1e-13  # keeps the equations for a step regular where constraints repeat each other; rows have length 1
_INVERSE_STEPS, _CERTAIN = 12, 10.0  # of inverse iteration; by which its result must exceed what is asked for
_RANK = 1e-12  # of the largest singular value of a dense matrix: what is less is none


def smallest_step(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(n,) the smallest x with ``jacobian @ x = right``, or the one that comes nearest to it.

    Parameters
    ----------
    jacobian : (m, n), with rows of one length
    right : (m,)
    """
    if len(jacobian) <= DENSE:
        found: np.ndarray = np.linalg.lstsq(jacobian, right, rcond=_RANK)[0]
        return found
    row, column = np.nonzero(jacobian)
    entries = row, column, jacobian[row, column]
    shortest: np.ndarray = jacobian.T @ multipliers(entries, jacobian.shape, np.ones(jacobian.shape[1]), right, DAMPING)
    return shortest


def damped_step(jacobian: np.ndarray, residual: np.ndarray, damping: float) -> np.ndarray:
    """(n,) the step to where the linearized residual is small, of Levenberg and Marquardt.

    Parameters
    ----------
    jacobian : (m, n)
    damping : of each unknown, in the square of its column
    """
    slope = jacobian.T @ residual
    if len(jacobian) <= DENSE:
        normal = jacobian.T @ jacobian
        damped: np.ndarray = normal + np.diag(_damping(np.diag(normal), damping))
        found: np.ndarray = np.linalg.lstsq(damped, slope, rcond=None)[0]
        return found
    from scipy.sparse import csc_matrix, diags

    own = csc_matrix(jacobian)
    squares = own.T @ own
    return _solved(squares + diags(_damping(squares.diagonal(), damping)), slope)


def _damping(diagonal: np.ndarray, share: float) -> np.ndarray:
    """What is added to a diagonal: a share of it, and what keeps unknowns in no equation."""
    added: np.ndarray = share * diagonal + 1e-14 * max(diagonal.sum(), 1e-300)
    return added


def projected(jacobian: np.ndarray, direction: np.ndarray, share: float) -> np.ndarray:
    """(n,) the part of a direction that changes no equation.

    Equations count as independent where they differ by more than a share of their own. Of many, those that hardly
    differ are filtered out by a damping, twice (Hansen, Rank-Deficient and Discrete Ill-Posed Problems, 1998, 5.1).
    """
    if len(jacobian) <= DENSE:
        _, size, directions = np.linalg.svd(jacobian)
        free = directions[np.count_nonzero(size > share * size.max(initial=0.0)) :]
        found: np.ndarray = free.T @ (free @ direction)
        return found
    own, one = in_rows_of_length_one(jacobian), np.ones(jacobian.shape[1])
    row, column = np.nonzero(own)
    for _ in range(2):
        factors = multipliers((row, column, own[row, column]), own.shape, one, own @ direction, share**2)
        direction = direction - own.T @ factors
    return direction


def in_rows_of_length_one(jacobian: np.ndarray) -> np.ndarray:
    """(m, n) the same equations with rows of length 1; rows of zeros stay."""
    size = np.linalg.norm(jacobian, axis=1)
    unit: np.ndarray = jacobian / np.where(size > 0, size, 1.0)[:, None]
    return unit


def surely_independent(unit: np.ndarray, share: float) -> bool:
    """Return whether each of many rows keeps more than a share of its length apart from all others together.

    That share is not below the smallest singular value of rows of length 1, whose square inverse iteration finds from
    above: to a factor of two at the worst after so many steps (Kuczyński and Woźniakowski, SIAM J. Matrix Anal. Appl.
    13, 1992), far within the factor left here. False says nothing.
    """
    if len(unit) <= DENSE:
        return False
    from scipy.sparse import csc_matrix, identity
    from scipy.sparse.linalg import splu

    own = csc_matrix(unit)
    try:
        factors = splu((own @ own.T + DAMPING * identity(len(unit))).tocsc())
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return False
    direction, square = spread(len(unit), 1) - 0.5, np.inf
    for _ in range(_INVERSE_STEPS):
        direction /= np.linalg.norm(direction)
        direction = factors.solve(direction)
        square = 1.0 / float(np.linalg.norm(direction))
    return bool(square > (_CERTAIN * share) ** 2)


def multipliers(
    entries: tuple[np.ndarray, np.ndarray, np.ndarray],
    shape: tuple[int, int],
    weight: np.ndarray,
    right: np.ndarray,
    damping: float,
) -> np.ndarray:
    """(m,) λ with ``(J W Jᵀ + damping) λ = right``; NaN where it cannot be determined.

    Parameters
    ----------
    entries : rows, columns and values of J
    weight : (n,) the diagonal of W
    """
    row, column, value = entries
    if not (np.isfinite(value).all() and np.isfinite(right).all()):
        return np.full(shape[0], np.nan)
    from scipy.sparse import csr_matrix, diags, identity

    jacobian = csr_matrix((value, (row, column)), shape)
    return _solved(jacobian @ diags(weight) @ jacobian.T + damping * identity(shape[0]), right)


def _solved(matrix: Any, right: np.ndarray) -> np.ndarray:
    """The solution with a sparse matrix of SciPy; NaN where it is singular."""
    from scipy.sparse.linalg import splu

    try:
        found: np.ndarray = splu(matrix.tocsc()).solve(right)
        return found
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return np.full(len(right), np.nan)
