"""A start at which the chosen coordinates do not serve."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.messages.source import Span


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
