"""Places of mechanisms of many loops, which are seen block by block (`local_form`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.numerics.coordinates.judge import REGULAR, Judge, Place
from lmoc.numerics.coordinates.limits import LIMITS, Limits
from lmoc.numerics.coordinates.local_form import LocalForm, LocalRows


def local_limits(form: LocalForm) -> Limits:
    """Return what is judged otherwise: along a row of n loops the motion of one adds up n times."""
    return replace(LIMITS, tolerated=max(LIMITS.tolerated, float(len(form.sizes))))


class LocalPlaces:
    """Tells a judge what it asks about places.

    Attributes
    ----------
    form : the blocks
    sizes : of the entries of the matrix, and their factors
    """

    def __init__(self, form: LocalForm, judge: Judge) -> None:
        self.form, self.sizes, self._judge = form, form.equilibration(judge.units), judge
        self._rows: dict[int, LocalRows] = {}  # of each place of the judge
        self._signs: dict[bytes, float] = {}  # a number for each combination

    def see(self, place: Place) -> None:
        """Judge the entries of a place."""
        own, judge = self.sizes, self._judge
        own.grow(np.abs(place.matrix))
        even = own.scaled(place.matrix)
        table, signs = self.form.followed(even)
        columns, count = own.factors()[1], len(table)
        plain = columns[:count, None] * table / columns[count:]
        place.table[:] = plain[judge.watched] if signs else np.inf
        rows = self._rows[id(place)] = self.form.local(even, own, table)
        sign = self._signs.setdefault(signs, len(self._signs) + 1.0) if signs else 0.0
        place.head[1:] = sign, rows.margin, rows.margin
        judge.ranges[:], judge.column_factor[:] = own.ranges, columns

    def margin(self, matrix: np.ndarray) -> float:
        """Return the smallest singular value of any block."""
        return self.form.local(self.sizes.scaled(matrix), self.sizes).margin

    def answer(self, what: int, place: Place, other: Place) -> float:
        """Return whether a place is regular, or the way to another one."""
        if what == REGULAR:
            return float(self._now(place).stays_regular(self._now(other)))
        return float(self.form.vanishes(place.matrix, self._judge.units))

    def _now(self, place: Place) -> LocalRows:
        """The blocks of a place in the sizes that entries have by now."""
        if self._rows[id(place)].factors is not self.sizes.factors():
            self._rows[id(place)] = self.form.local(self.sizes.scaled(place.matrix), self.sizes)
        return self._rows[id(place)]
