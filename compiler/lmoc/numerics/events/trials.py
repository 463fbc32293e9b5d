"""Values of relations that suit better than those that solving in turn leads to; tried in C (``engine/c/trials.c``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from lmoc.engine.instant import Instant
from lmoc.numerics.events.layout import EventLayout
from lmoc.support.records import dataclass

_NOISES = 4.0  # times the bound for its rounding, within which a function is zero
_TRIALS = 200  # combinations of values of relations that are tried
_SURE = 1e6  # times such a bound, beyond which a function is not zero, whichever values are tried
_FEW = 3  # relations that are changed at once among all


@dataclass
class Trial:
    """Relations whose values are tried: their functions, which must be more than zero, and whether bounds are known.

    Bounds are those of the first combination as long as a function denies its relation by far: they cost twenty times
    what the combination does (HeatLosses of Modelica's library: an event of 8 s of 200 combinations).
    """

    zeros: np.ndarray
    strict: np.ndarray
    bounded: bool = False


class Discrete(Protocol):
    """What is tried on: `discrete_state.DiscreteState`."""

    instant: Instant
    layout: EventLayout
    v: np.ndarray
    zero: np.ndarray
    margin: np.ndarray
    base: np.ndarray
    trial: Trial | None

    def push(self) -> None: ...
    def look(self, t: float, x: np.ndarray) -> None: ...
    def registers(self, t: float, x: np.ndarray) -> np.ndarray: ...
    def rounding(self, t: float, x: np.ndarray) -> np.ndarray: ...


def prefer_regular(discrete: Discrete, t: float, x: np.ndarray) -> bool:
    """Where a block is singular with the values found, take others with which it is not, if there are any.

    Of two frictions that hold one shaft, one slides without moving, and the other one takes what is left of the load.
    Several values may do: those are taken that change the fewest relations from before the event, among them those
    of the friction that half of the load is too much for. Returns that there are values.
    """
    layout = discrete.layout
    unclear = layout.switching.undetermined_by(discrete.registers(t, x), t)
    key = layout.switching.key(discrete.base)
    if not len(unclear) or key in layout.switching.tried:
        return True
    found, zero = discrete.v.copy(), discrete.zero.copy()
    changed = np.zeros(len(layout.events.discrete), bool)
    changed[unclear] = True
    zeros = discrete.instant.read_by(changed)
    own = layout.switching.shared(discrete.registers(t, x), t)[layout.plan.count + zeros]
    over = _asked(discrete, zeros, own) != (found[layout.zero_target[zeros]] > 0)
    order = np.lexsort((np.where(over, -np.abs(own), np.abs(own)), ~over))
    begun, most = discrete.instant.begun(), (_FEW, _TRIALS)
    if _tried(discrete, x, begun, zeros[order], most, lambda now, at: _is_regular(discrete, now, at)):
        return True
    layout.switching.tried.add(key)
    discrete.v[:], discrete.zero[:] = found, zero
    discrete.push()
    discrete.look(t, x)
    return True


def leave_fold(discrete: Discrete, t: float, x: np.ndarray, returning: np.ndarray) -> bool:
    """Take other values of relations where those of both sides lead back to the same zero, if there are any.

    An amplifier that feeds its output back leaves a limit where both its pieces end: neither goes on from there, the
    other limit does. No function may be zero there, which would end at once, too.

    Parameters
    ----------
    returning : zero functions that cross zero again at the instant of their last crossing
    """
    zeros = discrete.layout.solved_with(returning[~discrete.layout.rounded[returning]])
    begun = discrete.v.copy()
    most = len(zeros), _TRIALS
    before = begun[discrete.layout.events.discrete]
    if len(zeros) and _tried(discrete, x, before, zeros, most, lambda now, at: _is_clear(discrete, now, at, zeros)):
        return True
    discrete.v[:] = begun
    discrete.push()
    discrete.look(t, x)
    return False


def surely_off(discrete: Discrete, trial: Trial) -> bool:
    """Return whether a function denies the value that is tried by far more than what rounding could be."""
    value, bound = discrete.zero[trial.zeros], discrete.instant.bound[trial.zeros]
    denied = np.where(trial.strict, value > 0, value >= 0) != (discrete.v[discrete.layout.zero_target[trial.zeros]] > 0)
    far = (bound > 0) & (np.abs(value) > np.fmax(discrete.margin[trial.zeros], _SURE * bound))
    known, trial.bounded = trial.bounded, True
    return known and bool((denied & far).any())


def _tried(
    discrete: Discrete,
    x: np.ndarray,
    begun: np.ndarray,
    zeros: np.ndarray,
    most: tuple[int, int],
    accept: Callable[[float, np.ndarray], bool],
) -> bool:
    """As `Instant.tried`, with bounds for rounding where they may decide."""
    discrete.trial = Trial(zeros, _strict(discrete, zeros))
    try:
        return discrete.instant.tried(x, begun, zeros, most, accept)
    finally:
        discrete.trial = None


def _is_regular(discrete: Discrete, t: float, x: np.ndarray) -> bool:
    return not len(discrete.layout.switching.undetermined_by(discrete.registers(t, x), t))


def _is_clear(discrete: Discrete, t: float, x: np.ndarray, zeros: np.ndarray) -> bool:
    """Return whether functions are off zero by more than rounding."""
    rounding = np.fmax(discrete.margin, _NOISES * discrete.rounding(t, x))
    return bool((np.abs(discrete.zero) > rounding)[zeros].all())


def _asked(discrete: Discrete, zeros: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the values of relations by those of their functions."""
    return np.where(_strict(discrete, zeros), value > 0, value >= 0)


def _strict(discrete: Discrete, zeros: np.ndarray) -> np.ndarray:
    """Return of which functions the relation is "more than zero", not "zero or more"."""
    return np.array([discrete.layout.relation_at(k).op == "gt" for k in zeros.tolist()], bool)
