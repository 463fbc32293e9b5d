"""Events and laws on the way over a singular position, which nobody integrates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
from lmoc.numerics.problem.roots import Roots

if TYPE_CHECKING:
    from lmoc.numerics.coordinates.passage import Passage

_LOOKS = 32  # places on a passage; even, so that none is the singular one in its middle


def happen_on(dynamics: HybridDynamics, passage: Passage, unknowns: np.ndarray) -> bool:
    """Return whether something happens on a passage over a singular position, or next to either end.

    Parameters
    ----------
    unknowns : registers of what `Passage.solutions` are
    """
    times = np.linspace(passage.times[0], passage.times[-1], _LOOKS)
    states, solutions = passage.at(times)
    happened = bool(times[-1] >= dynamics.until)
    for t, x, solution in zip(times.tolist(), states, solutions, strict=True):
        dynamics.stand_at(unknowns, solution)
        roots = None if happened else dynamics.roots(t, x)
        happened = happened or (roots is not None and _crossed(roots, t, x))
    dynamics.stand_at(unknowns, passage.solutions[0])
    return happened


def _crossed(roots: Roots, t: float, x: np.ndarray) -> bool:
    """Return whether a root function has another sign than where the segment began, or no value."""
    value = roots.values(np.array([t]), x[None])[0]
    return bool((value * roots.signs < 0).any() or np.isnan(value).any())
