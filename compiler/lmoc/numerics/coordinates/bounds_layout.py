"""The order of the arrays that bounds read and fill."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from lmoc.ir.reduced import Constraints


class BoundsLayout:
    """The constraints at both ends of a step, as arrays one after the other.

    Attributes
    ----------
    places : of the matrix's entries that are not always zero, row by row
    targets : which of these each entry of the constraints is added to
    table : (watched, states) shape of the tableau
    told : coordinates that are known: all or none
    """

    def __init__(self, own: Constraints, told: int) -> None:
        at = own.row.astype(int) * len(own.variable) + own.column
        self.places, self.targets = np.unique(at, return_inverse=True)
        self.table, self.told = (len(own.watched), len(own.variable) - own.rows), told
        count, size = len(self.places), self.table[0] * self.table[1]
        self._given = count, size, told, told, count, count, count, size, self.table[0]
        self._found = count, size, count, 6

    def given(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Return what was known at the beginning of the step (entries, tableau row by row, coordinates), the
        coordinates at its end; factor, size and bound of each entry, the scale of each entry of the tableau, and the
        short ways of the dependent coordinates; then all of it.
        """
        return _split(self._given)

    def found(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Return entries and tableau at the end of the step, the sizes, the bounds; then all of it."""
        return _split(self._found)


def _split(lengths: tuple[int, ...]) -> tuple[list[np.ndarray], np.ndarray]:
    whole, ends = np.zeros(sum(lengths)), list(accumulate(lengths))
    return [whole[end - length : end] for length, end in zip(lengths, ends, strict=True)], whole
