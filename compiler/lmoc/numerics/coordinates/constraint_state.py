"""A place on the way of a mechanism, as its coordinates are judged there."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.numerics.coordinates.local_form import LocalRows
from lmoc.numerics.coordinates.tableau import Tableau, rank_margin
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class ConstraintState:
    """The constraints and coordinates at the end of a step.

    Attributes
    ----------
    t, x : s, (n,)
    matrix : of the constraints; its entries alone where they are seen block by block
    found : Tableau
    scaled : the same, in rows and columns of one length
    least : what its smallest singular value is not below
    solutions : of the nonlinear blocks, in the order of `CoordinateWatch.unknowns`
    coordinates : their values, by the columns of the constraints; none where the system does not tell
    local : the scaled matrix block by block; None where it is seen as a whole
    """

    t: float
    x: np.ndarray
    matrix: np.ndarray
    found: Tableau
    scaled: np.ndarray
    least: float
    solutions: np.ndarray
    coordinates: np.ndarray
    local: LocalRows | None = None

    @cached_property
    def margin(self) -> float:
        """The smallest singular value of the scaled matrix, or of its blocks."""
        return rank_margin(self.scaled) if self.local is None else self.local.margin

    def unexplained(self, later: ConstraintState, watched: np.ndarray) -> np.ndarray:
        """Return how far the dependent coordinates have come to a later place, apart from what their velocities tell.

        Parameters
        ----------
        watched : rows of the tableau

        Returns
        -------
        (watched,) array
            Magnitudes; empty where the coordinates are not known.
        """
        if not len(self.coordinates):
            return np.zeros(0)
        way = later.coordinates - self.coordinates
        told = -(self.found.plain + later.found.plain) / 2 @ way[len(way) - self.found.plain.shape[1] :]
        return np.nan_to_num(np.abs(way[watched] - told))
