"""Velocities that the closed laws of a mode hold at zero: their derivatives are zero, not rounding of the forces.

A closed law keeps its rate at zero. Where the rates of closed laws are linear forms in the velocities with constant
coefficients, some velocities may vanish with them, such as those of a body that sticks on a slope. Gauss-Jordan
elimination finds them (``engine/c/manifold.c``): rows with a single entry.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, checked, numbers


def held_velocities(forms: Array) -> NDArray[np.bool_]:
    """Return which velocities (states,) vanish wherever linear forms in them do.

    Parameters
    ----------
    forms : (k, states) coefficients; rows of NaN do not take part
    """
    forms, held = numbers(forms), np.empty(forms.shape[1], bool)
    checked(library().lmoc_held_velocities(*forms.shape, forms.ctypes.data, held.ctypes.data), forms)
    return held
