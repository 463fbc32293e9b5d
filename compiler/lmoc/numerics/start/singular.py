"""A start at which the chosen coordinates do not serve."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.messages.source import Span
from lmoc.numerics.task import Stretch

BRANCHES = "the scene starts at a singular position, in which its constraints depend on each other"
BESIDE = "several motions may begin there, and nothing says which is meant: start a little beside it"
_DEPENDENT = 1e-5  # smallest singular value of the constraints in rows and columns of one length


def starts_singular(stretch: Stretch, time: float, x: np.ndarray) -> bool:
    """Return whether constraints depend on each other at a start, so that no coordinates would serve."""
    if stretch.plan.reduced.constraints is None:
        return False
    from lmoc.numerics.coordinates.watch import CoordinateWatch  # most scenes have none

    watch = CoordinateWatch(stretch.system, stretch.base)
    watch.begin(time, x)
    return bool(np.isfinite(watch.accepted.matrix).all()) and watch.accepted.margin < _DEPENDENT


class StartSingular(ModelError):
    """A value is lost at the start, which may be due to the coordinates: others may start there.

    Attributes
    ----------
    coordinates : names of the states
    place : where the lost variable is declared in the model
    """

    def __init__(
        self, diagnostics: Iterable[Diagnostic], coordinates: Sequence[str] = (), place: Span | None = None
    ) -> None:
        super().__init__(diagnostics)
        self.coordinates, self.place = tuple(coordinates), place

    def __reduce__(self) -> tuple:
        return type(self), (self.diagnostics, self.coordinates, self.place)
