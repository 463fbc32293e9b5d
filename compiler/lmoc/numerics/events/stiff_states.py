"""States that go back by themselves where they are off: what they forget, and what they do not tell.

A stiff state follows what it is driven by more closely than a step is exact. So it is off by what a step may be off by,
and goes back in no time: a level that it has just crossed it seems to cross again, the more often the steps begin anew.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.layout import EventLayout

_STIFF = 1e4  # times that a stiff state goes back in a run
_WIDE = 10.0  # times what a step may be off by where it ends: what it may be on its way
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


def noise(
    layout: EventLayout, w: np.ndarray, t: float, rate: np.ndarray, errors: np.ndarray, span: float
) -> np.ndarray:
    """Return what steps leave open of the zero functions, (zeros,): by stiff states that stand where they are driven.

    Parameters
    ----------
    w : (layout.count,) registers with all that is given at a place
    rate : (states,) there
    errors : (states,) what the integrator has allowed itself in a step
    span : s, length of the run
    """
    if not 0 < len(rate) <= at_once(layout):
        return np.zeros(layout.zero_count)
    by, states = _WIDE * errors, layout.plan.states
    changes = layout.rounding.beside(w, t, states, by)
    back = going_back(layout, changes, np.arange(len(rate)), by)
    with np.errstate(invalid="ignore"):
        stiff = (back * span > _STIFF) & (np.abs(rate) <= back * by)
    zeros = changes[:, stiff, layout.plan.count :]
    return np.nan_to_num(np.abs(zeros).max(axis=0, initial=0.0).sum(axis=0), nan=0.0, posinf=0.0)
