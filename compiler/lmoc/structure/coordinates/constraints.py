"""The constraint matrix as a program: what a choice of coordinates divides by, to be watched along a motion.

Only some of it can become singular. In block lower triangular form by rows and dependent coordinates, blocks with
constant entries alone stay regular for ever: the joints of a tree, geared shafts. The other blocks, and what they read,
are kept.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr, lift
from lmoc.ir.program import Apply, Step
from lmoc.ir.reduced import Constraints
from lmoc.structure.coordinates.closures import rows_to_watch
from lmoc.structure.coordinates.selection import Selection
from lmoc.structure.index.dulmage_mendelsohn import least_connected
from lmoc.structure.linear.coefficients import is_constant
from lmoc.structure.linear.explicit import as_formula

_Entries = tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[Expr, np.ndarray]]]


def changing_constraints(selection: Selection, first: int) -> Constraints | None:
    """Return the constraints whose dependent coordinates could cease to follow; None where there are none.

    Parameters
    ----------
    first : number of registers so far; those of the entries follow
    """
    if selection.start is None or not selection.choice.dependent:
        return None
    row, column, constant, formulas = _entries(selection)
    rows, columns = selection.system.rows, len(selection.d)
    entry, stage, dependent = _stages(selection, row, column)
    row, column = row[entry] + rows * stage, column[entry] + columns * stage
    kept, watched = rows_to_watch(row, column, constant[entry], dependent, len(dependent) // columns * rows)
    if not kept.any():
        return None
    number = np.cumsum(kept) - 1
    place = np.full(len(dependent), -1)
    mine = np.flatnonzero(dependent >= 0)
    mine = mine[kept[dependent[mine]]]
    place[mine] = number[dependent[mine]]
    own = np.flatnonzero(kept[row])
    states = np.unique(column[own][place[column[own]] < 0])
    place[states] = len(mine) + np.arange(len(states))
    order = np.argsort(place)[-(len(mine) + len(states)) :]
    read = np.zeros(len(constant), bool)
    read[entry[own]] = True
    program, register = _program(formulas, read, first)
    return Constraints(
        program,
        first + int(read.sum()),
        number[row[own]],
        place[column[own]],
        register[entry[own]],
        np.flatnonzero(watched[kept]),
        selection.system.variable[order % columns],
        selection.system.source[np.flatnonzero(kept) % rows],
        order // columns,
    )


def _stages(
    selection: Selection, row: np.ndarray, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the entries of all stages in which something is chosen, and the row that each dependent column stands for.

    What is dependent in one stage is chosen from in the next one: with rates of turn for states, all four derivatives
    of a quaternion are dependent, and three of its numbers are states. Where constraints have no more columns left than
    they are themselves, nothing is chosen, and they stay regular as long as those of the stage before.

    Returns
    -------
    entry, stage : (entries,) number of an entry of the first stage; the stage, from 0, of each entry
    dependent : (stages * columns,) row + stage*rows; -1 for columns that are states, or have no place in the stage
    """
    rows, columns, match = selection.system.rows, len(selection.d), selection.choice.match
    entries: list[np.ndarray] = [np.arange(len(row))]
    dependent: list[np.ndarray] = []
    for stage, (own, chosen) in enumerate(match):
        found = np.full(columns, -1)
        if stage:
            before, among = dependent[-1] >= 0, np.zeros(rows, bool)
            among[own] = True
            part = np.flatnonzero(among[row] & (selection.d > stage)[column] & before[column])
            part = part[_open(row[part], column[part], rows, columns)]
            entries.append(part)
            own, chosen = own[kept := np.isin(own, row[part])], chosen[kept]
        found[chosen] = own + stage * rows
        dependent.append(found)
    stages = np.repeat(np.arange(len(entries)), [len(part) for part in entries])
    return np.concatenate(entries), stages, np.concatenate(dependent)


def _open(row: np.ndarray, column: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """(entries,) mask of those in connected parts with more columns than rows."""
    label = least_connected(row, rows + column, rows + columns)
    has = np.zeros(rows + columns, bool)
    has[row] = has[rows + column] = True
    surplus = np.bincount(label, np.where(np.arange(rows + columns) < rows, -1, 1) * has, rows + columns)
    result: np.ndarray = surplus[label[row]] > 0
    return result


def _entries(selection: Selection) -> _Entries:
    """Return rows, columns and constancy of the entries of the first stage, and their formulas over registers."""
    system, c, d, base = selection.system, selection.c, selection.d, selection.layout.base
    rows, columns, constants, formulas = [], [], [], []
    for b in system.batches:
        for leaf in b.unknown:
            k, order = leaf.value
            column = system.column[b.slots[:, k]]
            tight = (c[b.row] >= 1) & (d[column] - c[b.row] == order)
            if tight.any():
                shape, leaves = as_formula(differentiate(b.shape, leaf))
                table = [base[b.slots[tight, jet.value[0]]] + jet.value[1] for jet in leaves]
                formulas.append((shape, np.stack(table, axis=1) if table else np.zeros((int(tight.sum()), 0), int)))
                rows.append(b.row[tight])
                columns.append(column[tight])
                constants.append(np.full(len(rows[-1]), is_constant(differentiate(b.shape, leaf), b.kinds)))
    s = system.sums
    row, column = s.row[s.entry_row], system.column[s.index]
    tight = (c[row] >= 1) & (d[column] - c[row] == s.order)
    for value in np.unique(s.coefficient[tight]).tolist():
        own = tight & (s.coefficient == value)
        rows.append(row[own])
        columns.append(column[own])
        constants.append(np.ones(int(own.sum()), bool))
        formulas.append((lift(float(value)), np.zeros((int(own.sum()), 0), int)))
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(constants), formulas


def _program(
    formulas: list[tuple[Expr, np.ndarray]], read: np.ndarray, first: int
) -> tuple[tuple[Step, ...], np.ndarray]:
    """Return the steps that fill the entries that are read, and the register of each entry."""
    place, steps, start = np.full(len(read), -1), [], 0
    for shape, table in formulas:
        mine = np.flatnonzero(read[start : start + len(table)])
        out = first + np.arange(len(mine))
        place[start + mine] = out
        if len(mine):
            steps.append(Apply(shape, table[mine], out))
        first, start = first + len(mine), start + len(table)
    return tuple(steps), place
