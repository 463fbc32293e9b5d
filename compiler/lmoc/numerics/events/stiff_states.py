"""States that go back by themselves where they are off: what they forget (and hide: ``engine/c/stiff_states.c``)."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.layout import EventLayout

_NUMBERS = 1_000_000  # registers that may be looked at at once


def at_once(layout: EventLayout) -> int:
    """Return how many states may be moved at once, each alone."""
    return _NUMBERS // max(1, layout.count)


def going_back(layout: EventLayout, changes: np.ndarray, which: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return how fast some states go back, 1/s; negative where they go away.

    Parameters
    ----------
    changes : (2, states, registers) as of `Rounding.beside`
    which, by : the states, and how far each has been moved
    """
    of_rates = changes[:, np.arange(len(which)), layout.plan.derivatives[which]]
    with np.errstate(all="ignore"):
        back: np.ndarray = -np.max(of_rates / (np.array([[1.0], [-1.0]]) * by), axis=0)
    return back
