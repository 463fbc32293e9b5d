"""What reductions of one model for the same parameter values share, whatever their states.

A crank that passes its change points is reduced once for each set of coordinates: which constraints follow from others,
and where the scene starts, is the same each time, and costs more than all the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.normalized import Normalized

if TYPE_CHECKING:
    from lmoc.structure.coordinates.selection import Starts

_OF_THEIR_OWN = {"flat", "guards", "notes"}  # attributes of normal forms that are not compared


class Shared:
    """The last normal form met, and what is known of it, in one piece: threads may reduce one model at once."""

    def __init__(self) -> None:
        self._last: tuple[Normalized, Normalized, Starts] | None = None

    def completed(
        self, normalized: Normalized, complete: Callable[[Normalized], Normalized]
    ) -> tuple[Normalized, Starts]:
        """Return what a function makes of a normal form, and where that starts, as `selection.select` keeps it.

        It is what the function has made of the last one where both are the same.
        """
        last = self._last
        if last is None or normalized.flat is not last[0].flat or not _same(normalized, last[0]):
            self._last = last = normalized, complete(normalized), {}
        first, found, starts = last
        guards = *normalized.guards, *found.guards[len(first.guards) :]
        return replace(found, guards=guards, notes=(*normalized.notes, *found.notes[len(first.notes) :])), starts


def _same(a: Any, b: Any) -> bool:
    """Return whether two structures hold the same numbers and shapes."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if is_dataclass(a):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name not in _OF_THEIR_OWN)
    return bool(a == b)
