"""Functions that a jump of states sends back to the side of zero that they came from.

A ball that has just been turned at h = 0 has left ``h <= 0`` at once, without an event of its own. Where its hop is too
low to be told from none, the run ends: it would go on through the floor.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.chatter import SEEN, Crossings
from lmoc.numerics.events.discrete_state import DiscreteState, near_to
from lmoc.numerics.events.excursion import Excursions, excursions
from lmoc.numerics.events.trials import NOISES
from lmoc.numerics.problem.base import Outcome

_STOPPED = 1e-3  # of the speed with which a function has come to zero, below which a jump has stopped it


def turned_back(
    discrete: DiscreteState, crossings: Crossings, outcome: Outcome, x: np.ndarray, crossed: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Return the functions that leave zero at once, and note when they are back and by what their zeros are off.

    Parameters
    ----------
    outcome : of the segment that has ended where they crossed zero
    x : states behind the jump
    at : (zeros,) the functions where they crossed zero, before the jump

    Raises
    ------
    Stopped
        A hop is too low to be seen.
    """
    layout, t = discrete.layout, outcome.time
    discrete.push()
    discrete.look(t, x)
    near = crossed[~layout.rounded[crossed]]
    zero, off = discrete.zero[near], np.abs(at)
    near = near[(np.abs(zero) <= discrete.margin[near]) | (2.0 * np.abs(zero - at[near]) <= off[near])]
    if not len(near) or not t > crossings.before(near):
        return near[:0]
    ways = _ways(discrete, crossings, outcome, x, near)
    off = np.fmax(2.0 * off, np.abs(ways.slope) * near_to(t))
    up = discrete.v[layout.zero_target[near]] > 0.0
    away = near[(ways.slope[near] != 0.0) & ((ways.slope[near] > 0.0) != up)]
    seen = discrete.tells(t, x, ways.height / SEEN, off)[away]
    low, back = away[~seen], away[seen]
    if len(low) and _moves(discrete, crossings, outcome, x, ways, low).any():
        raise crossings.too_low(layout, low)
    if len(back):
        crossings.leave(t, back, ways)
        discrete.margin[back] = off[back]
    return back


def notice_wrong_ways(discrete: DiscreteState, crossings: Crossings, outcome: Outcome, crossed: np.ndarray) -> None:
    """Raise `Stopped` where a function that has just left zero seems to be back, and moves away from it."""
    early = crossings.back_too_early(outcome.time, crossed)
    if not len(early):
        return
    slope = _ways(discrete, crossings, outcome, outcome.x, early).slope[early]
    wrong = early[(slope > 0.0) == (discrete.v[discrete.layout.zero_target[early]] > 0.0)]
    if len(wrong):
        raise crossings.too_low(discrete.layout, wrong)


def _ways(
    discrete: DiscreteState, crossings: Crossings, outcome: Outcome, x: np.ndarray, zeros: np.ndarray
) -> Excursions:
    """Return the ways of the functions from states at the end of a segment, over a time for some of them."""
    discrete.push()
    short = crossings.short(outcome.time, zeros, outcome.step)
    return excursions(discrete.layout, discrete.base, discrete.signals, outcome.time, x, short)


def _moves(
    discrete: DiscreteState, crossings: Crossings, outcome: Outcome, x: np.ndarray, ways: Excursions, zeros: np.ndarray
) -> np.ndarray:
    """Return which functions move after a jump of states: by more than rounding, or as a part of their way before.

    What a jump has stopped does not, though rounding may leave it some speed.
    """
    short = crossings.short(outcome.time, zeros, outcome.step)
    noise = NOISES * discrete.rounding(outcome.time, x)[zeros] / short
    before = _ways(discrete, crossings, outcome, outcome.x, zeros)
    slope, past = (np.abs(w.slope[zeros]) for w in (ways, before))
    return (slope > noise) | (slope > _STOPPED * past)
