"""Choices of coordinates for a page: what judges each, and how the states pass from one to another.

A page knows the choices that the run has met. Each is a script of its own; the first is that of the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.ir.program import Program
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.change import all_unknowns
from lmoc.numerics.coordinates.watch import MOST_ROWS, told_registers
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import renumber
from lmoc.numerics.observe.trajectory import Trajectory
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass
from lmoc.view.javascript.registers import RegisterSource


@dataclass(frozen=True, eq=False)
class CoordinateTables:
    """What the engine judges the choice of coordinates by.

    Attributes
    ----------
    own : the constraints
    entries, told : registers of the entries, and of the coordinates; of these none where the system does not tell
    ranked : whether constraints may not come to depend on each other
    """

    own: Constraints
    entries: np.ndarray
    told: np.ndarray
    ranked: bool


def is_ranked(trajectory: Trajectory) -> bool:
    """Return whether a run has come to no place where its constraints depend on each other.

    Over such a place a page goes on as its method does; a run begins another segment in the same coordinates behind it.
    """
    reduced = [segment.reduced for segment in trajectory.segments]
    return all(a is not b for a, b in zip(reduced, reduced[1:]))


def write_constraints(
    plan: Plan, registers: RegisterSource, ranked: bool
) -> tuple[Program, dict[str, Any] | None, CoordinateTables | None]:
    """Return what fills the constraint matrix from the registers of the right-hand side, and what is judged by it.

    The latter for the page, and for the engine; None where the choice never changes.
    """
    own = plan.reduced.constraints
    if own is None:
        return (), None, None
    shared = plan.reduced.registers.count
    new = np.concatenate([np.arange(shared), registers.add(own.count - shared)])
    data = {"rows": own.rows, "variable": own.variable.tolist(), "source": own.source.tolist()}
    told = told_registers(plan)
    tables = CoordinateTables(own, new[own.register], told, ranked and own.rows <= MOST_ROWS)
    return tuple(renumber(step, new) for step in own.program), data, tables


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
