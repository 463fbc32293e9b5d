"""A nonlinear block as one casadi function with Newton's iterations in it.

A few iterations from the last solution are written out one after the other. The function says whether they have
converged to a solution near the last one; where they have not, the segmented evaluation takes the trouble.
"""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Solve
from lmoc.numerics.evaluate.casadi_system import eliminate, lower_steps
from lmoc.numerics.evaluate.segments import outside

_ITERATIONS = 6
_LARGEST = 16  # unknowns of a block whose elimination is written out
_ROWS = 1500  # of a program whose blocks are
_EXACT, _FAST = 1e-13, 1e-2  # the last correction is this small, or this small beside the one before and below …
_SMALL = 1e-9  # … this, after which the error is of its square
_NEAR, _LOOSE = 0.25, 1e-8  # as in `newton`


def _iterate(step: Solve, w: list, t, start: dict) -> list[tuple]:
    """Write out Newton's iterations of a block; its solution and what lies between stand in w afterwards.

    Returns for each instance the two of `_conditions`.
    """
    import casadi as ca

    unknowns = step.unknowns.ravel().tolist()
    reads = outside(step.inner, step.unknowns.ravel(), len(w))
    function = block_function(step, reads, len(w))
    values = ca.vertcat(ca.SX(0, 1), *[w[r] for r in reads.tolist()])
    first = found = ca.vertcat(*[start[k] for k in unknowns])
    changes, target = [], None
    for _ in range(_ITERATIONS):
        parts = function(t, found, values)
        changes.append(ca.vertcat(*[ca.vertcat(*eliminate(a, -r)) for r, a in zip(parts[::2], parts[1::2])]))
        found = found + changes[-1]
        target = found if target is None else target
    for register, value in zip(unknowns, ca.vertsplit(found), strict=True):
        w[register] = value
    lower_steps(step.inner, w, t)
    size = step.unknowns.shape[1]
    instances = [range(k, k + size) for k in range(0, len(unknowns), size)]
    return [_conditions(own, first, target, found, changes) for own in instances]


def block_function(step: Solve, reads: np.ndarray, count: int):
    """``(t, unknowns, registers read) -> (residuals, their Jacobian)`` of one instance after the other."""
    import casadi as ca

    t, u, values = ca.SX.sym("t"), ca.SX.sym("u", step.unknowns.size), ca.SX.sym("w", len(reads))
    w: list = [None] * count
    for registers, symbols in ((step.unknowns.ravel(), u), (reads, values)):
        for register, symbol in zip(registers.tolist(), ca.vertsplit(symbols) if len(registers) else [], strict=True):
            w[register] = symbol
    lower_steps(step.inner, w, t)
    parts = []
    for own, residual in zip(step.unknowns.tolist(), step.residuals.tolist(), strict=True):
        r = ca.vertcat(*[w[k] for k in residual])
        parts += [r, ca.densify(ca.jacobian(r, ca.vertcat(*[w[k] for k in own])))]
    return ca.Function("block", [t, u, values], parts)


def _conditions(own: range, first, target, found, changes) -> tuple:
    """Return whether an instance has converged, and to where its first step has pointed."""
    import casadi as ca

    def largest(x):
        return ca.mmax(ca.fabs(ca.vertcat(*[x[k] for k in own])))

    size = 1 + largest(found)
    last, before = largest(changes[-1]), largest(changes[-2])
    fast = ca.logic_and(last <= _SMALL * size, last <= _FAST * before)
    converged = ca.logic_or(last <= _EXACT * size, fast)
    way, missed = largest(found - first), largest(found - target)
    near = ca.logic_and(way <= _NEAR * size, missed <= _NEAR * way + _LOOSE * size)
    return converged, near
