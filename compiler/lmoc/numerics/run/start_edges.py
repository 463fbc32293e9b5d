"""Starts at which a mode or a condition is on its edge, of friction that sticks there and slips beside it, or
``floor(x)`` at 0: there are no derivatives, unless what the condition decides goes on there without a jump."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.events.closeness import near_to
from lmoc.numerics.events.occasion import START, Occasion
from lmoc.numerics.problem.status import Stopped
from lmoc.numerics.run.sensitivities import Direction, Tangent, refused
from lmoc.numerics.run.surroundings import LITTLE, OVER_EVENTS, Surroundings

_SHARE = (5**0.5 - 1) / 2  # by which quantities are changed less and less: two do not make up for each other
_CLOSER = 8.0  # times as near to an edge, where it is looked at once more
_JUMP = 1e-6  # share of what jumps, that counts
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
    occasion = _start_of(occasions)
    if occasion is None or occasion.memory.laws is None:
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


def _start_of(occasions: Sequence[Occasion]) -> Occasion | None:
    return next((own for own in occasions if own.segment == START), None)


def conditions_on_edge(
    occasions: Sequence[Occasion], directions: Sequence[Direction], first: Tangent
) -> list[tuple[int, bool]]:
    """Return the quantities that decide about a condition on its edge at the start, and whether time does, too.

    Where nothing is known of the start, as where it has been stepped to, there are none.
    """
    occasion = _start_of(occasions)
    if occasion is None or occasion.dynamics.handler is None:
        return []
    around, t = Surroundings(occasion, directions, np.ones(len(first.x)), first.time), first.time
    soon, found = OVER_EVENTS * (occasion.dynamics.span[1] - t), []

    def look(change: np.ndarray, later: float = 0.0) -> tuple[np.ndarray, float]:
        """Return functions of events, and when the first event of time is."""
        around.recall(change, first.base)
        heights = around.dynamics.heights()(np.array([t + later]), (first.x + change @ first.by)[None])[0]
        return heights, around.dynamics.handler.discrete.next_time(t - soon)

    none = np.zeros(len(directions))
    at, due = look(none)
    by_time = look(none, soon)[0] != look(none, -soon)[0]
    for k, direction in enumerate(directions):
        step = OVER_EVENTS * direction.size
        (low, early), (high, late) = (look(around.change(k, sign * step)) for sign in (-1, 1))
        near = np.abs(at) < LITTLE * direction.size * np.abs(high - low) / (2 * step)
        rings = due <= t + near_to(t) and early != late
        if near.any() or rings:
            found.append((k, rings or bool((near & by_time).any())))
    return found


def refuse_jump(name: str, values: Callable[[float], np.ndarray], size: float) -> None:
    """Refuse a start beside which what a condition decides jumps.

    Parameters
    ----------
    values : states and rates at the start with a quantity changed
    size : of that quantity

    Raises
    ------
    ModelError
        E0575: it does.
    """
    middle, sides = values(0.0), {}
    for step in (LITTLE * size, LITTLE * size / _CLOSER):
        low, high = values(-step), values(step)
        sides[step] = low + high - 2 * middle
    coarse, fine = sides.values()
    jump = np.abs(_CLOSER * fine - coarse) / (_CLOSER - 1)  # where there is a kink alone, both shrink with the step
    if (jump > _JUMP * np.max(np.abs([low, middle, high]), axis=0)).any():
        raise on_edge(name)


def on_edge(name: str) -> ModelError:
    """Return the error that says that a condition is on its edge at the start."""
    return refused(
        f"with another value of '{name}' the start is on the other side of a condition: it is on its edge",
        "a start a little larger or smaller has a derivative",
    )
