"""The step of time stepping: its error is estimated by a run with steps twice as long, and it is halved if need be.

The scheme is of order one whatever happens within a step, so that the error of positions is about their difference from
those with steps twice as long (L. F. Richardson 1911). Velocities jump, and in two runs not at the same output time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.instant import Mask
from lmoc.numerics.laws.time_stepping import TimeStepping
from lmoc.numerics.problem.base import Outcome, Problem
from lmoc.support.records import dataclass

WANTED = 0.01  # share of their ranges to which positions shall be known
MOST_HALVINGS = 5
SMALL = 1e-6  # share of the largest range below which a component does not count by itself


@dataclass(frozen=True, eq=False)
class Stepped:
    """A run by steps of equal length.

    Attributes
    ----------
    steps : what has happened in them
    step : s
    error : of the positions, estimated, as a share of their ranges; NaN where it is not known
    """

    outcome: Outcome
    steps: TimeStepping
    step: float
    error: float


@dataclass(frozen=True, eq=False)
class _Path:
    outcome: Outcome
    steps: TimeStepping
    states: Array  # (output times and the end, n)


def stepped(problem: Problem, begin: Callable[[], TimeStepping], positions: Mask, fixed: bool) -> Stepped:
    """Run with steps of a length, or with shorter ones.

    Parameters
    ----------
    begin : returns what makes the steps, at the start
    positions : (n,) which components they are
    fixed : the length has been asked for
    """
    step = problem.step
    coarse = _path(problem, begin, 2 * step)
    for halvings in range(MOST_HALVINGS + 1):
        path = _path(problem, begin, step)
        error = _error(coarse, path, positions)
        if fixed or not error > WANTED or halvings == MOST_HALVINGS or path.outcome.status.failed:
            break
        coarse, step = path, step / 2
    problem.sink(0, path.states[: path.outcome.reached])
    return Stepped(path.outcome, path.steps, step, error)


def _path(problem: Problem, begin: Callable[[], TimeStepping], step: float) -> _Path:
    states = np.full((len(problem.times) + 1, len(problem.x)), np.nan)

    def sink(first: int, found: Array) -> None:
        states[first : first + len(found)] = found

    steps = begin()
    outcome = steps.march(replace(problem, step=step, sink=sink))
    states[-1] = outcome.x
    return _Path(outcome, steps, states)


def _error(coarse: _Path, fine: _Path, positions: Mask) -> float:
    """Return the largest difference of positions, as a share of the range that each has."""
    if coarse.outcome.status.failed or fine.outcome.status.failed or not positions.any():
        return float("nan")
    one, other = coarse.states[:, positions], fine.states[:, positions]
    extent = np.ptp(other, axis=0)
    extent = np.maximum(extent, SMALL * extent.max())
    difference = np.abs(one - other).max(axis=0)
    return float((difference[extent > 0.0] / extent[extent > 0.0]).max(initial=0.0))
