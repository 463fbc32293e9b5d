"""Relative degrees: how often the motion of a law must be differentiated until its force is felt.

The free scene, with the laws' forces as inputs, is reduced once; which registers depend on a force follows from the
programs. A string between two masses has degree 2, a stop at the end of a damper without mass degree 1, a string
whose ends are springs alone degree 0. Each pair is judged on its own level (A. Isidori, Nonlinear Control Systems,
chapter 4, for the notion; B. Brogliato, Nonsmooth Mechanics, chapter 5, for its role in complementarity systems).
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.law import JENKINS, NONE, Switched
from lmoc.ir.program import Solve, Step, Total
from lmoc.ir.reduced import Reduced

NOT_FELT = -2


def relative_degree(form: Switched, reduced: Reduced) -> np.ndarray:
    """Return 0, 1 or 2 for each law, JENKINS where a velocity feels the rate of the force, or NOT_FELT.

    Parameters
    ----------
    form : of the free form (`switched.free`)
    reduced : its reduction
    """
    register, variable, order = reduced.inputs
    pushed = np.isin(variable, form.push)
    program = reduced.rhs + reduced.observe
    felt = dependent(program, register[pushed], reduced.registers.count)
    degree = np.full(form.count, NOT_FELT)
    for k, variables in reversed(list(enumerate((form.gap, form.rate, form.level)))):
        place = np.where(variables == NONE, -1, reduced.register_of[variables])
        degree[(place >= 0) & felt[place]] = k
    of_rates = dependent(program, register[pushed & (order > 0)], reduced.registers.count)
    place = reduced.register_of[form.rate]
    degree[(form.gap == NONE) & (place >= 0) & of_rates[place]] = JENKINS
    return degree


def dependent(program: tuple[Step, ...], seeds: np.ndarray, count: int) -> np.ndarray:
    """Return (count,) whether a register depends on one of the seeds."""
    found = np.zeros(count, bool)
    found[seeds] = True
    _spread(program, found)
    return found


def _spread(program: tuple[Step, ...], found: np.ndarray) -> None:
    for step in program:
        if isinstance(step, Solve):
            _spread(step.inner, found)
            found[step.unknowns] |= found[step.residuals].any(axis=1, keepdims=True)
            _spread(step.inner, found)
        elif isinstance(step, Total):
            row = np.repeat(np.arange(len(step.out)), np.diff(step.start))
            found[step.out[row[found[step.index]]]] = True
        else:
            found[step.out] |= found[step.slots].any(axis=1)
