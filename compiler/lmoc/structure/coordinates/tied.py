"""The constraint matrix: how the jets of highest order stand in the equations that are differentiated."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cached_property

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.evaluate import evaluate
from lmoc.structure.coordinates.closure import StartPoint, start_point
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import is_constant
from lmoc.structure.loops.sample import Sample
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Tied:
    """The constraint matrix: derivatives of the equations with c > 0 by the jets of highest order in them.

    Entries (row, column), with their values at a generic point and at the start; `constant`: the entry depends on
    parameters only.
    """

    row: np.ndarray
    column: np.ndarray
    value: np.ndarray
    at_start: np.ndarray
    constant: np.ndarray

    def take(self, kept: np.ndarray) -> Tied:
        return Tied(*(getattr(self, f.name)[kept] for f in fields(self)))

    @cached_property
    def share(self) -> np.ndarray:
        """(nnz,) size of each entry at the start beside the largest in its row; 1 for what never changes."""
        size = np.abs(self.at_start)
        with np.errstate(invalid="ignore"):  # of entries without a value there is no share
            return np.where(self.constant, 1.0, size / largest_in_row(self.row, size)[self.row])


def tied_entries(system: EquationSystem, c: np.ndarray, d: np.ndarray, sample: Sample, least: int = 1) -> Tied:
    """Entries of the constraint matrix at one point: the equations differentiated `least` times or more.

    With ``least=0`` this is the Jacobian of the whole system by its highest derivatives, which must be regular.
    """
    rows, columns, values, constants = [], [], [], []
    for b in system.batches:
        if (c[b.row] < least).all():
            continue
        for leaf in b.unknown:
            k, order = leaf.value
            column = system.column[b.slots[:, k]]
            tight = (c[b.row] >= least) & (d[column] - c[b.row] == order)
            if not tight.any():
                continue
            chosen = b.take(np.flatnonzero(tight))
            partial = differentiate(b.shape, leaf)
            value = evaluate(partial, sample.column(chosen), sample.time)
            rows.append(chosen.row)
            columns.append(column[tight])
            values.append(np.broadcast_to(np.asarray(value, float), len(chosen.row)))
            constants.append(np.full(len(chosen.row), is_constant(partial, b.kinds)))
    s = system.sums
    row, column = s.row[s.entry_row], system.column[s.index]
    tight = (c[row] >= least) & (d[column] - c[row] == s.order)
    rows.append(row[tight])
    columns.append(column[tight])
    values.append(s.coefficient[tight].astype(float))
    constants.append(np.ones(int(tight.sum()), bool))
    row, column, value, constant = (np.concatenate(parts) for parts in (rows, columns, values, constants))
    return Tied(row, column, value, value, constant)


def constraint_matrix(
    system: EquationSystem, c: np.ndarray, d: np.ndarray, sample: Sample, start: StartPoint | None = None
) -> tuple[Tied, StartPoint | None]:
    """The constraint matrix at the sample point and, where it changes along the motion, at the start: that point.

    Parameters
    ----------
    start : the point where the scene starts, if it is known
    """
    tied = tied_entries(system, c, d, sample)
    if tied.constant.all():
        return tied, None
    start = start or start_point(system, c, len(sample.value) - 1)
    value = tied_entries(system, c, d, start.sample).value
    return replace(tied, at_start=np.where(np.isfinite(value), value, 0.0)), start


def largest_in_row(row: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(rows,) the largest of the sizes in each row, 1 where there is none but zero."""
    largest = np.zeros(int(row.max(initial=-1)) + 1)
    np.maximum.at(largest, row, size)
    return np.where(largest > 0, largest, 1.0)
