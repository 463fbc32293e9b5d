"""Starts at which a mode is on its edge: friction that sticks there, and slips beside it. There are no derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmoc.numerics.events.occasion import START, Occasion
from lmoc.numerics.problem.status import Stopped
from lmoc.numerics.run.sensitivities import Direction, Tangent, refused
from lmoc.numerics.run.surroundings import Surroundings

_SHARE = (5**0.5 - 1) / 2  # by which quantities are changed less and less: two do not make up for each other
Same = Callable[[np.ndarray], bool | None]  # (m,) changes of the quantities -> whether the modes are the same


def check_edges(directions: Sequence[Direction], same: Same, share: float) -> None:
    """Refuse a start at which a mode is on its edge.

    All quantities are changed at once, by shares that have no ratio at which two would make up for each other; one by
    one where another mode comes of that, or nothing does: a value may stand at its bound.

    Parameters
    ----------
    same : None where there is no start
    share : of a quantity's size, by which it is changed
    """
    sizes = share * np.array([d.size for d in directions])
    shares = _SHARE ** np.arange(len(directions))
    for sign in (1.0, -1.0):
        if len(directions) > 1 and same(sign * shares * sizes):
            continue
        for direction, own in zip(directions, np.diag(sign * sizes), strict=True):
            if same(own) is False:
                name = direction.name
                raise refused(f"with another value of '{name}' the start has another mode: it is on its edge")


def modes_at_start(occasions: Sequence[Occasion], directions: Sequence[Direction], first: Tangent) -> Same | None:
    """Return what finds the modes of the start anew with other values, without starting anew; None where it cannot.

    Parameters
    ----------
    first : where the run starts, where nothing happens but that the laws take their modes
    """
    occasion = next((own for own in occasions if own.segment == START), None)
    if occasion is None or occasion.behind is None:
        return None
    around = Surroundings(occasion, directions, np.ones(len(first.x)), first.time)

    def mode(change: np.ndarray) -> bytes | None:
        around.recall(change, first.base)
        dynamics = around.dynamics
        try:
            dynamics.laws.start(first.time, occasion.outcome.x + change @ first.by)
        except Stopped:
            return None
        return dynamics.mode.key

    taken = occasion.behind.mode
    if mode(np.zeros(len(directions))) != taken:
        return None

    def same(change: np.ndarray) -> bool | None:
        own = mode(change)
        return None if own is None else own == taken

    return same

