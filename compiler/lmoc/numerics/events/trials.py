"""Values of relations that suit better than those that solving in turn leads to; tried in C (``engine/c/trials.c``)."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lmoc.engine.instant import Instant
from lmoc.numerics.events.layout import EventLayout

_NOISES = 4.0  # times the bound for its rounding, within which a function is zero
_TRIALS = 200  # combinations of values of relations that are tried
_FEW = 3  # relations that are changed at once among all


class Discrete(Protocol):
    """What is tried on: `discrete_state.DiscreteState`."""

    instant: Instant
    layout: EventLayout
    v: np.ndarray
    zero: np.ndarray
    margin: np.ndarray
    base: np.ndarray

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
    if discrete.instant.tried(
        x, discrete.instant.begun(), zeros[order], (_FEW, _TRIALS), lambda now, at: _is_regular(discrete, now, at)
    ):
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
    if len(zeros) and discrete.instant.tried(
        x, begun[discrete.layout.events.discrete], zeros, most, lambda now, at: _is_clear(discrete, now, at, zeros)
    ):
        return True
    discrete.v[:] = begun
    discrete.push()
    discrete.look(t, x)
    return False


def _is_regular(discrete: Discrete, t: float, x: np.ndarray) -> bool:
    return not len(discrete.layout.switching.undetermined_by(discrete.registers(t, x), t))


def _is_clear(discrete: Discrete, t: float, x: np.ndarray, zeros: np.ndarray) -> bool:
    """Return whether functions are off zero by more than rounding."""
    rounding = np.fmax(discrete.margin, _NOISES * discrete.rounding(t, x))
    return bool((np.abs(discrete.zero) > rounding)[zeros].all())


def _asked(discrete: Discrete, zeros: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the values of relations by those of their functions."""
    ops = np.array([discrete.layout.relation_at(k).op for k in zeros.tolist()])
    return np.where(ops == "gt", value > 0, value >= 0)
