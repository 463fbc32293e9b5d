"""Choices of coordinates for a page: what judges each, and how the states pass from one to another.

A page knows the choices that the run has met. Each is a script of its own; the first is that of the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.ir.program import Program
from lmoc.numerics.coordinates.change import all_unknowns
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import renumber
from lmoc.numerics.plan.plan import Plan
from lmoc.view.javascript.registers import RegisterSource


def write_constraints(plan: Plan, registers: RegisterSource) -> tuple[Program, dict[str, Any] | None]:
    """Return what fills the constraint matrix from the registers of the right-hand side, and where its entries are.

    None where the choice never changes.
    """
    own = plan.reduced.constraints
    if own is None:
        return (), None
    shared = plan.reduced.registers.count
    new = np.concatenate([np.arange(shared), registers.add(own.count - shared)])
    data = {
        "rows": own.rows,
        "columns": len(own.variable),
        "row": own.row.tolist(),
        "column": own.column.tolist(),
        "register": new[own.register].tolist(),
        "watched": own.watched.tolist(),
        "variable": own.variable.tolist(),
    }
    return tuple(renumber(step, new) for step in own.program), data


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


def passed(observer: Observer, time: float, x: np.ndarray, other: Plan) -> np.ndarray:
    """Return the states of another plan where the observer's stands at a time and state; NaN for what is not known."""
    found = np.full(len(other.states), np.nan)
    for k, (_, source) in enumerate(passage(observer, other)[: len(found)]):
        if source >= 0:
            found[k] = observer.register(source, np.array([time]), x[None])[0]
    return found


def pairs(here: np.ndarray, there: np.ndarray) -> list[list[int]]:
    """Return [register here, register there] of what has one here."""
    own = here >= 0
    return np.stack([here[own], there[own]], axis=1).tolist()
