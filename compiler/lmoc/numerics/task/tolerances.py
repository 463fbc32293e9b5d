"""The tolerances of a run: relative, and absolute for each integrated component."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.observe.observer import find
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.task.sizes import ABSOLUTE, assumed_sizes
from lmoc.numerics.task.task import Stretch, Task

_SMALL = 10_000  # registers


class Tolerances:
    """The relative tolerance of a run, and the absolute ones of the coordinates in use.

    Attributes
    ----------
    rtol : the relative tolerance that was requested
    """

    def __init__(self, task: Task, rtol: float) -> None:
        self.rtol = rtol
        self._task = task
        self._kept: tuple[Plan, np.ndarray] | None = None

    def absolute(self, stretch: Stretch, x: np.ndarray) -> np.ndarray:
        """Return the absolute tolerances (n,); those of one plan are computed once, where it is first used.

        Parameters
        ----------
        x : (n,) the state there
        """
        if self._kept is None or self._kept[0] is not stretch.plan:
            self._kept = stretch.plan, self._computed(stretch, x)
        return self._kept[1]

    def sizes(self, stretch: Stretch) -> np.ndarray | None:
        """Return the magnitudes (n,) that the absolute tolerances are relative to; None before the first step."""
        known = self._kept is not None and self._kept[0] is stretch.plan
        return self._kept[1] / self.rtol if known else None

    def _computed(self, stretch: Stretch, x: np.ndarray) -> np.ndarray:
        """(n,); those of the ledger are no finer than what the scene holds at the start has to be known."""
        task, plan, atol = self._task, stretch.plan, self._task.options.atol
        if atol is not None:
            result = np.full(len(x), atol, float)
        else:
            result = self.rtol * ABSOLUTE * assumed_sizes(plan, task.values, x, task.sizes)
        if plan.ledger.any():
            stored = plan.once(_StoredAtStart).at(stretch, x)
            result[plan.ledger] = np.fmax(result[plan.ledger], self.rtol * abs(stored))
        return result


class _StoredAtStart:
    """The energy at the beginning of a piece, kept for another run that begins at the same place."""

    def __init__(self, plan: Plan) -> None:
        self._variable = find(plan.reduced.flat, "ledger.stored")
        self._place: tuple[float, bytes, bytes] | None = None
        self._found = np.nan

    def at(self, stretch: Stretch, x: np.ndarray) -> float:
        """Return the energy, J, at the state x (n,) where a piece begins."""
        plan, observer = stretch.plan, stretch.observer
        small = plan.count <= _SMALL and not len(plan.sampled)  # then all that it depends on is quickly compared
        place = (stretch.begin, x.tobytes(), observer.base.tobytes()) if small else None
        if place is None or place != self._place:
            values = observer(self._variable, np.array([stretch.begin]), x[None])
            self._place, self._found = place, float(values[0, 0])
        return self._found
