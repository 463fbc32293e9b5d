"""Quantities that change along the motion, and those that change at events only, whose matrices are factorized once."""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import depends_on_time, slots
from lmoc.ir.program import Apply, Program, Solve, Total, read, walk, written
from lmoc.lower.chain_rule import partial
from lmoc.numerics.plan.plan import Plan


def varying_registers(plan: Plan) -> np.ndarray:
    """Return which registers of a plan, (count,), depend on time or on the states."""
    found = np.zeros(plan.count, bool)
    found[plan.states] = found[plan.sampled] = True
    _spread(plan.full_program, found)
    return found


def _spread(program: Program, found: np.ndarray) -> None:
    for step in program:
        if isinstance(step, Apply):
            found[step.out] |= depends_on_time(step.shape) | found[step.slots].any(axis=1)
        elif isinstance(step, Total):
            owner = np.repeat(np.arange(len(step.out)), np.diff(step.start))
            found[step.out[owner[found[step.index]]]] = True
        else:
            inside = any(isinstance(s, Apply) and depends_on_time(s.shape) for s in walk(step.inner))
            if inside or found[read(step)].any():
                found[written(step)] = True


def matrix_varies(block: Solve, varying: np.ndarray) -> bool:
    """Return whether the matrix of a linear block depends on registers that vary.

    Registers beyond those of `varying`, such as those of derivatives, count as varying.
    """
    moved = {int(u) for u in block.unknowns.ravel()}
    for step in block.inner:
        if isinstance(step, Solve):
            return True
        if isinstance(step, Total):
            owner = np.repeat(np.arange(len(step.out)), np.diff(step.start))
            moved |= set(step.out[owner[np.isin(step.index, list(moved))]].tolist())
            continue
        for leaf in slots(step.shape):
            column = step.slots[:, leaf.value[0]]
            rows = np.isin(column, list(moved))
            if not rows.any():
                continue
            derivative = partial(step.shape, leaf.value[0])
            used = [one.value[0] for one in slots(derivative)]
            registers = step.slots[np.ix_(rows, used)]
            if depends_on_time(derivative) or (registers >= len(varying)).any() or varying[registers].any():
                return True
        reached = np.isin(step.slots, list(moved)).any(axis=1) if step.slots.shape[1] else np.zeros(len(step.out), bool)
        moved |= set(step.out[reached].tolist())
    return False
