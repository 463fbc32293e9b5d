"""Eigenvalues of a linear model, the zero ones exactly so, and what they say about stability.

A mechanism that is free to drift has zero eigenvalues in pairs, and a plain eigenvalue routine gives such a pair as
±1e-8. So the zeros are taken off first, with their chains, by the staircase of V. N. Kublanovskaya (USSR Comput. Math.
Math. Phys. 6 (1966) 1) in the orthogonal form of G. H. Golub and J. H. Wilkinson (SIAM Review 18 (1976) 578): the null
space of A, then that of what is left, until nothing is. The matrix is balanced before, so that a stiff part beside a
soft one does not hide the soft one's motion.
"""

from __future__ import annotations

import numpy as np

from lmoc.support.records import dataclass

NEAR_AXIS = 1e-6  # |Re λ|/|λ| below which several equal eigenvalues may be one on the imaginary axis
ON_AXIS = 1e-9  # and below which a single one is

ROUNDED_OFF = 1e-24  # of the largest entry: less is what a square of a difference of equal numbers leaves
NOT_ROUNDING = 1e-3  # in SI units: the rate of a coordinate is 1 times a velocity, what rounding leaves is far less


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues of a matrix.

    Attributes
    ----------
    values : (n,)
        Sorted by size, then by real part; the partners of a complex pair stand together, the upper one first.
    chains : tuple of int
        Null directions at each step of the staircase: ``(2,)`` are two independent zeros, ``(1, 1)`` is one chain of
        length two, which drifts.
    rounding : float
        Size of what is rounding only in an eigenvalue.
    """

    values: np.ndarray
    chains: tuple[int, ...]
    rounding: float


def too_wide(A: np.ndarray) -> bool:
    """Return whether numbers that are more than rounding are lost beside the largest, or are none."""
    size = np.abs(A)
    if not np.isfinite(size).all():
        return True
    lost = size[(size > 0) & (size < ROUNDED_OFF * size.max(initial=0.0))]
    return bool(lost.max(initial=0.0) > NOT_ROUNDING)


def spectrum(A: np.ndarray) -> Spectrum:
    """Eigenvalues of a square matrix, zeros found by rank."""
    from scipy.linalg import qr

    if not len(A):
        return Spectrum(np.zeros(0), (), 0.0)
    rest = balanced(np.where(np.abs(A) < ROUNDED_OFF * np.abs(A).max(), 0.0, A))
    rounding = len(A) * np.finfo(float).eps * float(np.linalg.norm(rest))
    chains: list[int] = []
    while len(rest):
        range_first, triangle, _ = qr(rest.T, pivoting=True)
        rank = int(np.sum(np.abs(np.diag(triangle)) > 16 * rounding))
        if rank == len(rest):
            break
        chains.append(len(rest) - rank)
        kept = range_first[:, :rank]  # orthogonal to the null space
        rest = kept.T @ rest @ kept
    values = np.concatenate([np.zeros(sum(chains)), np.linalg.eigvals(rest) if len(rest) else np.zeros(0)])
    small = 1e-12 * np.abs(values)
    values = np.where(np.abs(values.imag) <= small, values.real + 0j, values)
    values = np.where(np.abs(values.real) <= small, 1j * values.imag, values)
    values = values.real if not np.any(values.imag) else values
    order = np.lexsort((-values.imag, values.real, np.round(np.abs(values), 9)))
    return Spectrum(values[order] + 0.0, tuple(chains), rounding)


def balanced(A: np.ndarray) -> np.ndarray:
    """A similar matrix, rows and columns of like size (B. N. Parlett and C. Reinsch, Numer. Math. 13 (1969) 293)."""
    from scipy.linalg import matrix_balance

    return matrix_balance(A, permute=False)[0]


def stability(found: Spectrum, A: np.ndarray) -> str:
    """Stability of ``ẋ = A x``.

    Returns
    -------
    ``asymptotically stable``, ``stable`` (some motions neither grow nor decay), ``neutral`` (a family of states of
    rest), ``marginal`` (a family that drifts at constant speed once pushed, with nothing that grows faster) or
    ``unstable``. Several equal eigenvalues on the imaginary axis are stable only with as many eigenvectors.
    """
    if len(found.chains) > 2:  # grows with the square of time
        return "unstable"
    moving = found.values[sum(found.chains) :]
    moving = moving[moving.imag >= 0]  # of a pair, one tells all
    size = np.abs(moving)
    critical = moving[np.abs(moving.real) <= NEAR_AXIS * size + found.rounding]
    on_axis = np.zeros(len(moving), bool)
    for k, value in enumerate(moving):
        equal = int(np.sum(np.abs(critical - value) <= NEAR_AXIS * abs(value)))
        if abs(value.real) <= (NEAR_AXIS if equal > 1 else ON_AXIS) * abs(value) + found.rounding:
            on_axis[k] = True
            if equal > 1 and _eigenvectors(A, value, found.rounding) < equal:
                return "unstable"
    if np.any(moving.real[~on_axis] > 0):
        return "unstable"
    if found.chains:
        return "neutral" if len(found.chains) == 1 else "marginal"
    return "stable" if on_axis.any() else "asymptotically stable"


def _eigenvectors(A: np.ndarray, value: complex, rounding: float) -> int:
    """Return the number of independent eigenvectors of an eigenvalue."""
    singular = np.linalg.svd(balanced(A) - value * np.eye(len(A)), compute_uv=False)
    return int(np.sum(singular <= 10 * NEAR_AXIS * abs(value) + rounding))
