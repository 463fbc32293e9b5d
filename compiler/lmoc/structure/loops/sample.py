"""Points at which coefficients are looked at: a generic one, and the one where the scene starts.

What vanishes at the generic point vanishes everywhere; what vanishes at the start must not be divided by there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.expression.dag import const
from lmoc.ir.flat import Assignments
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.linear.coefficients import INPUT, KNOWN
from lmoc.structure.linear.generic import spread_at
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

# a time at which nothing special happens
GENERIC_TIME = 0.1234

# how easily a fixed value gives way, a start value, and one of those that count least
FIXED, MEANT, GUESSED = 1e-8, 1e-4, 1e-2

# what a variable without start value begins with: near the zero that it is given where it becomes a state
UNMARKED = 1e-2


@dataclass(frozen=True, eq=False)
class Sample:
    """Values of all jets.

    Attributes
    ----------
    value : (orders, extended) of each extended variable and its derivatives
    time : s
    """

    value: np.ndarray
    time: float

    def column(self, batch: EquationBatch) -> Callable[[int, int], np.ndarray]:
        """Return the values that `expression.evaluate` reads."""
        return lambda k, order: self.value[order, batch.slots[:, k]]


def generic(system: EquationSystem, highest: int) -> Sample:
    """A generic point near the start, at which coefficients are distinguished from zero.

    Start values where they are given and not zero, else small generic numbers; parameters without a value get a
    generic one of ordinary size. The same at every call.
    """
    value = _small(system, highest)
    for a in system.flat.starts:
        jets, found = _of_roots(system, a, value)
        good = found != 0
        value.flat[jets[good]] = found[good]
    return Sample(value, GENERIC_TIME)


def given(
    system: EquationSystem, highest: int, fixed: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[Sample, np.ndarray]:
    """Return the start as the model states it: start values, and inputs at the start time; all else is nearly zero.

    Parameters
    ----------
    highest : order of derivatives
    fixed : flat variables, and values that are fixed for one run

    Returns
    -------
    sample : Sample
    ease : (orders, extended) how easily each value gives way to others: start values hardly, those that count most
        less than others, fixed ones least
    """
    flat = system.flat
    time = flat.experiment.start or 0.0
    value, ease = _small(system, highest), np.ones((highest + 1, len(system.kind)))
    value[:, system.kind != KNOWN] *= UNMARKED
    for a in flat.input_bindings:
        numbers = a.values(value[0], time)
        value[0, a.target] = np.where(np.isfinite(numbers), numbers, value[0, a.target])
    start = np.full(flat.count, np.nan)
    ranks = distinct(np.array([a.rank for a in flat.starts], int))
    for a in flat.starts:
        start[a.target] = a.values(value[0])
        jets, found = _of_roots(system, a, value)
        value.flat[jets] = found
        share = np.searchsorted(ranks, a.rank) / max(1, len(ranks) - 1)
        ease.flat[jets] = MEANT * (GUESSED / MEANT) ** share
    for a in flat.fixed:
        # of several names of one variable, that which is fixed counts; fixed without a value: at zero
        target = a.target[a.values(value[0]) > 0]
        _fix(system, target, np.nan_to_num(start[target]), value, ease)
    if fixed is not None:
        _fix(system, *fixed, value, ease)
    if system.normalized.near is not None:
        root, order, numbers = system.normalized.near
        inside = order <= highest
        inside[inside] = ease[order[inside], root[inside]] == 1.0
        value[order[inside], root[inside]] = numbers[inside]
    return Sample(value, time), ease


def _fix(
    system: EquationSystem, target: np.ndarray, numbers: np.ndarray, value: np.ndarray, ease: np.ndarray
) -> None:
    """Let variables be fixed in `ease`, at some numbers."""
    if not len(target):
        return
    a = Assignments(target, const(np.nan), np.zeros((len(target), 0), int), numbers=np.asarray(numbers, float))
    jets, found = _of_roots(system, a, value)
    ease.flat[jets] = FIXED
    value.flat[jets] = found


def _small(system: EquationSystem, highest: int) -> np.ndarray:
    """(orders, extended) the known values, and small generic numbers for all else."""
    count = len(system.kind)
    value = np.zeros((highest + 1, count))  # eliminated variables keep the zeros, and their pages are never touched
    changing = np.concatenate([system.variable, np.flatnonzero(system.kind == INPUT)])
    for order in range(highest + 1):
        value[order, changing] = (0.2 + spread_at(order * count + changing)) * 1e-2
    known = np.flatnonzero(system.kind == KNOWN)
    numbers = system.normalized.all_values[known]
    lacking = np.flatnonzero(~np.isfinite(numbers))
    numbers[lacking] = 0.5 + spread_at(lacking)
    value[0, known] = numbers
    return value


def _of_roots(system: EquationSystem, a: Assignments, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start values as values of jets of roots: positions in the flattened `value`, and numbers."""
    n = system.normalized
    wanted = np.asarray(a.values(value[0]), float)
    factor = np.where(n.factor[a.target] >= 0, value[0, n.factor[a.target]], 1.0)
    factor[n.factor[a.target] == -2] = -1.0
    offset = np.where(n.offset[a.target] >= 0, value[0, n.offset[a.target]], 0.0)
    with np.errstate(all="ignore"):
        found = (wanted - offset) / factor
    root, order = n.root[a.target], n.order[a.target]
    good = np.isfinite(found) & (system.column[root] >= 0) & (order < len(value))
    return order[good] * value.shape[1] + root[good], found[good]
