"""Derivatives of the discrete values with which a motion begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.numerics.events.layout import initial_values
from lmoc.numerics.events.occasion import Occasion
from lmoc.numerics.observe.trajectory import Trajectory
from lmoc.numerics.run.sensitivities import STEP, Direction, slopes


def discrete_slopes(
    trajectory: Trajectory, directions: Sequence[Direction], occasions: Sequence[Occasion]
) -> np.ndarray | None:
    """Return derivatives (m, discrete); None where the values do not follow from start values alone.

    Whole numbers do not change with a parameter, and what holds ``pre(x)`` of a continuous variable is given its value
    at each event before anything reads it. Equations of the start, ``initial()`` and equations that hold outside of a
    ``when`` are looked for by what they make of other start values: they would change these.
    """
    flat, observer = trajectory.flat, trajectory.segments[0].observer
    events = flat.events
    if events is None:
        return np.zeros((len(directions), 0))
    now, past = events.before
    real = np.zeros(flat.count, bool)
    for block in flat.blocks:
        real[block.offset : block.offset + block.size] = block.kind == Kind.DISCRETE and block.quantity == "Real"
    real[past[~np.isin(now, events.discrete)]] = False
    own, held = real[events.discrete], observer.base[observer.plan.reduced.register_of[events.discrete]]
    if not own.any():
        return np.zeros((len(directions), len(events.discrete)))
    values = observer.values
    if events.start or not occasions:
        return None
    if (initial_values(flat, values)[events.discrete] != held)[own].any():
        return None
    state = occasions[-1].dynamics.handler.discrete
    for direction in directions:
        for change in (-STEP * direction.size, STEP * direction.size):
            begun = initial_values(flat, values + change * direction.rates if direction.is_parameter else values)
            begun[events.discrete] = np.where(own, begun[events.discrete] + change, held)
            for first in (0.0, 1.0) if events.initial >= 0 else (0.0,):
                begun[events.initial] = first if events.initial >= 0 else begun[events.initial]
                if (state.assigned(begun) != begun[events.discrete])[own].any():
                    return None
    found = slopes(lambda v: initial_values(flat, v)[events.discrete], directions)
    return np.where(own, found, 0.0)
