"""The result of a run: every variable of the flat model by name, what the run cost, and where the energy went."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.flat import Block, FlatDAE, Kind
from lmoc.ir.names import Names, UnknownNameError, hint_for, names_of
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic
from lmoc.report.balance import is_unbalanced, unbalanced
from lmoc.report.mechanics import remarks
from lmoc.report.resolution import coarse_points, fine_count
from lmoc.report.units import unit_of
from lmoc.support.quoted import subscripts

if TYPE_CHECKING:
    from lmoc.numerics.observe.energy import Energy
    from lmoc.numerics.observe.trajectory import End, Trajectory

MANY = 2000  # variables: tables of larger scenes hold outputs and states unless names are given


class Result:
    """The result of a simulation.

    Variables that nobody integrates are computed on first access.

    Attributes
    ----------
    time : (times,) s
    stats : {name: number or text}: solver, steps, evaluations, wall time of each stage
    events : records of switching and impacts
    broke_off : s, the time reached where the run failed before its end, behind the last of `time`; else None
    """

    def __init__(
        self,
        reduced: Reduced,
        trajectory: Trajectory,
        notes: Sequence[Diagnostic] = (),
        timings: Mapping[str, float] | None = None,
        broke_off: float | None = None,
        again: Callable[[np.ndarray], Result] | None = None,
        extended: Callable[..., Result] | None = None,
    ):
        self.flat: FlatDAE = reduced.flat
        self.reduced = reduced
        self.trajectory = trajectory
        self.time: np.ndarray = trajectory.time
        self._notes = (*notes, *coarse_points(trajectory.stats, len(self.time), broke_off is None))
        self._again = again  # the same run with other output times
        self.extended = extended  # the same run of its flat model with more in it, the inputs for that, and the start
        self.timings = dict(timings or {})
        self.events: tuple = tuple(trajectory.events)
        self.broke_off = broke_off

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_again": None, "extended": None}  # a run that has been pickled stays as it is

    @cached_property
    def fine(self) -> Result:
        """The same run with output times as dense as its steps need: what a picture is drawn from."""
        count = fine_count(self.trajectory.stats, len(self.time), len(self.reduced.states))
        if count <= len(self.time) or self._again is None or not self.complete:
            return self
        between = np.linspace(self.time[0], self.time[-1], count)
        return self._again(np.union1d(between, self.time))

    @cached_property
    def notes(self) -> tuple[Diagnostic, ...]:
        """Warnings and notes of the compilation and of this run."""
        found = unbalanced(self.energy, self._rtol) if self.complete else None
        said = remarks(self.reduced, self.trajectory, self.complete)
        return (*self._notes, *said) if found is None else (*self._notes, *said, found)

    @property
    def residual(self) -> tuple[float, float] | None:
        """The largest residuals of the closures of loops, of positions and of velocities; None without closed loops."""
        return self.trajectory.residual

    @property
    def complete(self) -> bool:
        """Return whether the run has come to its end."""
        return self.broke_off is None

    # ---------------------------------------------------------------------- variables

    def __getitem__(self, name: str) -> np.ndarray:
        """Values over time: (times,) for a variable, (times, n) for an array (all indices in row-major order).

        Parameters
        ----------
        name : ``body.q``, ``m[3].q``, ``m.q`` or ``m[2:4].q``; ``der(...)`` of a state; a parameter gives a constant

        Raises
        ------
        UnknownNameError
            A KeyError that names what may have been meant.
        TypeError
            The index is not a name.
        """
        if not isinstance(name, str):
            raise TypeError(f"a run is indexed by names of variables, such as run['time'], not by {name!r:.40}")
        if name == "time":
            return self.time
        if name.startswith("der(") and name.endswith(")"):
            return self._derivative(name)
        values = self.values(self._variables(name))
        return values if is_array(self.flat, name) else values[:, 0]

    def __iter__(self) -> Iterator[str]:
        """Names of the time and of everything that changes in it, or of what was kept."""
        yield "time"
        yield from Names(self.flat, np.flatnonzero(self.flat.kind >= Kind.INPUT)) if self.kept is None else self.kept

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name == "time" or self.flat.find(name) is not None)

    def values(self, variables: np.ndarray) -> np.ndarray:
        """Values (times, n) of variables by their indices in the flat model; NaN for what the model leaves open."""
        return self.trajectory.of(np.asarray(variables, int))

    def _derivative(self, name: str) -> np.ndarray:
        inner, order = name, 0
        while inner.startswith("der(") and inner.endswith(")"):
            inner, order = inner[4:-1].strip(), order + 1
        found = self.flat.find(inner)
        if found is None or len(found) != 1:
            raise UnknownNameError(name, hint_for(self.flat, inner))
        values = self.trajectory.derivative(int(found[0]), order)
        if values is None:
            raise UnknownNameError(name, "only derivatives of states are available, and only where all states are kept")
        return values

    @property
    def coordinates(self) -> list[tuple[float, list[str]]]:
        """From when on which states have been integrated: one entry, or more where coordinates changed on the way."""
        return self.trajectory.coordinates

    @property
    def modes(self) -> list[tuple[float, dict[str, str]]]:
        """From when on the laws have been in which mode, {law name: mode}: one entry, or more where they switched."""
        return self.trajectory.modes

    @property
    def end(self) -> End:
        """Return the complete final state: ``simulate(initial=run.end)`` continues as if the run had never stopped."""
        return self.trajectory.end

    @property
    def states(self) -> list[str]:
        """Names of the solved states, of those at the start where coordinates changed."""
        return list(self.reduced.state_names)

    @cached_property
    def outputs(self) -> list[str]:
        """Names of the top-level outputs."""
        return [b.name(i) for b in self.flat.blocks if b.output for i in range(b.size)]

    @cached_property
    def kept(self) -> list[str] | None:
        """Names of the variables that the run keeps (without the energy ledger); None where everything is at hand."""
        if self.trajectory.kept is None:
            return None
        moving = self.trajectory.kept[self.flat.kind[self.trajectory.kept] >= Kind.INPUT]  # assertions keep parameters
        names = (self.flat.variable_name(int(v)) for v in moving)
        return [name for name in names if not name.startswith("ledger.")]

    @cached_property
    def final(self) -> dict[str, float]:
        """The last values of the outputs and, unless there are very many, of the states; or of what was kept."""
        states = self.states if len(self.reduced.states) <= MANY else []
        names = [*self.outputs, *states] if self.kept is None else self.kept
        return {name: float(self[name][-1]) for name in dict.fromkeys(names)}

    # --------------------------------------------------------------------- cost, energy

    @property
    def stats(self) -> dict[str, Any]:
        return self.trajectory.stats

    @cached_property
    def energy(self) -> Energy | None:
        """Stored, supplied and lost energy over time and the error of their `balance`.

        None where the run does not integrate work and heat.
        """
        energy = self.trajectory.energy
        if energy is None or not self.complete or not is_unbalanced(energy, self._rtol) or self.fine is self:
            return energy
        # A few output times may all lie where nothing has been supplied, such as at whole periods of an oscillation:
        # the error is then judged by the energy between them.
        between = self.fine.energy
        return energy if between is None else replace(energy, exchanged=max(energy.exchanged, between.scale))

    @property
    def _rtol(self) -> float:
        return float(self.stats.get("rtol", 0.0))

    def unit(self, name: str) -> str:
        """Unit of a variable or a state's derivative as written, or of a variable with the same value; else empty."""
        return unit_of(self.reduced, name)

    # ------------------------------------------------------------- tables, files, pictures

    def table_variables(self) -> np.ndarray:
        """Variables in the columns of a table: all that changes in time, outputs first, then states; of a large scene
        only outputs and inputs, and the states where they are not too many."""
        blocks = [b for b in self.flat.blocks if b.kind >= Kind.INPUT and not b.protected]
        small = sum(b.size for b in blocks) <= MANY
        outputs = [b for b in blocks if b.output]
        rest = blocks if small else [b for b in blocks if b.kind == Kind.INPUT]
        table = self.reduced.registers
        held = self.reduced.states[table.order[self.reduced.states] == 0]
        states = table.variable[held] if small or len(held) <= MANY else np.zeros(0, int)
        chosen = np.concatenate([*map(_members, outputs), states, *map(_members, rest)]).astype(int)
        order = np.sort(np.unique(chosen, return_index=True)[1])
        return chosen[order]

    def columns(self, names: str | Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """{name: (times,) values}, time first: the `table_variables`, or the names given, arrays by their members."""
        names = names_of(names)
        if names is None and self.kept is None:
            return {"time": self.time} | self._by_name(self.table_variables())
        columns = {"time": self.time}
        for name in self.kept if names is None else names:
            columns |= {name: self[name]} if name.startswith("der(") else self._by_name(self._variables(name))
        return columns

    def _by_name(self, variables: np.ndarray) -> dict[str, np.ndarray]:
        labels = (self.flat.variable_name(int(v)) for v in variables)
        return dict(zip(labels, self.values(variables).T, strict=True))

    def _variables(self, name: str) -> np.ndarray:
        found = self.flat.find(name)
        if found is None:
            raise UnknownNameError(name, hint_for(self.flat, name))
        return found

    def to_dataframe(self, names: str | Sequence[str] | None = None):
        """A pandas DataFrame with the time as index; columns as in `columns`."""
        import pandas

        columns = self.columns(names)
        return pandas.DataFrame(columns).set_index("time")

    def to_xarray(self, names: str | Sequence[str] | None = None):
        """Return an `xarray.Dataset` over time, with units and descriptions; names as of `columns`.

        Raises
        ------
        ImportError
            xarray is not installed: ``pip install 'lmoc[studies]'``.
        """
        import xarray

        columns = self.columns(names)
        time = ("time", columns.pop("time"), {"units": "s"})
        data = {name: ("time", values, self.about(name)) for name, values in columns.items()}
        return xarray.Dataset(data, {"time": time}, {"model": self.flat.name, "title": self.flat.description})

    def about(self, name: str) -> dict[str, str]:
        """Unit and description of a variable, as xarray and its plots name them."""
        found = self.flat.find(name)
        if found is None:
            return {}
        block = self.flat.block_at(int(found[0]))
        given = {"units": block.unit, "long_name": block.description}
        return {key: text for key, text in given.items() if text}

    def __repr__(self) -> str:
        end = "" if self.complete else f", broke off at {self.broke_off:.6g} s"
        return f"<Run of {self.flat.name}: {len(self.time)} times from {self.time[0]:g} to {self.time[-1]:g} s{end}>"


def _members(block: Block) -> np.ndarray:
    return np.arange(block.offset, block.offset + block.size)


def is_array(flat: FlatDAE, name: str) -> bool:
    """Return whether a name stands for several variables: an index is missing or is a range."""
    block: Block = flat.block_at(int(flat.find(name)[0]))
    given = [index for found in subscripts(name) for index in found]
    return len(given) < len(block.dims) or any(":" in index for index in given)
