"""Impacts as the engine solves them (``engine/c/impact.c``), for tests of their own."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import Array, Sides, checked, numbers
from lmoc.numerics.laws.cones import NO_FRICTION, Friction
from lmoc.support.records import dataclass

NEWTON, POISSON = "Newton", "Poisson"


@dataclass(frozen=True, eq=False)
class Impact:
    """The effect of an impact.

    Attributes
    ----------
    impulse : (n,) along the laws, ≥ 0
    rate : (n,) after the impact
    lost : (n,) energy that each law takes out: −Λ·(r⁻ + r⁺)/2 for resting supports
    law : NEWTON or POISSON
    unique : (n,) whether the impulse is determined
    """

    impulse: Array
    rate: Array
    lost: Array
    law: str
    unique: NDArray[np.bool_]


def collide(
    delassus: Array, rate: Array, restitution: Array, friction: Friction = NO_FRICTION, side: Sides | None = None
) -> Impact:
    """Return the impact of laws that touch.

    Parameters
    ----------
    delassus : (n, n) change of the rates by unit impulses
    rate : (n,) before the impact
    restitution : (n,) coefficients, 0 … 1; 0 for friction
    side : (n,) a guess where the impulses are between their bounds

    Raises
    ------
    NoSolution
        A moving body is caught between fixed ones, or no impulses satisfy the laws of friction.
    """
    n, own, law = len(rate), friction.in_c(), ctypes.c_int()
    given = [numbers(v) for v in (delassus, rate, restitution)]
    guess = None if side is None else np.array(side, np.int64)
    impulse, after, lost, unique = np.empty(n), np.empty(n), np.empty(n), np.empty(n, bool)
    status = library().lmoc_collide(
        n, *(v.ctypes.data for v in given), ctypes.addressof(own), None if guess is None else guess.ctypes.data,
        *(v.ctypes.data for v in (impulse, after, lost, unique)), ctypes.addressof(law),
    )  # fmt: skip
    checked(status, impulse)
    return Impact(impulse, after, lost, (NEWTON, POISSON)[law.value], unique)
