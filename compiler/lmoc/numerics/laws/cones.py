"""Complementarity problems with the friction of contacts, which the engine solves (``engine/c/cones.c``)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, LCPSolution, checked, numbers
from lmoc.support.records import dataclass


class _Friction(ctypes.Structure):
    """``lmoc_friction`` in ``engine/c/complementarity.h``."""

    _fields_ = [("count", ctypes.c_int64), *[(name, ctypes.c_void_p) for name in ("rows", "normal", "share")]]


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

    def in_c(self) -> _Friction:
        """Return the structure that the engine reads."""
        arrays = np.array(self.rows, np.int64), np.array(self.normal, np.int64), np.array(self.share, np.float64)
        made = _Friction(len(self.rows), *(a.ctypes.data for a in arrays))
        made.kept = arrays
        return made


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
    given = [numbers(v) for v in (matrix, q, lower, upper)]
    x, w, side, own = np.empty(n), np.empty(n), np.empty(n, np.int64), friction.in_c()
    first, results = (v.ctypes.data for v in given), (v.ctypes.data for v in (x, w, side))
    checked(library().lmoc_with_cones(n, *first, ctypes.addressof(own), *results), x)
    return LCPSolution(x, w, side, np.ones(n, bool))
