"""The bounds of `condition_bounds` by the engine (``engine/c/step_check.c``)."""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.engine.library import library
from lmoc.numerics.coordinates.bounds_layout import BoundsLayout
from lmoc.numerics.coordinates.entries import constraints_tape
from lmoc.numerics.coordinates.equilibration import GROWN
from lmoc.numerics.coordinates.tableau import AGAIN, NORMAL
from lmoc.numerics.limits import NO_ENTRY
from lmoc.numerics.plan.plan import Plan

# of the way of a dependent coordinate: as much as velocities may leave unexplained before it is looked at what happens
# within a step
UNEXPLAINED = 0.5
NEIGHBOURS = 0.02  # in equilibrated form, about radians: solutions nearer than that are so at singular places alone
_SQUARINGS = 2  # of the inverse, with which the bound of the smallest singular value is within a tenth for eight rows


class _Bounds(ctypes.Structure):
    """``bounds_of`` in ``engine/c/step_check.c``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("w", "tape")],
        *[(name, ctypes.c_int64) for name in ("rows", "columns", "count", "states", "entries", "watched", "told")],
        *[(name, ctypes.c_int64) for name in ("squarings", "again")],
        *[(name, ctypes.c_double) for name in ("unexplained", "grown", "neighbours", "normal", "rounding")],
        *[(name, ctypes.c_void_p) for name in ("entry", "target", "place", "row", "work")],
    ]


class BoundsKernel:
    """The bounds of one system.

    Attributes
    ----------
    given, results : as in `BoundsLayout`
    addresses : of the function's first argument, of what is given and of what is found
    """

    def __init__(self, plan: Plan, layout: BoundsLayout) -> None:
        own, (watched, states) = plan.reduced.constraints, layout.table
        rows, columns, count = own.rows, len(own.variable), len(layout.places)
        self._kernel = kernel = Kernel(plan.once(constraints_tape))
        self.given, given = layout.given()
        self.results, results = layout.found()
        lists = own.register, layout.targets, layout.places, own.watched
        tables = [np.ascontiguousarray(t, np.int32) for t in lists]
        work = np.zeros(2 * rows * (columns + rows) + 5 * (columns + rows) + count)
        self._bounds = _Bounds(
            *kernel.addresses, rows, columns, count, states, len(own.register), watched, layout.told, _SQUARINGS, AGAIN,
            UNEXPLAINED, GROWN, NEIGHBOURS, NORMAL, NO_ENTRY, *(t.ctypes.data for t in tables), work.ctypes.data,
        )  # fmt: skip
        self._held = tables, work, given, results
        self.addresses = ctypes.addressof(self._bounds), given.ctypes.data, results.ctypes.data
        self._run = library().lmoc_condition_bounds

    def __call__(self, t: float, known: np.ndarray, reads: np.ndarray) -> None:
        """Compute what is found.

        Parameters
        ----------
        known : values of the registers `reads`
        """
        self._kernel.w[reads] = known
        own, given, found = self.addresses
        self._run(own, t, given, found)
