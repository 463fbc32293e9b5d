"""The closures of loops as a program: what a motion keeps, position and velocity level apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.ir.program import Apply
from lmoc.ir.reduced import Invariants
from lmoc.structure.coordinates.closures import Closures
from lmoc.structure.coordinates.selection import Selection
from lmoc.structure.index.system import EquationBatch, derivative
from lmoc.structure.linear.explicit import as_formula


def invariants(
    selection: Selection, found: Closures, states: np.ndarray, acceleration: np.ndarray, first: int
) -> Invariants:
    """Return the closures and their derivatives below the highest.

    Parameters
    ----------
    states : registers of the states
    acceleration : as in `Invariants`
    first : number of registers so far; those of the residuals follow
    """
    layout = selection.layout
    steps, stages, rows = [], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for times, b in _batches(selection, found):
        formula, leaves = as_formula(b.shape)
        table = [layout.base[b.slots[:, leaf.value[0]]] + leaf.value[1] for leaf in leaves]
        slots = np.stack(table, axis=1) if table else np.zeros((len(b.row), 0), np.int64)
        out = first + sum(map(len, rows)) + np.arange(len(b.row))
        steps.append(Apply(formula, slots, out))
        stages.append(np.full(len(b.row), times))
        rows.append(b.row)
    stage, row = np.concatenate(stages), np.concatenate(rows)
    residual = first + np.arange(len(row))
    lower = np.full((2, len(acceleration)), -1)
    number = np.full(selection.system.rows, -1)
    number[found.row] = np.arange(len(found.row))
    if len(acceleration):
        for k in (1, 2):
            lower[k - 1, number[row[stage == k]]] = residual[stage == k]
    variable, order = layout.jets
    state_stage = selection.d[selection.system.column[variable[states]]] - order[states]
    source = selection.system.source[row]
    return Invariants(tuple(steps), first + len(row), residual, stage, source, state_stage, acceleration, lower)


def _batches(selection: Selection, found: Closures) -> Iterator[tuple[int, EquationBatch]]:
    """Yield the closures and their derivatives, each with its stage: how far it is below the highest."""
    closing = found.among(selection.system.rows)
    for b in selection.system.batches:
        rows, shape = np.flatnonzero(closing[b.row]), b.shape
        if not len(rows):
            continue
        c = selection.c[b.row[rows]]
        for times in range(int(c.max())):
            if times:
                shape = derivative(shape, b.kinds)
            for stage in np.unique(c[c > times] - times).tolist():
                own = rows[c - times == stage]
                yield stage, EquationBatch(shape, b.kinds, b.slots[own], b.row[own], times)
