"""Velocities that the closed laws of a mode hold at zero: their derivatives are zero, not rounding of the forces.

A closed law keeps its rate at zero. Where the rates of closed laws are linear forms in the velocities with constant
coefficients, some velocities may vanish with them, such as those of a body that sticks on a slope. Gauss-Jordan
elimination finds them: rows with a single entry. Where each form ties two velocities at most, as most in one dimension
do, a spanning forest of their ratios tells the same (union and find; R. E. Tarjan, J. ACM 22, 1975).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.limits import NO_ENTRY


def held_velocities(forms: Array) -> NDArray[np.bool_]:
    """Return which velocities (states,) vanish wherever linear forms in them do.

    Parameters
    ----------
    forms : (k, states) coefficients; rows of NaN do not take part
    """
    work = forms[np.isfinite(forms).all(axis=1)]
    size = np.abs(work)
    work = np.where(size > NO_ENTRY * size.max(axis=1, initial=0.0)[:, None], work, 0.0)
    if ((work != 0.0).sum(axis=1) <= 2).all():
        return _held_in_pairs(work)
    return _held_by_elimination(work)


def _held_by_elimination(forms: Array) -> NDArray[np.bool_]:
    """Return the same for forms with any number of entries."""
    work = forms
    used = np.flatnonzero((work != 0.0).any(axis=0))
    work, held = work[:, used].copy(), np.zeros(forms.shape[1], bool)
    scale = np.abs(work).max(axis=1, initial=0.0)
    work, scale = work[scale > 0.0], scale[scale > 0.0]
    left = np.ones(len(work), bool)
    while left.any():
        size = np.where(left[:, None], np.abs(work) / scale[:, None], 0.0)
        row, column = divmod(int(size.argmax()), len(used))
        if size[row, column] <= NO_ENTRY:
            break
        work[row] /= work[row, column]
        others = np.flatnonzero(work[:, column])
        others = others[others != row]
        change = np.outer(work[others, column], work[row])
        noise = NO_ENTRY * np.maximum(np.abs(work[others]), np.abs(change))
        work[others] -= change
        work[others] = np.where(np.abs(work[others]) <= noise, 0.0, work[others])
        left[row] = False
    alone = ~left & ((work != 0.0).sum(axis=1) == 1)
    held[used[(work[alone] != 0.0).any(axis=0)]] = True
    return held


def _held_in_pairs(forms: Array) -> NDArray[np.bool_]:
    """Return the same for forms with one or two entries: ``a·v = 0`` holds v, ``a·v + b·w = 0`` ties both."""
    count = forms.shape[1]
    parent, ratio = list(range(count)), [1.0] * count  # v = ratio·(v of the parent)
    ground = [False] * count

    def root(v: int) -> tuple[int, float]:
        factor = 1.0
        while parent[v] != v:
            factor *= ratio[v]
            v = parent[v]
        return v, factor

    for row in forms:
        entries = np.flatnonzero(row).tolist()
        if not entries:
            continue
        (first, p), a = root(entries[0]), float(row[entries[0]])
        if len(entries) == 1:
            ground[first] = True
            continue
        (second, q), b = root(entries[1]), float(row[entries[1]])
        if first != second:
            parent[first], ratio[first] = second, -b * q / (a * p)
            ground[second] |= ground[first]
        elif abs(a * p + b * q) > NO_ENTRY * (abs(a * p) + abs(b * q)):
            ground[first] = True  # two ratios at once
    met = (forms != 0.0).any(axis=0)
    return np.array([bool(met[v]) and ground[root(v)[0]] for v in range(count)], bool)
