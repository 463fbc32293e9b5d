"""Recording of the states that an integrator hands over."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.numerics.limits import LOCATED, NUMBERS
from lmoc.numerics.observe.observer import Observer, find
from lmoc.support.distinct import distinct

_SAMPLES = 25, 200  # least and most output times whose states are kept, with `NUMBERS` between
_LEDGER = ("ledger.stored", "ledger.work", "ledger.heat")


class Recorder:
    """Takes the states at output times: keeps them, or only the requested variables.

    Attributes
    ----------
    times : (k,) output times to come
    reached : number of them taken so far
    table : (k, n) what is kept
    """

    def __init__(self, observer: Observer, times: np.ndarray, variables: np.ndarray | None) -> None:
        """
        Parameters
        ----------
        variables : of the flat model, to be kept; None for the states
        """
        self.times = times
        self.reached = 0
        self._evaluate = None if variables is None else observer.prepare(variables)
        self._states = n = len(observer.plan.states)
        # the pages of an array that is never written to cost nothing
        self.table = np.empty((len(times), n if variables is None else len(variables)))
        self._sampled = None if variables is None else np.empty((len(self._samples), n))

    @cached_property
    def _samples(self) -> np.ndarray:
        return sampled_places(len(self.times), self._states)

    def __call__(self, first: int, states: np.ndarray) -> None:
        last = first + len(states)
        self.table[first:last] = self.kept(self.times[first:last], states)
        if self._sampled is not None:
            a, b = np.searchsorted(self._samples, (first, last))
            self._sampled[a:b] = states[self._samples[a:b] - first]
        self.reached = max(self.reached, last)

    def kept(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return what is kept of some states."""
        return states if self._evaluate is None else self._evaluate(times, states)

    def record_start(self, time: float, x: np.ndarray) -> None:
        """Keep the state where a segment begins, if that is the first output time."""
        if len(self.times) and _is_same(self.times[0], time):
            self(0, x[None])

    def take_back(self, time: float) -> None:
        """Forget the last output time, if it is that of an event: there the next segment has the value after it."""
        if self.reached and _is_same(self.times[self.reached - 1], time):
            self.reached -= 1

    def forget_after(self, time: float) -> None:
        """Forget all output times later than this one."""
        self.reached = min(self.reached, int(np.searchsorted(self.times, time, "right")))

    def taken(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the output times so far, and what is kept of them."""
        whole = self.reached == len(self.times)
        table = self.table if whole else self.table[: self.reached].copy()  # the rest can be forgotten
        return self.times[: self.reached], table

    def sampled(self) -> tuple[np.ndarray, np.ndarray]:
        """Return some output times (s,), evenly spread, and the states there (s, n)."""
        if not self.reached:  # as from bounce to bounce
            return self.times[:0], np.empty((0, self._states))
        own = self._samples[self._samples < self.reached]
        return self.times[own], self.table[own] if self._sampled is None else self._sampled[: len(own)]


def sampled_places(count: int, n: int) -> np.ndarray:
    """Return which of so many output times are samples of a run with n states."""
    most = min(max(NUMBERS // max(1, n), _SAMPLES[0]), _SAMPLES[1])
    every = np.arange(0, count - 1, max(1, -(-count // most)))
    return np.append(every, count - 1) if count else every


def kept_variables(flat: FlatDAE, keep: Sequence[str], energy: bool) -> np.ndarray:
    """Return the variables of these names, those in motion that the model's assertions look at, and the ledger's.

    Parameters
    ----------
    energy : whether the energy ledger is kept, where the model has one
    """
    if energy and all(flat.find(name) is not None for name in _LEDGER):
        keep = (*keep, *_LEDGER)
    judged = [own[flat.kind[own] >= Kind.INPUT] for own in (check.slots.ravel() for check in flat.checks)]
    return distinct(np.concatenate([*(find(flat, name) for name in keep), *judged, np.zeros(0, int)]))


def is_kept(flat: FlatDAE, name: str, keep: Sequence[str]) -> bool:
    """Return whether a variable of the model can be read from a run that keeps these."""
    variables = find(flat, name)
    kept = kept_variables(flat, [known for known in keep if flat.find(known) is not None], energy=True)
    return bool(((flat.kind[variables] < Kind.INPUT) | np.isin(variables, kept)).all())


def _is_same(time: float, event: float) -> bool:
    """Return whether an output time is that of an event."""
    return 0 <= event - time <= LOCATED * abs(event)
