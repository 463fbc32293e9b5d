"""Impacts: the impulses with which closed and closing laws stop each other, all at the same instant.

The rates r of the laws change by the impulses Λ through the Delassus matrix W of the whole constrained system,
r⁺ = r⁻ + W·Λ. Newton's law with restitution asks of every law that touches

    0 ≤ Λ ⟂ r⁺ + e·min(r⁻, 0) ≥ 0,

for all laws simultaneously (F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter
8). With different e, or through friction, that can create energy (T. R. Kane, Stanford Mechanics Alumni Club
Newsletter, 1984; C. Glocker, Multibody System Dynamics 29, 2013) or, for laws that depend on each other, contradict
itself. Poisson's law then decides: a plastic impact compresses, and at least e times its impulses is given back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import Array, NoSolution, solve

NEWTON, POISSON = "Newton", "Poisson"
CREATED = 1e-12  # energy gained beyond this share of the energy that the impact turns over counts as created


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


def collide(delassus: Array, rate: Array, restitution: Array) -> Impact:
    """Return the impact of laws that touch.

    Parameters
    ----------
    delassus : (n, n) change of the rates by unit impulses
    rate : (n,) before the impact
    restitution : (n,) coefficients, 0 … 1

    Raises
    ------
    NoSolution
        A moving body is caught between fixed ones.
    """
    try:
        newton = _newton(delassus, rate, restitution)
    except NoSolution:
        return _poisson(delassus, rate, restitution)
    turned = float(np.abs(newton.impulse) @ (np.abs(rate) + np.abs(newton.rate)))
    return newton if -newton.lost.sum() <= CREATED * turned else _poisson(delassus, rate, restitution)


def _newton(delassus: Array, rate: Array, restitution: Array) -> Impact:
    wanted = restitution * np.minimum(rate, 0.0)
    found = solve(delassus, rate + wanted, np.zeros(len(rate)), np.full(len(rate), np.inf))
    return _impact(rate, found.x, found.w - wanted, NEWTON, found.unique)


def _poisson(delassus: Array, rate: Array, restitution: Array) -> Impact:
    n = len(rate)
    compression = solve(delassus, rate, np.zeros(n), np.full(n, np.inf))
    given_back = restitution * compression.x
    expansion = solve(delassus, compression.w + delassus @ given_back, np.zeros(n), np.full(n, np.inf))
    impulse = compression.x + given_back + expansion.x
    return _impact(rate, impulse, expansion.w, POISSON, compression.unique & expansion.unique)


def _impact(before: Array, impulse: Array, after: Array, law: str, unique: NDArray[np.bool_]) -> Impact:
    return Impact(impulse, after, -0.5 * impulse * (before + after), law, unique)
