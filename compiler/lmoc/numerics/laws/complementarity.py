"""Linear complementarity problems with bounds, which the engine solves (``engine/c/complementarity.c``).

Given a square matrix M, a vector q and bounds, find x and w = M·x + q with, for every component,

    x = lower and w ≥ 0,   or   lower < x < upper and w = 0,   or   x = upper and w ≤ 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmoc.engine.library import library
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Sides = NDArray[np.int64]

LOWER, FREE, UPPER = -1, 0, 1
SOLVED, NO_SOLUTION = 0, 1


@dataclass(frozen=True, eq=False)
class LCPSolution:
    """The answer to a problem.

    Attributes
    ----------
    x, w : (n,)
    side : (n,) LOWER, FREE or UPPER: where each component of x is
    unique : (n,) whether a component of x is determined; w always is
    """

    x: Array
    w: Array
    side: Sides
    unique: NDArray[np.bool_]


class NoSolution(Exception):
    """The problem has no solution, or none was found; `x` is the last iterate."""

    def __init__(self, x: Array) -> None:
        super().__init__("the complementarity problem has no solution")
        self.x = x


def solve(matrix: Array, q: Array, lower: Array, upper: Array, side: Sides | None = None) -> LCPSolution:
    """Solve one problem.

    Parameters
    ----------
    matrix : (n, n), positive semidefinite; a P-matrix need not be symmetric
    q, lower, upper : (n,); bounds may be infinite
    side : (n,) where to begin, such as the answer to the problem before

    Raises
    ------
    NoSolution
        Such as a body that is pressed between two fixed ones.
    """
    n = len(q)
    given = [numbers(v) for v in (matrix, q, lower, upper)]
    x, w = np.empty(n), np.empty(n)
    sides = np.full(n, LOWER) if side is None else np.array(side, np.int64)
    unique = np.empty(n, bool)
    checked(library().lmoc_complementarity(n, *(v.ctypes.data for v in (*given, x, w, sides, unique))), x)
    return LCPSolution(x, w, sides, unique)


def numbers(values: ArrayLike) -> Array:
    """Return an array as C reads it."""
    return np.ascontiguousarray(values, np.float64)


def checked(status: int, x: Array) -> None:
    """Raise what a status of the engine's solvers says.

    Parameters
    ----------
    x : (n,) the last iterate

    Raises
    ------
    NoSolution, MemoryError
    """
    if status == NO_SOLUTION:
        raise NoSolution(x)
    if status != SOLVED:
        raise MemoryError
