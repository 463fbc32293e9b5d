"""The trajectory: states over time, and every variable of the flat model when somebody asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import Diagnostic, nearest
from lmoc.numerics.observe.energy import Energy, measure
from lmoc.numerics.observe.slices import signal_values, slice_of
from lmoc.numerics.plan import LEDGER, Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.support.distinct import distinct

_CACHED = 2_000_000  # numbers of the largest result that is kept
_SAMPLES = 25, 200  # least and most output times whose states are kept in any case …
_SAMPLED = 2_000_000  # … and numbers in them, where that allows more than the least


@dataclass(frozen=True, eq=False, repr=False)
class Observer:
    """What is needed to compute variables from states: the plan, and the parameter values and signals of the run."""

    plan: Plan
    values: np.ndarray
    base: np.ndarray
    signals: Mapping[int, Signal]

    @property
    def flat(self) -> FlatDAE:
        return self.plan.reduced.flat

    def __call__(self, variables: np.ndarray, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Values of variables of the flat model, (times, variables); NaN for what the model leaves open."""
        return self.prepare(variables)(times, states)

    def prepare(self, variables: np.ndarray):
        """``(times, states) -> (times, variables)`` for repeated use."""
        reduced, flat = self.plan.reduced, self.flat
        variables = np.asarray(variables, int)
        kinds = flat.kind[variables]
        constant = (kinds == Kind.PARAMETER) | (kinds == Kind.CONSTANT)
        inputs = np.flatnonzero(kinds == Kind.INPUT)
        registers = reduced.register_of[variables]
        computed = np.flatnonzero(~constant & (kinds != Kind.INPUT) & (registers >= 0))
        # what is not determined stays NaN, whatever one of its possible values the solution has taken
        computed = computed[~np.isin(variables[computed], reduced.undetermined)]
        part = slice_of(self.plan, registers[computed]).bind(self.base, self.signals)

        def values(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            result = np.full((len(times), len(variables)), np.nan)
            result[:, constant] = self.values[variables[constant]]
            for k in inputs:
                signal = self.signals.get(int(variables[k]))
                if signal is not None:
                    result[:, k] = signal_values(signal, times, self.values)
            if len(computed):
                result[:, computed] = part(times, states)
            return result

        return values


class Recorder:
    """Takes the states at the output times from an integrator: keeps them, or only the variables asked for.

    Attributes
    ----------
    reached : number of output times taken so far
    table : (times, n) what is kept
    variables : those in the columns of the table, None where they are the states
    samples : some output times, evenly spread, whose states are at hand in any case
    """

    def __init__(self, observer: Observer, times: np.ndarray, keep: tuple[str, ...] | None) -> None:
        self.observer = observer
        self.times = times
        self.reached = 0
        self.variables = None if keep is None else _retained(observer.flat, keep)
        self._evaluate = None if keep is None else observer.prepare(self.variables)
        width = len(observer.plan.states) if keep is None else len(self.variables)
        self.table = np.empty((len(times), width))
        n = len(observer.plan.states)
        most = int(np.clip(_SAMPLED // max(1, n), *_SAMPLES))
        self.samples = np.append(np.arange(0, len(times) - 1, -(-len(times) // most)), len(times) - 1)
        self._sampled = None if keep is None else np.empty((len(self.samples), n))

    def __call__(self, first: int, states: np.ndarray) -> None:
        last = first + len(states)
        self.table[first:last] = self.kept(self.times[first:last], states)
        if self._sampled is not None:
            a, b = np.searchsorted(self.samples, (first, last))
            self._sampled[a:b] = states[self.samples[a:b] - first]
        self.reached = max(self.reached, last)

    def kept(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """What is kept of some states."""
        return states if self._evaluate is None else self._evaluate(times, states)

    def taken(self) -> tuple[np.ndarray, np.ndarray]:
        """Output times so far, and what is kept of them."""
        return self.times[: self.reached], self.table[: self.reached]

    def sampled(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) and states (k, n) of the samples reached."""
        own = self.samples[self.samples < self.reached]
        return self.times[own], self.table[own] if self._sampled is None else self._sampled[: len(own)]


def _retained(flat: FlatDAE, keep: tuple[str, ...]) -> np.ndarray:
    """The variables of these names, and those that the model's assertions look at."""
    judged = [check.slots.ravel() for check in flat.checks]
    return distinct(np.concatenate([*(find(flat, name) for name in keep), *judged, np.zeros(0, int)]))


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The result of an integration.

    Attributes
    ----------
    time : (k,) s
    table : states at all times (k, n), or the kept variables where `keep` was given
    kept : flat variables in the columns of `table`, None where these are the states
    samples : some of the times (s,) and the states there (s, n), whatever is kept
    stats : what it cost: solver, steps, evaluations, seconds, …
    events : empty so far
    notes : what deserves a word about the run
    """

    observer: Observer
    time: np.ndarray
    table: np.ndarray
    kept: np.ndarray | None
    samples: tuple[np.ndarray, np.ndarray]
    stats: dict[str, object]
    events: tuple = ()
    notes: tuple[Diagnostic, ...] = ()
    _cache: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str) -> np.ndarray:
        """A variable over time (k,), or all of an array of variables (k, m).

        Raises
        ------
        KeyError
            With the nearest name, where there is no such variable.
        """
        if name == "time":
            return self.time
        if name not in self._cache:
            variables = find(self.observer.flat, name)
            values = self.of(variables)
            scalar = len(variables) == 1 and ":" not in name
            result = np.ascontiguousarray(values[:, 0]) if scalar else values
            if result.size > _CACHED:
                return result
            self._cache[name] = result
        return self._cache[name]

    def of(self, variables: np.ndarray) -> np.ndarray:
        """Variables of the flat model by number, (k, m)."""
        variables = np.asarray(variables, int)
        if self.kept is None:
            return self.observer(variables, self.time, self.table)
        column = np.searchsorted(self.kept, variables)
        missing = (column >= len(self.kept)) | (self.kept[np.minimum(column, len(self.kept) - 1)] != variables)
        if missing.any():
            name = self.observer.flat.variable_name(int(variables[np.flatnonzero(missing)[0]]))
            raise KeyError(f"'{name}' was not kept in this run")
        return self.table[:, column]

    def at(self, index: int) -> np.ndarray:
        """All variables of the flat model at one output time, (flat.count,)."""
        everything = np.arange(self.observer.flat.count)
        if self.kept is not None:
            result = np.full(len(everything), np.nan)
            result[self.kept] = self.table[index]
            return result
        index = range(len(self.time))[index]
        return self.observer(everything, self.time[index : index + 1], self.table[index : index + 1])[0]

    @property
    def states(self) -> np.ndarray:
        """The solved states over time (k, states); empty where only variables were kept."""
        return self.table[:, : self.observer.plan.state_count] if self.kept is None else np.zeros((len(self.time), 0))

    @cached_property
    def energy(self) -> Energy | None:
        """The energy ledger; None where the model has none or the run was told to leave it out."""
        flat = self.observer.flat
        integrated = self.observer.plan.reduced.registers.variable[self.observer.plan.states]
        for name in LEDGER:
            found = flat.find(name)
            if found is None or not np.isin(found, integrated).any() and not _is_known(self.observer, found):
                return None
        return measure(self)


def _is_known(observer: Observer, variable: np.ndarray) -> bool:
    """Work or heat that is no quadrature, because it is zero at all times."""
    reduced = observer.plan.reduced
    quadratures = reduced.registers.variable[reduced.quadratures]
    return bool((reduced.register_of[variable] >= 0).all()) and not np.isin(variable, quadratures).any()


def find(flat: FlatDAE, name: str) -> np.ndarray:
    """Variables of a name; KeyError with a hint where there are none."""
    variables = flat.find(name)
    if variables is None:
        hint = nearest(name, [b.pattern for b in flat.blocks])
        raise KeyError(f"no variable '{name}' in '{flat.name}'" + (f"; {hint}" if hint else ""))
    return variables
