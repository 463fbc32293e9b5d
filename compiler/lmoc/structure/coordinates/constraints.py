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
    rows, match = selection.choice.match[0]
    dependent = np.full(len(selection.d), -1)
    dependent[match] = rows  # the row that each dependent column stands for
    kept, watched = rows_to_watch(row, column, constant, dependent, selection.system.rows)
    if not kept.any():
        return None
    own = np.flatnonzero(kept[row])
    number = np.cumsum(kept) - 1
    columns = np.full(len(selection.d), -1)
    mine = kept[rows]
    columns[match[mine]] = number[rows[mine]]
    states = np.unique(column[own][columns[column[own]] < 0])
    columns[states] = int(kept.sum()) + np.arange(len(states))
    program, place = _program(formulas, kept, row, first)
    order = np.argsort(columns)[-(int(kept.sum()) + len(states)) :]
    return Constraints(
        program,
        first + len(own),
        number[row[own]],
        columns[column[own]],
        place[own],
        np.flatnonzero(watched[kept]),
        selection.system.variable[order],
        selection.system.source[kept],
    )


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
    formulas: list[tuple[Expr, np.ndarray]], kept: np.ndarray, row: np.ndarray, first: int
) -> tuple[tuple[Step, ...], np.ndarray]:
    """Return the steps that fill the entries of the rows kept, and the register of each entry."""
    place, steps, start = np.full(len(row), -1), [], 0
    for shape, table in formulas:
        mine = np.flatnonzero(kept[row[start : start + len(table)]])
        out = first + np.arange(len(mine))
        place[start + mine] = out
        if len(mine):
            steps.append(Apply(shape, table[mine], out))
        first, start = first + len(mine), start + len(table)
    return tuple(steps), place
