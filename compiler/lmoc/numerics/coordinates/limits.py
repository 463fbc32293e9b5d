"""The numbers by which choices of coordinates are judged, in C (``engine/c/coordinates.h``) and in Python."""

from __future__ import annotations

import ctypes

from lmoc.support.records import dataclass


@dataclass(frozen=True)
class Limits:
    """Bounds, in the order of ``lmoc_coordinate_limits``.

    Attributes
    ----------
    margin, tolerated : by which the tableau's largest entry must have grown since the choice was made for another one
        to be looked for; and the largest entry that a choice may have from the beginning and still count as good
    good : the largest entry with which exchanges end
    unexplained : of the way of a dependent coordinate: as much as velocities may leave unexplained before it is looked
        at what happens within a step
    neighbours : in equilibrated form, about radians: solutions nearer than that are so at singular places alone
    rounding : way of a coordinate that is none
    at_once : of what velocities leave unexplained, what an eighth of the step may have at the most
    turned : in equilibrated form, about radians: the same for an angle, whatever the step has. It is less than what a
        jump by a whole turn is when an eighth of a step's way is taken off it
    alert : smallest singular value, in equilibrated form, below which a place ahead where constraints depend on each
        other is looked for
    sure : a lower bound of the smallest singular value with which it need not be computed
    dependent : smallest singular value below which constraints depend on each other where no step is short enough
    share : of the longest straight way on which the rank is certainly kept: the way of a motion is curved
    vanishing : as small a singular value of A, where a segment begins, is none
    grown : by which the sizes of entries must have grown for rows and columns to be equilibrated again
    normal : relative change of factors with which equilibration ends
    no_entry : share of the largest entry in its row below which an entry is what the errors of a run leave of zero: a
        coordinate that stays there by symmetry is no more than them
    """

    margin: float = 2.0
    tolerated: float = 25.0
    good: float = 1.5
    unexplained: float = 0.5
    neighbours: float = 0.02
    rounding: float = 1e-6
    at_once: float = 0.5
    turned: float = 2.5
    alert: float = 0.1
    sure: float = 0.12
    dependent: float = 1e-3
    share: float = 0.5
    vanishing: float = 1e-6
    grown: float = 1.25
    normal: float = 1e-2
    no_entry: float = 1e-8


LIMITS = Limits()


def limits_in_c(limits: Limits = LIMITS) -> ctypes.Array[ctypes.c_double]:
    """Return them as C reads them."""
    values = list(vars(limits).values())
    return (ctypes.c_double * len(values))(*values)
