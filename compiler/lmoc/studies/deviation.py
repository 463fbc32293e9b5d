"""The distance between two runs: the largest deviation of their signals, relative to the size of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmoc.numerics.observe.event import Event
from lmoc.run import Run
from lmoc.support.records import dataclass

_LEAST_MARGIN = 1e-12  # of the span, about an instant at which two runs have the same event


@dataclass(frozen=True, eq=False, repr=False)
class Signals:
    """The signals by which runs are compared.

    Attributes
    ----------
    names : of the declared outputs, else of the states
    time : (k,) s
    values : (k, m)
    events : of the run
    """

    names: tuple[str, ...]
    time: np.ndarray
    values: np.ndarray
    events: tuple[Event, ...]

    @property
    def sizes(self) -> np.ndarray:
        """(m,) the largest magnitude of each signal; where it is zero throughout, infinity: nothing to compare with."""
        largest = np.abs(self.values).max(axis=0)
        return np.where(largest > 0, largest, np.inf)

    def only(self, names: Sequence[str]) -> Signals:
        """Return some of them."""
        columns = [self.names.index(name) for name in names]
        return replace(self, names=tuple(names), values=self.values[:, columns])


@dataclass(frozen=True)
class Deviation:
    """The difference of two runs, relative to the sizes of the signals.

    Attributes
    ----------
    largest, end : over the output times, and at the last one; of the worst signal
    note : what has been left out, if anything
    """

    largest: float
    end: float
    note: str = ""


def signals_of(run: Run, names: Sequence[str]) -> Signals:
    """Return the signals of a run by their names."""
    values = np.stack([run[name] for name in names], axis=1) if names else np.zeros((len(run.time), 0))
    return Signals(tuple(names), run.time, values, run.events)


def compared_names(run: Run) -> tuple[str, ...]:
    """Return what runs of a scene are compared by: the declared outputs, else the states."""
    return tuple(run.outputs or run.states)


def deviation(signals: Signals, reference: Signals) -> Deviation:
    """Return how far signals are from the reference, at the same output times.

    Where a velocity jumps at an impact that comes slightly too early or too late, it is wrong by the whole jump for
    that short time. An output time between the two instants says nothing of the accuracy, and is left out.
    """
    apart, note = _apart(signals, reference)
    if not apart.size:
        return Deviation(0.0, 0.0, note)
    return Deviation(float(apart.max()), float(apart[-1].max()), note)


def deviations(signals: Signals, reference: Signals) -> dict[str, float]:
    """Return the same of each signal."""
    apart, _ = _apart(signals, reference)
    return dict(zip(reference.names, apart.max(axis=0, initial=0.0).tolist(), strict=True))


def _apart(signals: Signals, reference: Signals) -> tuple[np.ndarray, str]:
    """Return the relative differences at the output times that count, and a note of odd events."""
    beside, note = _between_events(signals, reference)
    return (np.abs(signals.values - reference.values) / reference.sizes)[~beside], note


def _between_events(signals: Signals, reference: Signals) -> tuple[np.ndarray, str]:
    """Return the mask of output times between the instants of the same event in two runs, and a note of odd events."""
    ours, theirs = (np.array([e.time for e in s.events]) for s in (signals, reference))
    time = reference.time
    beside = np.zeros(len(time), bool)
    if len(ours) != len(theirs):
        return beside, f"{len(ours)} events, and {len(theirs)} in the reference"
    margin = _LEAST_MARGIN * (time[-1] - time[0])
    for low, high in zip(np.minimum(ours, theirs) - margin, np.maximum(ours, theirs) + margin, strict=True):
        beside[np.searchsorted(time, low) : np.searchsorted(time, high, "right")] = True
    return beside, ""
