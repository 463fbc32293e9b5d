"""The instants of a run at which something happens, kept so that they can be repeated with other values."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
from lmoc.numerics.events.memory import Memory
from lmoc.numerics.problem.base import Outcome
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Behind:
    """What an instant has led to.

    Attributes
    ----------
    x, base : (n,), (registers,) the states, and what does not change until the next one
    told : names and kinds of events
    mode : of the laws
    """

    x: np.ndarray
    base: np.ndarray
    told: tuple[tuple[str, str], ...]
    mode: bytes

    def is_like(self, other: Behind) -> bool:
        """Return whether the same has happened."""
        return self.mode == other.mode and self.told == other.told


START = -1  # in place of the index of a segment: before the first one, the laws take their modes


@dataclass(frozen=True, eq=False)
class Occasion:
    """An instant at which a segment has ended.

    Attributes
    ----------
    segment : its index; START where the laws take their modes
    dynamics : events and laws of the run
    memory : what they knew before
    outcome : of the segment, with all that ends it
    errors, unresolved : as of `HybridDynamics.after`
    behind : None at the end of the run
    """

    segment: int
    dynamics: HybridDynamics
    memory: Memory
    outcome: Outcome
    errors: np.ndarray | float
    unresolved: np.ndarray | float
    behind: Behind | None = None


def behind(dynamics: HybridDynamics, x: np.ndarray, first: int) -> Behind:
    """Return what an instant has led to; `first` is the number of events recorded before it."""
    mode = dynamics.mode
    told = tuple((e.name, e.kind) for e in dynamics.records[first:])
    return Behind(x, dynamics.base(), told, b"" if mode is None else mode.key)


def at_start(dynamics: HybridDynamics, time: float, memory: Memory, before: np.ndarray, x: np.ndarray) -> Occasion:
    """Return the instant at which the laws take their modes; `before`, `x`: the states then, and behind it."""
    return Occasion(START, dynamics, memory, Outcome(time, before, 0), 0.0, 0.0, behind(dynamics, x, 0))
