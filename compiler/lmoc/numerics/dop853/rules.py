"""The rules by which DOP853 accepts steps and chooses their lengths, in Python (`dop853`) and in C (`dop853_walk.c`).

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 and II.5, and their code DOP853, from
which the test for stiffness is (volume II, IV.2).
"""

from __future__ import annotations

from lmoc.support.records import dataclass


@dataclass(frozen=True)
class Rules:
    """Bounds and factors, in the order of ``lmoc_rules``.

    Attributes
    ----------
    safety, shrink, grow : factor on the length that the error asks for, and bounds of its change
    retry : factor on the length where a value is not finite
    rough_from, rough : |h·λ| and roughness, in tolerances, from which the dense output is not good enough
    careful, careful_steps : |h·λ| up to which it is, and which the steps keep to for so many steps after one was found
        too rough
    stiff_limit, stiff_steps : |h·λ| at the edge of the region of stability, and steps beyond it that show stiffness …
    calm_steps : … unless so many have been within
    cuts, pace : steps cut short for values that are not finite, after which they must have got on by that part of what
        lies ahead each
    least : s, a step that can still be divided by
    """

    safety: float = 0.9
    shrink: float = 0.2
    grow: float = 8.0
    retry: float = 0.1
    rough_from: float = 5.5
    rough: float = 60.0
    careful: float = 4.5
    careful_steps: float = 50
    stiff_limit: float = 6.1
    stiff_steps: float = 15
    calm_steps: float = 6
    cuts: float = 500
    pace: float = 1e-9
    least: float = 1e-300


RULES = Rules()
