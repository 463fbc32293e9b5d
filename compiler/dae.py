"""What a user holds of a compiled scene: names, values, simulation, and the door to symbolic results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc import pipeline
from lmoc.diagnostics import Diagnostic, ModelError
from lmoc.pipeline import Clock, Scene
from lmoc.report.names import Names, hint_for
from lmoc.semantics.flat import Block, FlatDAE, Kind
from lmoc.source import Source
from lmoc.structure.reduced import Reduced

if TYPE_CHECKING:
    from lmoc.report.run import Run

Value = float | bool | Sequence[float] | np.ndarray


def compile(
    path: str | Path,
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: Sequence[str] | None = None,
    *,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Compile the scene in a file.

    Parameters
    ----------
    path : the `.lmo` file
    model : which model, where the file holds several that could be meant
    parameters : {dotted name: value}, overriding what the file says
    states : variables to prefer as states
    listener : called with the name of each stage as it begins

    Raises
    ------
    ModelError
        The model is wrong, or the file cannot be read; `.diagnostics` say what and where.
    """
    return compile_source(pipeline.read_source(path), model, parameters, states, listener)


def compile_text(
    text: str,
    name: str = "model.lmo",
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: Sequence[str] | None = None,
) -> DAE:
    """Compile a scene given as text; `name` stands for the file's name in messages. Otherwise as `compile`."""
    return compile_source(Source(name, text), model, parameters, states)


def compile_source(
    source: Source,
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: Sequence[str] | None = None,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Compile one source; otherwise as `compile`."""
    clock = Clock(listener)
    files = pipeline.parse([source], clock)
    scene = Scene(files, model, dict(parameters or {}), None if states is None else tuple(states))
    return DAE(scene, pipeline.flatten(scene, clock), clock)


class Parameters(Mapping):
    """Parameters by dotted name: their values, NaN where the model gives none. An array by its own name is an array."""

    def __init__(self, flat: FlatDAE, values: np.ndarray):
        self._flat = flat
        self._values = values
        self._names = Names(flat, np.flatnonzero(flat.kind == Kind.PARAMETER))

    def __getitem__(self, name: str) -> float | np.ndarray:
        found = self._flat.find(name)
        if found is None or self._flat.kind[found[0]] != Kind.PARAMETER:
            raise KeyError(name)
        values = self._values[found]
        return float(values[0]) if name in self._names else values

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        if len(self) > 60:
            return f"<{len(self)} parameters>"
        return "{" + ", ".join(f"{name!r}: {value:g}" for name, value in self.items()) + "}"


class DAE:
    """A compiled scene. Made by `lmoc.compile`; parameters can be changed from run to run without compiling again.

    Attributes
    ----------
    flat : FlatDAE
        The flat model: every variable and equation of the scene.
    reduced : Reduced
        The smallest system of equations, for the parameter values of the model.
    timings : {stage: seconds}
    """

    def __init__(self, scene: Scene, flat: FlatDAE, clock: Clock | None = None):
        clock = clock or Clock()
        self.flat = flat
        self._scene = scene
        self.values = flat.parameter_values()
        self.reduced: Reduced = pipeline.reduce(flat, self.values, scene.states, clock)
        self.timings: dict[str, float] = clock.seconds
        self._reductions = [self.reduced]  # one for each pattern of guards met so far
        self._reshaped: dict[tuple, DAE] = {}  # for structural parameter values met so far
        self._prepared: dict[int, Any] = {}

    # ------------------------------------------------------------------------- names

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.flat.name

    @cached_property
    def states(self) -> list[str]:
        """Names of the solved states, in their order."""
        return self.reduced.state_names

    @cached_property
    def parameters(self) -> Parameters:
        """{name: value}; NaN where the model gives no value."""
        return Parameters(self.flat, self.values)

    @cached_property
    def inputs(self) -> list[str]:
        """Names of the top-level inputs."""
        return list(Names(self.flat, np.flatnonzero(self.flat.kind == Kind.INPUT)))

    @cached_property
    def outputs(self) -> list[str]:
        """Names of the top-level outputs."""
        return list(Names(self.flat, np.flatnonzero(self.flat.per_variable(lambda b: b.output, bool))))

    @cached_property
    def variables(self) -> Names:
        """Names of everything that changes in time: a sequence, its names made on demand."""
        return Names(self.flat, np.flatnonzero(self.flat.kind >= Kind.INPUT))

    @property
    def notes(self) -> tuple[Diagnostic, ...]:
        """Warnings and notes of the compilation."""
        return tuple(dict.fromkeys((*self.flat.notes, *self.reduced.notes)))

    def __repr__(self) -> str:
        return (
            f"<DAE {self.name}: {len(self.flat.parts) - 1} parts, {self.flat.equation_count} flat equations, "
            f"{len(self.reduced.states)} states>"
        )
