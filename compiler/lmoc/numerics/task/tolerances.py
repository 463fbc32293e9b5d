"""The tolerances of a run: relative, and absolute for each integrated component."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.numerics.limits import SMALL_PLAN
from lmoc.numerics.observe.observer import find
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.task.sizes import ABSOLUTE, Sizes, assumed_sizes
from lmoc.numerics.task.task import Segment, Task


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
        self._known: dict[tuple[str, ...], np.ndarray] = {}  # by the names of the states

    def absolute(self, segment: Segment, x: np.ndarray) -> np.ndarray:
        """Return the absolute tolerances (n,); those of the same states are computed once, where they are first used.

        Parameters
        ----------
        x : (n,) the state there
        """
        if self._kept is None or self._kept[0] is not segment.plan:
            names = tuple(segment.plan.reduced.state_names)
            if names not in self._known:
                self._known[names] = self._computed(segment, x)
            self._kept = segment.plan, self._known[names]
        return self._kept[1]

    def sizes(self, segment: Segment) -> np.ndarray | None:
        """Return the magnitudes (n,) that the absolute tolerances are relative to; None before the first step."""
        known = self._kept is not None and self._kept[0] is segment.plan
        return self._kept[1] / self.rtol if known else None

    def _computed(self, segment: Segment, x: np.ndarray) -> np.ndarray:
        task, plan = self._task, segment.plan

        def stored() -> np.ndarray:
            return np.asarray(plan.once(_StoredAtStart).at(segment, x))

        return absolute_tolerances(plan, task.values, x, self.rtol, task.options.atol, stored, task.sizes)


def absolute_tolerances(
    plan: Plan, values: np.ndarray, x: np.ndarray, rtol: float, atol: float | None, stored: Callable[[], np.ndarray],
    known: Sizes,
) -> np.ndarray:  # fmt: skip
    """Return absolute tolerances; those of the ledger are no finer than what the scene holds at the start is known.

    Parameters
    ----------
    values, x, known : as of `assumed_sizes`: of one run, or of several
    atol : that is asked for; None for parts of the sizes
    stored : returns the energy at the start, J, a number for each run
    """
    found = rtol * ABSOLUTE * assumed_sizes(plan, values, x, known) if atol is None else np.full(x.shape, atol, float)
    if plan.ledger.any():
        found[..., plan.ledger] = np.fmax(found[..., plan.ledger], rtol * np.abs(stored())[..., None])
    return found


class _StoredAtStart:
    """The energy at the beginning of a segment, kept for another run that begins at the same place."""

    def __init__(self, plan: Plan) -> None:
        self._variable = find(plan.reduced.flat, "ledger.stored")
        self._place: tuple[float, bytes, bytes] | None = None
        self._found = np.nan

    def at(self, segment: Segment, x: np.ndarray) -> float:
        """Return the energy, J, at the state x (n,) where a segment begins."""
        plan, observer = segment.plan, segment.observer
        small = plan.count <= SMALL_PLAN and not len(plan.sampled)  # then all that it depends on is quickly compared
        place = (segment.begin, x.tobytes(), observer.base.tobytes()) if small else None
        if place is None or place != self._place:
            values = observer(self._variable, np.array([segment.begin]), x[None])
            self._place, self._found = place, float(values[0, 0])
        return self._found
