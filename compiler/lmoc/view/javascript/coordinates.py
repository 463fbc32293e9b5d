"""Choices of coordinates for a page: what judges each, and how the states pass from one to another.

A page knows the choices that the run has met. Each is a script of its own; the first is that of the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.ir.program import Program
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.change import all_unknowns, block_unknowns
from lmoc.numerics.coordinates.entries import entries_program
from lmoc.numerics.coordinates.tableau import coordinate_units
from lmoc.numerics.coordinates.watch import MOST_ROWS, told_registers
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import renumber
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.run.changes import AHEAD, BUSY
from lmoc.numerics.run.segments import ROUNDING
from lmoc.support.records import dataclass
from lmoc.view.javascript.registers import RegisterSource


@dataclass(frozen=True, eq=False)
class CoordinateTables:
    """What the engine judges the choice of coordinates by.

    Attributes
    ----------
    own : the constraints
    units : (columns,) in which coordinates are compared
    entries, told, solved : registers of the entries; of the coordinates, none where the system does not tell; of the
        unknowns of nonlinear blocks
    ranked : whether constraints may not come to depend on each other; those of many loops are seen as a whole here
    """

    own: Constraints
    units: np.ndarray
    entries: np.ndarray
    told: np.ndarray
    solved: np.ndarray
    ranked: bool


def write_constraints(
    observer: Observer, registers: RegisterSource
) -> tuple[Program, dict[str, Any] | None, CoordinateTables | None]:
    """Return what fills the constraint matrix from the registers of the right-hand side, and what is judged by it.

    The latter for the page, and for the engine; None where nothing that is divided by changes along the motion.
    """
    plan = observer.plan
    own = plan.reduced.constraints
    if own is None or not len(plan.states):
        return (), None, None
    shared = plan.reduced.registers.count
    new = np.concatenate([np.arange(shared), registers.add(own.count - shared)])
    data = {
        "rows": own.rows,
        "variable": own.variable.tolist(),
        "keys": [keys.tolist() for keys in own.keys],
        "watched": [observer.flat.variable_name(int(v)) for v in own.variable[own.watched]],
        "sizes": [float(v) if np.isfinite(v) else None for v in plan.nominal(observer.values)],
        "rounding": ROUNDING,
        "ahead": AHEAD,
        "busy": BUSY,
    }
    registers_of_blocks = plan.once(block_unknowns)
    units, told = coordinate_units(plan, observer.values[plan.known[1]]), told_registers(plan)
    tables = CoordinateTables(own, units, new[own.register], told, registers_of_blocks, own.rows <= MOST_ROWS)
    return tuple(renumber(step, new) for step in entries_program(plan)), data, tables


def coordinates(plan: Plan) -> list[int]:
    """Return the flat variables that are states, their rates left out."""
    table = plan.reduced.registers
    own = plan.states[: plan.state_count]
    return table.variable[own[table.order[own] == 0]].tolist()


def passage(observer: Observer, other: Plan) -> list[list[int]]:
    """Return [register there, register here] of the states and the unknowns of nonlinear blocks of another plan.

    The registers here are those of the jets that they stand for, as in `numerics.coordinates.change`; -1 for none.
    """
    table, place = other.reduced.registers, observer.plan.reduced.register_of
    found = []
    for register in (*other.states.tolist(), *all_unknowns(other).tolist()):
        variable, order = int(table.variable[register]), int(table.order[register])
        source = -1
        if variable >= 0:
            source = int(place[variable]) if order == 0 else observer.derivative(variable, order)
        found.append([register, source])
    return found


def pairs(here: np.ndarray, there: np.ndarray) -> list[list[int]]:
    """Return [register here, register there] of what has one here."""
    own = here >= 0
    return np.stack([here[own], there[own]], axis=1).tolist()
