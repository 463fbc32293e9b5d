"""A start at which the chosen coordinates do not serve."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.messages.source import Span
from lmoc.numerics.task.task import Segment

BRANCHES = "the scene starts at a singular position, in which its constraints depend on each other"
NEXT = "the scene starts next to a singular position, in which its constraints depend on each other"
BESIDE = "several motions may begin there, and nothing says which is meant: start a little beside it"
# smallest singular values of the constraints in rows of one length: as small they are dependent, or almost
_DEPENDENT, _ALMOST = 1e-9, 1e-4


def starts_singular(segment: Segment, time: float, x: np.ndarray) -> str:
    """Return a sentence where constraints depend on each other at a start, or almost; empty where they do not.

    Rows alone are brought to one length, too: beside a singular position all entries of a column may be small, which
    would count as a unit of its coordinate.
    """
    if segment.plan.reduced.constraints is None:
        return ""
    from lmoc.numerics.coordinates.watch import CoordinateWatch  # most scenes have none

    watch = CoordinateWatch(segment.system, segment.base)
    watch.begin(time, x)
    place = watch.accepted
    if not np.isfinite(place.matrix).all():
        return ""
    margin = min(watch.margin, watch.margin_at_once(place))
    return BRANCHES if margin < _DEPENDENT else NEXT if margin < _ALMOST else ""


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
