"""Whether an impact of several laws depends on what happens first, when all of it happens at once.

Bodies that touch are hit at the same instant. Laws for all impacts at once give one answer; impacts one after the
other, each of two bodies, may give others, and which of them a real scene gives depends on how stiff its bodies are
(F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter 8). Three equal balls in a row,
of which the first one comes with velocity 1, leave with (-1/3, 2/3, 2/3) or (0, 0, 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import Array

MOST = 400  # impacts one after the other
STILL = 1e-9  # share of the largest rate: what approaches no faster has no more impacts
DIFFERENT = 1e-6  # the same: by which two answers are different ones
FEW = 24  # laws, in larger groups nothing is tried


def depends_on_order(delassus: Array, rate: Array, restitution: Array, after: Array) -> bool:
    """Return whether some laws would be left with other rates if they were hit one after the other.

    Parameters
    ----------
    delassus, rate, restitution : as of `impact.collide`, of laws without friction
    after : (n,) the rates after the impact of all at once
    """
    n = len(rate)
    size = float(np.abs(rate).max(initial=0.0))
    if not 1 < n <= FEW or not size > 0.0 or not (delassus - np.diag(np.diag(delassus))).any():
        return False
    for order in (np.arange(n), np.arange(n)[::-1]):
        other = _one_by_one(delassus, rate, restitution, order, STILL * size)
        if other is not None and (np.abs(other - after) > DIFFERENT * size).any():
            return True
    return False


def _one_by_one(
    delassus: Array, rate: Array, restitution: Array, order: NDArray[np.int64], still: float
) -> Array | None:
    """Return the rates behind impacts one after the other, of the first law in an order that approaches.

    None where there is no end of them.
    """
    rate = rate.copy()
    for _ in range(MOST):
        approaching = order[(rate[order] < -still) & (np.diag(delassus)[order] > 0.0)]
        if not len(approaching):
            return rate
        k = approaching[0]
        rate += delassus[:, k] * (-(1.0 + restitution[k]) * rate[k] / delassus[k, k])
    return None
