"""Inertias without freedom because of nonlinear constraints: one between two arms of different length.

Freedom spreads from coordinates that are states, and from prescribed motions, through each constraint to the position
that is computed from it. Positions that it does not reach are constants.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import depends_on_time
from lmoc.structure.coordinates.preferences import inertial
from lmoc.structure.coordinates.selection import Selection
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import INPUT, leaves_of
from lmoc.support.distinct import distinct


def immobile(selection: Selection) -> tuple[np.ndarray, np.ndarray]:
    """Columns of coordinates of inertias that cannot move, and the constraints that hold everything there.

    Linear constraints have been judged before (E0412). A body that slides along a line without turning moves.
    """
    system, tied, c, d = selection.system, selection.tied, selection.c, selection.d
    nothing = np.zeros(0, np.int64), np.zeros(0, np.int64)
    if tied.constant.all():
        return nothing
    match = np.full(system.rows, -1, np.int64)  # the position that each constraint gives
    for stage, (rows, columns) in enumerate(selection.choice.match, 1):
        own = (c[rows] == stage) & (d[columns] == stage)
        match[rows[own]] = columns[own]
    geometry = match[tied.row] >= 0
    row, column = tied.row[geometry], tied.column[geometry]
    between = Incidence.of(system.rows, len(d), row, column, np.zeros(len(row), np.int64))
    held = np.zeros(len(d), bool)
    held[match[match >= 0]] = True
    new = np.flatnonzero(~held)
    driven = match[_prescribed(system)]
    new = np.concatenate([new, driven[driven >= 0]])
    while len(new):
        held[new] = False
        reached = match[between.row[between.of_columns(new)]]
        new = distinct(reached[held[reached]])
    inertias = inertial(system, c)
    fixed = _of_resting_parts(system, np.flatnonzero(held & inertias), inertias & ~held)
    fixed = fixed[~np.isin(fixed, _of_turning_bodies(system, c, ~held))]
    return (fixed, np.flatnonzero((match >= 0) & held[match])) if len(fixed) else nothing


def _of_resting_parts(system: EquationSystem, fixed: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    """Return the fixed columns of parts none of whose coordinates is mobile; all those of the model itself."""
    part = system.flat.per_variable(lambda b: b.part, np.int64)
    column = system.column[system.normalized.root]
    moving = np.unique(part[(column >= 0) & mobile[column]])
    own = part[system.variable[fixed]]
    result: np.ndarray = fixed[(own == 0) | ~np.isin(own, moving)]
    return result


def _of_turning_bodies(system: EquationSystem, c: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    """Return the columns whose inertia is that of a part in which another column changes.

    A body in space that hangs in a point stays there and turns, with a velocity that is a state of its own; its place
    bears the name of a frame of another part.
    """
    i, groups = system.incidence, system.flat.groups
    part = np.zeros(system.flat.equation_count, np.int64)  # balances belong to none, as does what the model itself says
    part[: sum(g.rows for g in groups)] = np.repeat([g.part for g in groups], [g.rows for g in groups])
    own = (i.order >= 1) & (c[i.row] == 0)
    part_of, column = part[system.source[i.row[own]]], i.column[own]
    moving = distinct(part_of[mobile[column]])
    result: np.ndarray = distinct(column[(i.order[own] >= 2) & (part_of > 0) & np.isin(part_of, moving)])
    return result


def _prescribed(system: EquationSystem) -> np.ndarray:
    """Rows in which an input or time appears."""
    rows = [b.row for b in system.batches if leaves_of(b.shape, b.kinds, INPUT) or depends_on_time(b.shape)]
    return np.concatenate([np.zeros(0, np.int64), *rows])
