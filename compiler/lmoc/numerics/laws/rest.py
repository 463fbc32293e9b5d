"""Velocities that the closed laws of a mode hold at zero: their derivatives are zero, not rounding of the forces.

A closed law keeps its rate at zero. Where the rates of closed laws are linear forms in the velocities with constant
coefficients, some velocities may vanish with them, such as those of a body that sticks on a slope. Gauss-Jordan
elimination finds them: rows with a single entry.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import Array

ROUNDING = 1e-12  # entries below this share of the largest of their row are zero


def held_velocities(forms: Array) -> NDArray[np.bool_]:
    """Return which velocities (states,) vanish wherever linear forms in them do.

    Parameters
    ----------
    forms : (k, states) coefficients; rows of NaN do not take part
    """
    work = forms[np.isfinite(forms).all(axis=1)]
    used = np.flatnonzero((work != 0.0).any(axis=0))
    work, held = work[:, used].copy(), np.zeros(forms.shape[1], bool)
    scale = np.abs(work).max(axis=1, initial=0.0)
    work, scale = work[scale > 0.0], scale[scale > 0.0]
    left = np.ones(len(work), bool)
    while left.any():
        size = np.where(left[:, None], np.abs(work) / scale[:, None], 0.0)
        row, column = divmod(int(size.argmax()), len(used))
        if size[row, column] <= ROUNDING:
            break
        work[row] /= work[row, column]
        others = np.flatnonzero(work[:, column])
        others = others[others != row]
        change = np.outer(work[others, column], work[row])
        noise = ROUNDING * np.maximum(np.abs(work[others]), np.abs(change))
        work[others] -= change
        work[others] = np.where(np.abs(work[others]) <= noise, 0.0, work[others])
        left[row] = False
    alone = ~left & ((work != 0.0).sum(axis=1) == 1)
    held[used[(work[alone] != 0.0).any(axis=0)]] = True
    return held
