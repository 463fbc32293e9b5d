"""Values that step at an event while the equations hold derivatives of them, such as a prescribed position.

The derivative of a step is an impulse. Where only the work of the source needs it, that is what the scene stores more
behind the step; where the motion needs it, velocities would jump.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.program import Program, needed_steps, read, walk, written
from lmoc.numerics.observe.readout import Readout
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal

_CONTINUOUS = 1e-9  # share of a value by which it may change at an event and still be continuous


def _read(program: Program, count: int) -> np.ndarray:
    """Return which registers a program reads."""
    found = np.zeros(count, bool)
    for step in walk(program):
        found[read(step)] = True
    return found


def _jets(flat: FlatDAE, register_of: np.ndarray) -> set[tuple[int, int]]:
    """Return the registers of variables and of those that are declared as their derivatives, ``der(q) = v``."""
    found = set()
    for group in flat.groups:
        for side, other in ((group.left, group.right), (group.right, group.left)):
            if side.op == other.op == "slot" and side.value[1] == 1 and other.value[1] == 0:
                columns = [side.value[0], other.value[0]]
                found |= {(a, b) for a, b in register_of[group.slots[:, columns]].tolist()}
    return found


class Steps:
    """The variables that discrete values decide about and that have derivatives in a plan.

    Attributes
    ----------
    registers : (k,) of the variables themselves
    moving : (k,) whether the motion needs a derivative of them
    stored : whether the ledger's stored energy is the last of the values
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, reduced = plan, plan.reduced
        table, flat = reduced.registers, reduced.flat
        changing = np.zeros(plan.count, bool)
        changing[reduced.register_of[flat.events.discrete]] = True
        changing[plan.states] = False
        for step in plan.full_program:
            if any(changing[read(s)].any() for s in walk((step,))):
                changing[written(step)] = True
        moves = _read(needed_steps(plan.program, reduced.derivatives, plan.count), plan.count)
        matters = _read(plan.full_program, plan.count)
        above = np.flatnonzero((table.order >= 1) & (table.variable >= 0))
        pairs = {(int(reduced.register_of[table.variable[k]]), int(k), int(table.order[k])) for k in above.tolist()}
        jets = {(a, b, 1) for a, b in _jets(flat, reduced.register_of)}
        pairs |= jets | {(a, c, 2) for a, b, _ in jets for other, c, _ in jets if other == b}
        pairs = {p for p in pairs if p[0] >= 0 and p[1] >= 0 and changing[p[0]]}
        self.registers = np.array(sorted({p[0] for p in pairs}), int)
        needed = [a for a, b, order in pairs if moves[b] or (order > 1 and matters[b])]
        self.moving = np.isin(self.registers, needed)
        stored = flat.find("ledger.stored")
        register = -1 if stored is None else int(reduced.register_of[stored[0]])
        self.stored = register >= 0 and len(self.registers) > 0
        wanted = np.append(self.registers, register) if self.stored else self.registers
        self.readout = Readout(plan, plan.full_program, plan.count, wanted)

    def values(self, t: float, x: np.ndarray, base: np.ndarray, signals: Mapping[int, Signal]) -> np.ndarray:
        """Return the variables' values with the discrete ones in `base`, and the stored energy behind them."""
        self.readout.prepare(base, signals)
        return self.readout(t, x).copy()

    def jumped(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return which variables, (k,), are not continuous."""
        k = len(self.registers)
        return np.abs(after - before)[:k] > _CONTINUOUS * np.maximum(np.abs(after), np.abs(before))[:k]
