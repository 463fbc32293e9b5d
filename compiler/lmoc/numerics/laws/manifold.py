"""Gaps, rates and sliding velocities that closed laws keep at zero, as functions of the states, and the projection.

The equations of a closed law hold on the level at which its force is felt; what is below stays as the integrator
carries it. Constraints that are linear in the states stay to rounding (Runge-Kutta and multistep methods keep linear
invariants), the others drift with the local error (Hairer & Wanner, Solving Ordinary Differential Equations II,
VII.2). Both are moved back: by Newton's method in as few states as there are constraints, chosen by pivoting
(``engine/c/manifold.c``), so that a body at rest on the ground is at rest to the last bit.
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, checked, numbers
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Mask

MOST_NEWTON = 12
CLOSE = 2e-16  # residual, as a share of the terms that make it
ROUNDING = 1e-12  # the same, where Newton's method does not come nearer
DRIFT = 1e3  # such errors: by what a gap may have drifted that follows from the states and from a given motion


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
    matrix, right, dx = numbers(matrix), numbers(right), np.empty(matrix.shape[1])
    arrays = (v.ctypes.data for v in (matrix, right, dx))
    checked(library().lmoc_correction(*matrix.shape, *arrays), dx)
    return dx
