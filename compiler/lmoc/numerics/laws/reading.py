"""The quantities that show the end of a mode: motions, rates, forces and sticking limits of its laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.evaluate.casadi_system import can_lower
from lmoc.numerics.laws.delassus_update import ModeFunctions, updatable
from lmoc.numerics.laws.instant import Array, ContactKinematics
from lmoc.numerics.observe.readout import readout_of
from lmoc.numerics.observe.slices import Evaluate, slice_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal

Reader = Callable[[Array, Mapping[int, Signal]], Evaluate]


def reader(kinematics: ContactKinematics) -> Reader:
    """Return ``(base, signals) -> (times, states) -> (times, 4 laws)``: motions, rates, forces and sticking limits.

    The motion is the gap of laws that have one, else the rate. Limits that are parameters are not among the values.
    What it has returned last counts, no other.
    """
    plan = kinematics.plan
    if not can_lower(plan.program):
        update = updatable(plan, kinematics.signals)
        if update is not None:
            return lambda base, signals: _in_mode(kinematics, update, base, signals)
    return readout_of(plan, reading_registers(kinematics)).binder()


def rates(plan: Plan, base: Array, signals: Mapping[int, Signal]) -> Evaluate:
    """Return ``(times, states) -> (times, states)``: the derivatives of the states in the mode that holds."""
    update = None if plan.reduced.free is None or can_lower(plan.program) else updatable(plan, signals)
    if update is not None:
        return update.bind(update.rates, base, signals)
    return slice_of(plan, plan.derivatives).bind(base, signals)


def _in_mode(
    kinematics: ContactKinematics, update: ModeFunctions, base: Array, signals: Mapping[int, Signal]
) -> Evaluate:
    read, n = update.bind(update.reading, base, signals), kinematics.form.count
    registers = update.scene.quantities.registers
    present = registers >= 0
    has_gap = kinematics.registers[0] >= 0

    def evaluate(times: Array, states: Array, known: Array | None = None) -> Array:
        found = read(times, states)
        value = np.zeros((len(times), 6, n))
        value[:, present] = found[:, : int(present.sum())]
        motion = np.where(has_gap, value[:, 0], value[:, 1])
        return np.concatenate([motion, value[:, 1], found[:, -n:], value[:, 4]], axis=1)

    return evaluate


def reading_registers(kinematics: ContactKinematics) -> NDArray[np.int64]:
    """Return the registers of motions, rates, forces and sticking limits; any one in place of those that are none."""
    gap, rate, _, _, stick, _ = kinematics.registers
    motion = np.where(gap >= 0, gap, rate)
    found = np.concatenate([motion, rate, kinematics.force, stick])
    return np.where(found >= 0, found, found.max())
