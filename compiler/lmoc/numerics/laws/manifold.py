"""Gaps, rates and sliding velocities that closed laws keep at zero: the way back onto them (``engine/c/project.c``)."""

from __future__ import annotations

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, numbers
from lmoc.numerics.laws.contact_in_c import Asked
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Mask


def project(kinematics: ContactKinematics, now: Instant, gaps: Mask, rates: Mask) -> Array:
    """Return the states nearby at which some gaps and rates are zero.

    Two gaps may be those of one coordinate: a load that a prescribed rope sets down on a floor. One of them is zero to
    rounding then, the other within the errors of the integrator.

    Raises
    ------
    Contradiction
        Newton's method does not converge.
    """
    moved, laws = np.empty(len(now.x)), np.zeros(len(gaps), bool)
    masks = [np.ascontiguousarray(v, bool) for v in (gaps, rates)]
    Asked(kinematics).call("lmoc_projected", laws, now.t, now.x, *masks, moved, laws)
    return moved


def resisted(kinematics: ContactKinematics, now: Instant, closed: Mask) -> Array:
    """Return the states behind impulses by which closed laws resist rates that would close them further.

    Raises
    ------
    Contradiction
        No impulses do.
    """
    behind, laws = np.empty(len(now.x)), np.zeros(len(closed), bool)
    own = np.ascontiguousarray(closed, bool)
    Asked(kinematics).call("lmoc_resisted", laws, now.t, now.x, own, behind, laws)
    return behind


def drift(kinematics: ContactKinematics, slope: Array) -> Array:
    """Return by what gaps or rates may have drifted, (k,), that have these derivatives by the states, (k, states)."""
    slope, errors = numbers(slope), np.zeros(slope.shape[1]) + kinematics.errors
    found = np.empty(len(slope))
    library().lmoc_drift(*slope.shape, slope.ctypes.data, errors.ctypes.data, found.ctypes.data)
    return found
