"""A flat model with events as its equations are written, for derivations: one set of smooth or switched formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression.dag import const
from lmoc.ir.flat import Assignments, FlatDAE, Kind


def as_written(flat: FlatDAE, values: np.ndarray, held: np.ndarray | None = None) -> tuple[FlatDAE, np.ndarray]:
    """Return the model without events, and the values of its parameters and constants.

    Relations stand in the equations as they are written, ``if x > 0 then …``. Discrete variables are constants: they
    keep what they have at the start, or the values given.

    Parameters
    ----------
    values : (flat.count,) parameter values
    held : (flat.count,) values of all variables at one place of a run
    """
    if flat.events is None:
        return flat, values
    discrete = flat.events.discrete
    numbers = np.zeros(flat.count)
    for a in flat.starts:
        own = np.isin(a.target, discrete)
        if own.any():
            numbers[a.target[own]] = np.broadcast_to(a.values(values), a.target.shape)[own]
    if held is not None:
        numbers[discrete] = held[discrete]
    moved = set(discrete.tolist())
    blocks = tuple(replace(b, kind=Kind.CONSTANT) if b.size and b.offset in moved else b for b in flat.blocks)
    binding = Assignments(discrete, const(np.nan), np.zeros((len(discrete), 0), int), None, numbers[discrete])
    groups = flat.events.written
    result = replace(flat, blocks=blocks, groups=groups, bindings=(binding, *flat.bindings), events=None)
    known = values.copy()
    known[discrete] = numbers[discrete]
    return result, known
