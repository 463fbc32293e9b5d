"""Values of relations that are tried at an event, where solving in turn leads to none, or to a singular block."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, combinations, islice
from typing import Protocol

import numpy as np

from lmoc.numerics.events.layout import EventLayout

NOISES = 4.0  # times the bound for its rounding, within which a function is zero
_TRIALS = 1024  # combinations of values of relations that are tried: all those of ten
_TRIALS_SUITED = 200  # where there are values already, with a singular block or at a fold
_FEW = 3  # relations that are changed at once among all
_SETTLING = 20  # rounds in which the values behind a combination agree, or do not


class Discrete(Protocol):
    """What is tried on: `discrete_state.DiscreteState`."""

    layout: EventLayout
    v: np.ndarray
    zero: np.ndarray
    margin: np.ndarray
    base: np.ndarray

    def push(self) -> None: ...
    def look(self, t: float, x: np.ndarray) -> None: ...
    def turn_once(self, t: float, x: np.ndarray) -> np.ndarray: ...
    def registers(self, t: float, x: np.ndarray) -> np.ndarray: ...
    def supposing(self, targets: np.ndarray | None) -> None: ...
    def rounding(self, t: float, x: np.ndarray) -> np.ndarray: ...


def try_relations(discrete: Discrete, t: float, x: np.ndarray, begun: np.ndarray, flipped: np.ndarray) -> bool:
    """Find values of relations with which all equations hold, those with the fewest changes first.

    Tried are those that flip, in all combinations; then a few of all those in the equations of what has changed,
    since one that does not flip may be what keeps the others from agreeing.

    Parameters
    ----------
    begun : (flat.count,) values before
    flipped : (flat.count,) mask of what has changed
    """
    own = np.flatnonzero(~discrete.layout.rounded)
    flips = own[flipped[discrete.layout.zero_target[own]]]
    if _try(discrete, t, x, begun, flips, len(flips)):
        return True
    return _try(discrete, t, x, begun, _read_by(discrete, flipped), _FEW)


def prefer_regular(discrete: Discrete, t: float, x: np.ndarray, begun: np.ndarray) -> bool:
    """Where a block is singular with the values found, take others with which it is not, if there are any.

    Of two frictions that hold one shaft, one slides without moving, and the other one takes what is left of the load:
    the one that half of it is too much for. Returns that there are values.
    """
    layout = discrete.layout
    unclear = layout.switching.undetermined_by(discrete.registers(t, x), t)
    key = layout.switching.key(discrete.base)
    if not len(unclear) or key in layout.switching.tried:
        return True
    found, zero = discrete.v.copy(), discrete.zero.copy()
    read = np.zeros(len(discrete.v), bool)
    read[layout.events.discrete[unclear]] = True
    zeros = _read_by(discrete, read)
    own = layout.switching.shared(discrete.registers(t, x), t)[layout.plan.count + zeros]
    over = _asked(discrete, zeros, own) != (found[layout.zero_target[zeros]] > 0)
    order = np.lexsort((np.where(over, -np.abs(own), np.abs(own)), ~over))
    if _try(discrete, t, x, found, zeros[order], _FEW, lambda: _is_regular(discrete, t, x)):
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
    if len(zeros) and _try(discrete, t, x, begun, zeros, len(zeros), lambda: _is_clear(discrete, t, x, zeros)):
        return True
    discrete.v[:] = begun
    discrete.push()
    discrete.look(t, x)
    return False


def _is_regular(discrete: Discrete, t: float, x: np.ndarray) -> bool:
    return not len(discrete.layout.switching.undetermined_by(discrete.registers(t, x), t))


def _is_clear(discrete: Discrete, t: float, x: np.ndarray, zeros: np.ndarray) -> bool:
    """Return whether functions are off zero by more than rounding."""
    rounding = np.fmax(discrete.margin, NOISES * discrete.rounding(t, x))
    return bool((np.abs(discrete.zero) > rounding)[zeros].all())


def _read_by(discrete: Discrete, changed: np.ndarray) -> np.ndarray:
    """Return the zero functions of the relations in the discrete equations of what has changed."""
    own = np.flatnonzero(~discrete.layout.rounded)
    read = np.zeros(len(discrete.v), bool)
    for step in discrete.layout.plan.reduced.discrete:
        if step.relation < 0:
            read[step.slots[changed[step.target]]] = True
    return own[read[discrete.layout.zero_target[own]]]


def _try(
    discrete: Discrete,
    t: float,
    x: np.ndarray,
    begun: np.ndarray,
    zeros: np.ndarray,
    most: int,
    suits: Callable[[], bool] | None = None,
) -> bool:
    """Try values of relations, with at most so many of them changed; `suits` has the last word."""
    targets = discrete.layout.zero_target[zeros]
    discrete.supposing(targets)
    changes = chain.from_iterable(combinations(range(len(zeros)), k) for k in range(most + 1))
    try:
        for change in islice(changes, _TRIALS if suits is None else _TRIALS_SUITED):
            discrete.v[:] = begun
            others = targets[list(change)]
            discrete.v[others] = 1.0 - discrete.v[others]
            if not _settles(discrete, t, x) or not _agrees(discrete, t, x, zeros, targets):
                continue
            if suits is None or suits():
                return True
    finally:
        discrete.supposing(None)
    return False


def _settles(discrete: Discrete, t: float, x: np.ndarray) -> bool:
    """Return whether the other values agree with those that are being tried, and take them."""
    return any(not discrete.turn_once(t, x).any() for _ in range(_SETTLING))


def _agrees(discrete: Discrete, t: float, x: np.ndarray, zeros: np.ndarray, targets: np.ndarray) -> bool:
    """Return whether relations have the values that are being tried; where both sides are equal, either will do.

    A friction that holds no more than its limit slides and does not move: two of them on one shaft at rest.
    """
    value = discrete.zero[zeros]
    wrong = _asked(discrete, zeros, value) != (discrete.v[targets] > 0)
    if not wrong.any():
        return True
    rounding = np.fmax(discrete.margin, NOISES * discrete.rounding(t, x))[zeros]
    if (np.abs(value) > rounding)[wrong].any():
        return False
    discrete.margin[zeros[wrong]] = rounding[wrong]  # it stays as it has been taken, also where it is exactly zero
    return True


def _asked(discrete: Discrete, zeros: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the values of relations by those of their functions."""
    ops = np.array([discrete.layout.relation_at(k).op for k in zeros.tolist()])
    return np.where(ops == "gt", value > 0, value >= 0)
