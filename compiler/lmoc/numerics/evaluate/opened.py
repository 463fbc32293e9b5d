"""Large blocks of a program laid open: their unknowns become algebraic variables of the integrator.

In a network of massless nodes their positions form one sparse block, in a long mechanism the accelerations and
reactions. Solved inside the right-hand side, it makes the Jacobian dense (an inverse); left open, the integrator's own
sparse Newton matrix contains it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.ir.program import Program, Solve
from lmoc.support.sizes import LARGE_BLOCK


def is_large(block: Solve) -> bool:
    """Return whether IDA leaves a block open by default."""
    return block.unknowns.shape[1] > LARGE_BLOCK


def open_blocks(
    program: Program, chosen: Callable[[Solve], bool] = is_large
) -> tuple[Program, np.ndarray, np.ndarray]:
    """Return the program with some blocks replaced by their inner steps; their unknowns and residuals."""
    steps, unknowns, residuals = [], [np.zeros(0, int)], [np.zeros(0, int)]
    for step in program:
        if isinstance(step, Solve) and chosen(step):
            inner, u, r = open_blocks(step.inner, chosen)
            steps += inner
            unknowns += [step.unknowns.ravel(), u]
            residuals += [step.residuals.ravel(), r]
        else:
            steps.append(step)
    return tuple(steps), np.concatenate(unknowns), np.concatenate(residuals)
