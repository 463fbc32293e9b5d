"""The steps of inputs and of discrete values in a run: when they come, what they do, and how they are reported."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.events.impulse import NoImpulse
from lmoc.numerics.events.steps import Jump, Steps
from lmoc.numerics.limits import LOCATED
from lmoc.numerics.observe.event import STEP, Event
from lmoc.numerics.plan import kinks
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.problem.status import Status, Stopped
from lmoc.numerics.signals.signals import Formula, Signal, Table


class Stepping:
    """The steps of one run.

    Attributes
    ----------
    times : s, at which inputs step whose derivatives the equations hold; each is passed once
    records : of the steps that have moved something
    unbooked : s, and why: from when on the energy ledger has no value
    """

    def __init__(
        self, plan: Plan, base: np.ndarray, signals: Mapping[int, Signal], span: tuple[float, float], report: Report
    ) -> None:
        self.plan, self.signals, self.report = plan, signals, report
        self.records: list[Event] = []
        self.unbooked: tuple[float, str] = (np.inf, "")
        self.times = _times(plan, base, signals, span)
        self._begin, self._passed = span[0], 0

    def memory(self) -> int:
        """Return how many steps are behind, for `recall`."""
        return self._passed

    def recall(self, memory: int) -> None:
        """Stand before the same step."""
        self._passed = memory

    @property
    def next(self) -> float:
        """Return the next time at which inputs step, infinity where there is none."""
        return float(self.times[self._passed]) if self._passed < len(self.times) else np.inf

    def instant(self, t: float) -> float | None:
        """Return the next time at which inputs step, for one as near to it as integrators come; None elsewhere."""
        return self.next if abs(self.next - t) <= self._near(t) else None

    def pass_by(self, t: float) -> None:
        """Take the steps up to a time for done."""
        self._passed = max(self._passed, int(np.searchsorted(self.times, t + self._near(t), "right")))

    def _near(self, t: float) -> float:
        return LOCATED * max(abs(t), abs(self._begin))

    def __call__(self, t: float, x: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the states after what steps at an instant, with all laws open.

        Parameters
        ----------
        before, after : registers that do not change between events, on both sides

        Raises
        ------
        Stopped
            The motion has no finite answer to the step.
        """
        try:
            jump = self.plan.once(Steps).jump(t, x, before, after, self.signals)
        except NoImpulse as none:
            raise Stopped(Status.UNSETTLED, str(none)) from None
        return x if jump is None else self._taken(t, x, jump)

    def _taken(self, t: float, x: np.ndarray, jump: Jump) -> np.ndarray:
        if jump.moved:
            self.records.append(Event(t, jump.name, STEP, f"{jump.before:.6g}", f"{jump.after:.6g}"))
        moved = jump.x.copy()
        if np.isfinite(jump.work):
            work, _ = self.plan.accounts
            if work >= 0:
                moved[work] += jump.work
        elif t < self.unbooked[0]:
            reason = f"the step of '{jump.name}' at t = {t:.6g} s makes a damper dissipate infinite power"
            self.unbooked = t, reason
            self.report.note("N0554", f"no energy ledger from then on: {reason}")
        return moved


def _times(plan: Plan, base: np.ndarray, signals: Mapping[int, Signal], span: tuple[float, float]) -> np.ndarray:
    """Return the times within a run, its start included, at which inputs step or bend whose derivatives are in use."""
    own = [signals[v] for v in stepping_inputs(plan, signals)]
    times = [s.jumps for s in own if isinstance(s, Table)]
    if any(isinstance(s, Formula) for s in own):
        times.append(kinks.break_times(plan, base, *span))
    every, near = np.concatenate([np.zeros(0), *times]), kinks.NEAR * max(abs(span[0]), abs(span[1]))
    inside = every[(every >= span[0] - near) & (every <= span[1] + near)]
    return np.unique(np.clip(inside, *span))  # what lies beside an end by rounding is at it
