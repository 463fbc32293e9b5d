"""What the laws of a scene are in during a segment of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import NONE, Switched
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Mode:
    """The mode of the laws: which are closed, and in which direction open friction slips.

    Attributes
    ----------
    closed : (n,)
    direction : (n,) sign of the sliding velocity of open friction, 0 elsewhere
    implied : (n,) laws whose motion the other closed ones hold already: closed ones, friction at its limit, and open
        ones without a force
    push : (n,) constant forces of implied closed laws, 0 elsewhere
    """

    closed: Mask
    direction: NDArray[np.int64]
    implied: Mask
    push: Array

    @property
    def shown(self) -> Mask:
        """(n,) laws whose motion is held: closed, or open without a force where others hold it (as a ratchet beside a
        brake, either of which may carry the load)."""
        return self.closed | (self.implied & (self.direction == 0))

    @property
    def key(self) -> bytes:
        return self.closed.tobytes() + self.direction.tobytes() + self.implied.tobytes()

    def without(self, apart: Mask) -> Mode:
        """Return the mode in which these laws have let go."""
        return replace(
            self, closed=self.closed & ~apart, implied=self.implied & ~apart, push=np.where(apart, 0.0, self.push)
        )

    def inputs(self, form: Switched) -> tuple[tuple[NDArray[np.int64], Array], ...]:
        """Return the inputs of the switched form with their values, (variables, values)."""
        has = form.direction != NONE
        return (
            (form.closed, (self.closed & ~self.implied).astype(float)),
            (form.push, self.push),
            (form.direction[has], self.direction[has].astype(float)),
        )
