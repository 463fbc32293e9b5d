"""Gaps, rates and sliding velocities that closed laws keep at zero, as functions of the states, and the projection.

The equations of a closed law hold on the level at which its force is felt; what is below stays as the integrator
carries it. Constraints that are linear in the states stay to rounding (Runge-Kutta and multistep methods keep linear
invariants), the others drift with the local error (Hairer & Wanner, Solving Ordinary Differential Equations II,
VII.2). Both are moved back: by Newton's method in as few states as there are constraints, chosen by pivoting, so that
a body at rest on the ground is at rest to the last bit.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.laws.complementarity import APART_FROM, Array
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.coupling import groups
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Mask

MOST_NEWTON = 12
CLOSE = 2e-16  # residual, as a share of the terms that make it
ROUNDING = 1e-12  # the same, where Newton's method does not come nearer
DRIFT = 1e3  # such errors: by what a gap may have drifted that follows from the states and from a given motion
DEPENDENT = 1e-10  # a pivot below this share of the largest entry of its row: the row depends on others


def project(kinematics: ContactKinematics, now: Instant, gaps: Mask, rates: Mask) -> Instant:
    """Return the nearby instant at which some gaps and rates are zero.

    Two gaps may be those of one coordinate: a load that a prescribed rope sets down on a floor. One of them is zero to
    rounding then, the other within the errors of the integrator.

    Raises
    ------
    Contradiction
        Newton's method does not converge.
    """
    if not (gaps.any() or rates.any()):
        return now
    chosen = np.array([gaps, rates])
    residue, terms = np.inf, np.zeros(int(chosen.sum()))
    for _ in range(MOST_NEWTON):
        value = np.array([now.gap, now.rate])[chosen]
        matrix = now.slope[chosen]
        terms = np.maximum(terms, np.abs(matrix) @ np.abs(now.x))  # what comes to rest is small beside what it was
        if (np.abs(value) <= CLOSE * terms).all():
            return now
        before, residue = residue, float(np.abs(value).max())
        whole = np.abs(matrix).max(axis=1) * np.abs(now.x).max()  # what cancels in a slope rounds as well
        if residue >= 0.5 * before and (np.abs(value) <= ROUNDING * (whole + residue)).all():
            return now  # as near as rounding allows
        now = kinematics.at(now.t, now.x + correction(matrix, -value))
    if (np.abs(value) <= drift(kinematics, matrix)).all():
        return now
    raise Contradiction(np.flatnonzero(chosen.any(axis=0)), "no states nearby satisfy them")


def drift(kinematics: ContactKinematics, slope: Array) -> Array:
    """Return by what gaps or rates may have drifted, (k,), that have these derivatives by the states, (k, states)."""
    errors = kinematics.errors
    return DRIFT * np.abs(slope) @ (errors if isinstance(errors, np.ndarray) else np.full(slope.shape[1], errors))


def correction(matrix: Array, right: Array) -> Array:
    """Return dx with matrix·dx = right and as few entries as independent rows (Gauss-Jordan, full pivoting)."""
    touched = matrix != 0.0
    dx = np.zeros(matrix.shape[1])
    apart = groups(touched @ touched.T) if len(matrix) >= APART_FROM else [np.arange(len(matrix))]
    for rows in apart:
        columns = touched[rows].any(axis=0).nonzero()[0]
        dx[columns] = _corrected(matrix[rows[:, None], columns], right[rows])
    return dx


def _corrected(matrix: Array, right: Array) -> Array:
    rows, columns = matrix.shape
    work = np.concatenate([matrix, right[:, None]], axis=1)
    scale = np.abs(matrix).max(axis=1, initial=0.0)
    left = scale > 0.0
    chosen: list[tuple[int, int]] = []
    while left.any():
        share = np.abs(work[:, :columns]) / np.where(left, scale, np.inf)[:, None]
        row, column = divmod(int(share.argmax()), columns)
        if share[row, column] <= DEPENDENT:
            break
        work[row] /= work[row, column]
        others = work[:, column].nonzero()[0]
        others = others[others != row]
        work[others] -= np.outer(work[others, column], work[row])
        left[row] = False
        chosen.append((row, column))
    dx = np.zeros(columns)
    for row, column in chosen:
        dx[column] = work[row, columns]
    return dx
