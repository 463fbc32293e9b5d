"""The trajectory: segments, each with its own states and its own way back to every variable of the flat model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.mode import mode_words
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic
from lmoc.numerics.limits import NUMBERS
from lmoc.numerics.observe.closures import residuals
from lmoc.numerics.observe.energy import Energy, exchanged_energy, measure
from lmoc.numerics.observe.observer import Observer, find
from lmoc.numerics.plan.plan import LEDGER
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.problem.mode import Mode



@dataclass(frozen=True, eq=False, repr=False)
class SegmentRecord:
    """A part of a run with one reduction, one mode, one choice of coordinates.

    Attributes
    ----------
    observer : from its states to the variables
    begin : s, where it starts: the run's start, or where the segment before ends
    time : (k,) s, the output times in it
    table : (k, n) states at these times, or the kept variables
    samples : some of the times (s,) and the states there (s, n), whatever is kept
    mode : of the laws; None without laws
    largest : (n,) the magnitude of each state at the steps; None where they were not looked at
    rounding : (n,) what of the states' rates the forces of closed laws leave by rounding; None without laws
    """

    observer: Observer
    begin: float
    time: np.ndarray
    table: np.ndarray
    samples: tuple[np.ndarray, np.ndarray]
    mode: Mode | None = None
    largest: np.ndarray | None = None
    rounding: np.ndarray | None = None

    @property
    def reduced(self) -> Reduced:
        return self.observer.plan.reduced

    @property
    def coordinates(self) -> list[str]:
        """Names of the states."""
        return list(self.reduced.state_names)

    @property
    def words(self) -> dict[str, str]:
        """{law name: what its mode is called}, such as taut; empty without laws."""
        form = self.reduced.switched
        return {} if form is None or self.mode is None else mode_words(self.reduced.flat, form.laws, self.mode.shown)

    def until(self, count: int) -> SegmentRecord:
        """Return the segment with its first output times alone."""
        return replace(self, time=self.time[:count], table=self.table[:count])


@dataclass(frozen=True, eq=False)
class End(Mapping):
    """The complete final state of a run, where `simulate(initial=run.end)` continues. A mapping {state name: value}.

    Attributes
    ----------
    time : s
    states : names of the coordinates
    x : (n,) their values, then those of the quadratures
    values : (flat.count,) every variable of the flat model: on which branch its equations are solved, too
    mode : of the laws; None without laws
    crossing : what keeps relations that have just changed from changing back by rounding (`events.discrete_state`)
    stepping : what steps at this time has yet to do so, such as an input that is set by hand; else that has been done
    """

    time: float
    states: tuple[str, ...]
    x: np.ndarray
    values: np.ndarray
    mode: Mode | None = None
    crossing: np.ndarray | None = None
    stepping: bool = False

    def __getitem__(self, name: str) -> float:
        try:
            return float(self.x[self.states.index(name)])
        except ValueError:
            raise KeyError(name) from None

    def __iter__(self):
        return iter(self.states)

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        return f"<end of a run at t = {self.time:g} s: {', '.join(f'{n} = {v:.6g}' for n, v in self.items())}>"


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The result of an integration.

    Attributes
    ----------
    segments : at least one, in the order of time
    kept : flat variables in the columns of their tables, None where these are the states
    last : s, (n,): where it has ended, and the state there
    stats : what it cost: solver, steps, evaluations, seconds, …
    events : what has happened between the segments
    notes : what deserves a word about the run
    crossing : as of `End`
    begun : (n,), (registers,) the states and what does not change between events, before what laws and events do at the
        start; None without these, and for a run that continues another one
    planned : s, where the run was to end, though a model may have ended it earlier; or where it has failed
    unbooked : s, and why: from when on the energy ledger has no value
    start : (n,) the states where the first segment starts; None where nobody has kept them
    ended : the segment to whose end `last` belongs, where what a model does at its end (``when terminal()``) has made
        another one: a run that goes on has not ended; None for the last one
    """

    segments: tuple[SegmentRecord, ...]
    kept: np.ndarray | None
    last: tuple[float, np.ndarray]
    stats: dict[str, object]
    events: tuple = ()
    notes: tuple[Diagnostic, ...] = ()
    crossing: np.ndarray | None = None
    begun: tuple[np.ndarray, np.ndarray] | None = None
    planned: float = np.nan
    unbooked: tuple[float, str] = (np.inf, "")
    ended: SegmentRecord | None = None
    start: np.ndarray | None = None
    _cache: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def observer(self) -> Observer:
        """That of the first segment: parameter values and signals are the same in all."""
        return self.segments[0].observer

    @property
    def flat(self) -> FlatDAE:
        return self.observer.flat

    @cached_property
    def time(self) -> np.ndarray:
        """(k,) s, the output times."""
        return _joined([segment.time for segment in self.segments])

    @cached_property
    def table(self) -> np.ndarray:
        """(k, n) what is kept at these times, where it is the same in all segments.

        Raises
        ------
        ValueError
            The states are not those of one choice of coordinates.
        """
        if self.kept is None and any(p.reduced is not self.segments[0].reduced for p in self.segments):
            raise ValueError("the coordinates have changed in this run: its states are those of its segments")
        return _joined([segment.table for segment in self.segments])

    @property
    def states(self) -> np.ndarray:
        """The solved states over time (k, states); empty where only variables were kept. Raises as `table`."""
        if self.kept is not None:
            return np.zeros((len(self.time), 0))
        return self.table[:, : self.observer.plan.state_count]

    @cached_property
    def end(self) -> End:
        """Return the complete final state."""
        (time, x), segment = self.last, self.ended or self.segments[-1]
        values = segment.observer(np.arange(self.flat.count), np.array([time]), x[None])[0]
        return End(time, tuple(segment.coordinates), x, values, segment.mode, self.crossing)

    @property
    def coordinates(self) -> list[tuple[float, list[str]]]:
        """From when on which coordinates have been integrated."""
        return _changes([(p.begin, p.coordinates) for p in self.segments])

    @property
    def modes(self) -> list[tuple[float, dict[str, str]]]:
        """From when on the laws have been in which mode, {law name: mode}; at one instant the last counts."""
        found = {p.begin: p.words for p in self.segments}
        return _changes(list(found.items()))

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
            variables = find(self.flat, name)
            values = self.of(variables)
            scalar = len(variables) == 1 and ":" not in name
            result = np.ascontiguousarray(values[:, 0]) if scalar else values
            if result.size > NUMBERS:
                return result
            self._cache[name] = result
        return self._cache[name]

    def of(self, variables: np.ndarray) -> np.ndarray:
        """Variables of the flat model by number, (k, m)."""
        variables = np.asarray(variables, int)
        if self.kept is None:
            return _joined([p.observer(variables, p.time, p.table, lasting=True) for p in self.segments])
        result = np.empty((len(self.time), len(variables)))
        constant = self.flat.kind[variables] < Kind.INPUT
        result[:, constant] = self.observer.values[variables[constant]]
        moving = variables[~constant]
        column = np.searchsorted(self.kept, moving)
        missing = (column >= len(self.kept)) | (np.append(self.kept, -1)[np.minimum(column, len(self.kept))] != moving)
        if missing.any():
            name = self.flat.variable_name(int(moving[np.flatnonzero(missing)[0]]))
            raise KeyError(f"'{name}' was not kept in this run")
        result[:, ~constant] = self.table[:, column]
        return result

    def derivative(self, variable: int, order: int) -> np.ndarray | None:
        """Return a derivative of a variable over time (k,); None where it is not at hand."""
        registers = [p.observer.derivative(variable, order) for p in self.segments]
        if self.kept is not None or min(registers) < 0:
            return None
        parts = zip(self.segments, registers, strict=True)
        return _joined([p.observer.register(r, p.time, p.table) for p, r in parts])

    def at(self, index: int) -> np.ndarray:
        """All variables of the flat model at one output time, (flat.count,)."""
        everything = np.arange(self.flat.count)
        index = range(len(self.time))[index]
        if self.kept is not None:
            result = np.full(len(everything), np.nan)
            result[self.kept] = self.table[index]
            return result
        ends = np.cumsum([len(p.time) for p in self.segments])
        k = int(np.searchsorted(ends, index, "right"))
        own, segment = slice(index - int(ends[k]) + len(self.segments[k].time), None), self.segments[k]
        return segment.observer(everything, segment.time[own][:1], segment.table[own][:1])[0]

    def until(self, count: int) -> Trajectory:
        """Return the trajectory with its first output times alone."""
        segments, left = [], count
        for segment in self.segments:
            if left > 0 or not segments:
                segments.append(segment.until(left))
            left -= len(segment.time)
        return replace(self, segments=tuple(segments), _cache={})

    @cached_property
    def residual(self) -> tuple[float, float] | None:
        """The largest residuals of the closures of loops, positions and velocities; None without closed loops.

        At the ends of steps where the formulation looks at these, else at some of the output times.
        """
        if "position_residual" in self.stats:
            return float(self.stats["position_residual"]), float(self.stats["velocity_residual"])  # type: ignore[arg-type]
        found = [residuals(p.observer, *p.samples) for p in self.segments if len(p.samples[0])]
        known = [f for f in found if f is not None]
        return (max(f[0] for f in known), max(f[1] for f in known)) if known else None

    @cached_property
    def energy(self) -> Energy | None:
        """The energy ledger; None where the model has none or the run omits it."""
        for name in LEDGER:
            found = self.flat.find(name)
            if found is None or not all(_is_integrated(p.observer, found) for p in self.segments):
                return None
        sampled = [(p.observer, *p.samples) for p in self.segments if len(p.samples[0])]
        stored, work, heat = (self[f"ledger.{n}"] for n in ("stored", "work", "heat"))
        since, reason = self.unbooked
        work, heat = (np.where(self.time < since, values, np.nan) for values in (work, heat))
        held = max((_held_energy(*sample) for sample in sampled), default=0.0)
        return measure(stored, work, heat, exchanged_energy(self.flat, sampled), held, reason)


def _held_energy(observer: Observer, times: np.ndarray, states: np.ndarray) -> float:
    """Return the largest force of a law times the largest state, J: what rounding at rest is compared with."""
    form = observer.plan.reduced.switched
    if form is None:
        return 0.0
    forces = np.nan_to_num(np.abs(observer(form.force, times, states))).max(initial=0.0)
    return float(forces * np.abs(states[:, ~observer.plan.ledger]).max(initial=0.0))


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _changes(entries: list[tuple[float, object]]) -> list:
    """The entries that differ from the one before."""
    return [e for k, e in enumerate(entries) if not k or e[1] != entries[k - 1][1]]


def _is_integrated(observer: Observer, variable: np.ndarray) -> bool:
    """Return whether work or heat is integrated, or known to be zero at all times."""
    reduced = observer.plan.reduced
    table = reduced.registers.variable
    if np.isin(variable, table[observer.plan.states]).any():
        return True
    known = bool((reduced.register_of[variable] >= 0).all())
    return known and not np.isin(variable, table[reduced.quadratures]).any()
