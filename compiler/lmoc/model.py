"""A compiled model: its names and values, and its reduction for other parameters."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.names import Names, inputs_of, outputs_of
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.budgeted import budgeted
from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.parameters import Parameters, Value
from lmoc.pipeline import Clock, Scene
from lmoc.semantics.parameter_checks import warn_of_lost
from lmoc.session import Session


class CompiledModel:
    """A compiled model: what can be read from it; `lmoc.DAE` adds what can be done with it.

    Attributes
    ----------
    flat : FlatDAE
        The flat model: every variable and equation of the scene.
    reduced : Reduced
        The smallest system of equations, for the parameter values of the model.
    timings : {stage: seconds}
    """

    def __init__(self, scene: Scene, flat: FlatDAE, clock: Clock | None = None, reduced: Reduced | None = None):
        clock = clock or Clock()
        self._session = Session(scene, flat, clock, reduced)
        self.timings: dict[str, float] = clock.seconds

    @property
    def flat(self) -> FlatDAE:
        return self._session.flat

    @property
    def values(self) -> np.ndarray:
        """(flat.count,) the model's own parameter values."""
        return self._session.values

    @property
    def reduced(self) -> Reduced:
        return self._session.reduced

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.flat.name

    @cached_property
    def states(self) -> list[str]:
        """Names of the solved states, in their order."""
        return list(self.reduced.state_names)

    @cached_property
    def parameters(self) -> Parameters:
        """{name: value}; NaN where the model gives no value."""
        return Parameters(self.flat, self.values)

    @cached_property
    def inputs(self) -> list[str]:
        """Names of the top-level inputs."""
        return inputs_of(self.flat)

    @cached_property
    def outputs(self) -> list[str]:
        """Names of the top-level outputs."""
        return outputs_of(self.flat)

    @cached_property
    def variables(self) -> Names:
        """Names of everything that changes in time: a sequence, its names made on demand."""
        return Names(self.flat, np.flatnonzero(self.flat.kind >= Kind.INPUT))

    @property
    def notes(self) -> tuple[Diagnostic, ...]:
        """Warnings and notes of the compilation."""
        report = Report()
        warn_of_lost(self.flat, self.values, report)
        return tuple(dict.fromkeys((*self.flat.notes, *self.reduced.notes, *report.diagnostics)))

    @budgeted("the reduction")
    def prepare(self, parameters: Mapping[str, Value] | None = None, clock: Clock | None = None) -> Prepared:
        """Return the flat model, its reduction and the values for other parameters, with notes of what was redone.

        A structural parameter means flattening again; a broken guard means reducing again. Both are kept.
        """
        return self._session.for_derivation(parameters, clock)

    def __repr__(self) -> str:
        parts, equations = self.reduced.counts["parts"], self.flat.equation_count
        counts = f"{parts} parts, {equations} flat equations, {len(self.reduced.states)} states"
        return f"<{type(self).__name__} {self.name}: {counts}>"

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the scene, and its main methods."""
        from lmoc.report.page import named_lists

        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs, "parameters": self.parameters}
        return named_lists(repr(self).strip("<>"), names)
