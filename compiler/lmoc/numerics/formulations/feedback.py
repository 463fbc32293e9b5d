"""Baumgarte's stabilization: the highest derivative of each closure is set to what lets it and the others decay.

J. Baumgarte, Stabilization of constraints and integrals of motion in dynamical systems, Comput. Methods Appl. Mech.
Eng. 1 (1972): ``g̈ + 2·α·ġ + α²·g = 0``, critically damped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression.dag import Expr, lift, mul, neg, slot, sub
from lmoc.ir.program import Apply, Program, Registers, Role, needed_steps, read, split_program, written
from lmoc.ir.reduced import Invariants, Reduced


def with_feedback(reduced: Reduced, gain: float) -> Reduced:
    """Return a reduced system in all coordinates of its loops, with feedback of their closures.

    Parameters
    ----------
    gain : α, 1/s
    """
    own = reduced.invariants
    count = own.count
    wanted = np.concatenate([read(step) for step in own.program])
    first = needed_steps(reduced.rhs + reduced.observe, wanted, count)
    moved = np.concatenate([np.zeros(0, int), *map(written, first)])
    rhs, observe = (split_program(part, moved, count)[1] for part in (_unset(reduced.rhs, own), reduced.observe))
    table, more = reduced.registers, count - reduced.registers.count
    return replace(
        reduced,
        registers=Registers(
            np.pad(table.role, (0, more), constant_values=int(Role.COMPUTED)),
            np.pad(table.variable, (0, more), constant_values=-1),
            np.pad(table.order, (0, more)),
        ),
        rhs=(*first, *own.program, *_feedback(own, gain), *rhs),
        observe=observe,
        invariants=replace(own, program=()),
    )


def _unset(rhs: Program, own: Invariants) -> Program:
    """Return a program without what sets the highest derivatives of the closures."""
    return tuple(step for step in rhs if not np.isin(written(step), own.acceleration).any())


def _feedback(own: Invariants, gain: float) -> list[Apply]:
    velocity, position = own.lower
    both = position >= 0
    shapes: tuple[tuple[np.ndarray, Expr], ...] = (
        (both, sub(mul(lift(-2.0 * gain), slot(0)), mul(lift(gain * gain), slot(1)))),
        (~both, neg(mul(lift(gain), slot(0)))),
    )
    return [
        Apply(shape, (own.lower if mask is both else own.lower[:1])[:, mask].T, own.acceleration[mask])
        for mask, shape in shapes
        if mask.any()
    ]
