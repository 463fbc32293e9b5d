"""A scene made ready for one set of parameter values: what simulations and derivations start from."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.names import inputs_of, outputs_of
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Prepared:
    """A flat model, its reduction for a set of parameter values, and these values.

    Attributes
    ----------
    flat : FlatDAE
        The model; another one than that of the default values where a parameter shapes it.
    reduced : Reduced
        Its guards hold for `values`.
    values : (flat.count,)
        Parameter values (`FlatDAE.parameter_values`).
    notes : what had to be redone for these values
    minimal : the reduction in minimal coordinates that finds the start, where `reduced` has others
    remembered : discrete variables that depend on the past and are held as they start, for a derivation
    """

    flat: FlatDAE
    reduced: Reduced
    values: np.ndarray
    notes: tuple[Diagnostic, ...] = ()
    minimal: Reduced | None = None
    remembered: tuple[int, ...] = ()

    @property
    def held(self) -> dict[str, float]:
        """{name: value} of the remembered variables."""
        return {self.flat.variable_name(v): float(self.values[v]) for v in self.remembered}

    @cached_property
    def inputs(self) -> list[str]:
        """Names of the top-level inputs."""
        return inputs_of(self.flat)

    @cached_property
    def outputs(self) -> list[str]:
        """Names of the top-level outputs."""
        return outputs_of(self.flat)
