"""The states with which a run begins, from what is asked of its start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.coordinates.change import RunState, continued
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import End
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.start.initialization import initial_state, seed_blocks, start_guess
from lmoc.numerics.start.targets import targets


def first_states(
    observer: Observer,
    time: float,
    base: np.ndarray,
    initial: Mapping[str, float] | End | RunState,
    report: Report,
    impacts: list[Event],
    near: RunState | None = None,
) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function of base registers that gives the states (n,).

    Parameters
    ----------
    time : s
    base : registers of the segment, in which the unknowns of nonlinear blocks get their first guess
    initial : {name: value}, fixed at the start, or where another run has ended, or where one begins
    impacts : takes records of velocities that contradict each other at the start
    near : another place, of a model with the same variables, at which the start is looked for

    Raises
    ------
    ModelError
        The values asked for are wrong; what has no solution is reported by the function returned.
    """
    plan, values, signals = observer.plan, observer.values, observer.signals
    if isinstance(initial, RunState):
        return partial(initial.states, plan)
    if isinstance(initial, End):
        return partial(continued, plan, initial)
    wanted = targets(plan, values, initial, report)
    report.check()
    guess = start_guess(plan, values, wanted)
    if guess is not None and guess.failures:
        report.diagnostics += guess.failures
        report.check()
    seed_blocks(plan, base, wanted, guess)
    first = None if near is None else _seeded(near, plan, base)
    return lambda now: initial_state(plan, now, signals, values, time, wanted, guess, report, impacts, first)


def _seeded(near: RunState, plan: Plan, base: np.ndarray) -> np.ndarray:
    """Return the states (n,) of another place, zero where it has none, and let nonlinear blocks begin there."""
    before = base.copy()
    states = near.states(plan, base)
    lost = ~np.isfinite(base)
    base[lost] = before[lost]
    return np.nan_to_num(states, nan=0.0)
