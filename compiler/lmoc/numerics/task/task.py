"""The data shared by all segments of a run, and one segment in progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.recorder import Recorder
from lmoc.numerics.observe.trajectory import SegmentRecord
from lmoc.numerics.options.options import RunOptions, TimeSpan
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.task.sizes import Sizes
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.coordinates.change import RunState
    from lmoc.numerics.coordinates.watch import CoordinateWatch
    from lmoc.numerics.events.occasion import Occasion
    from lmoc.numerics.formulations.watch import LoopWatch
    from lmoc.numerics.problem.mode import Mode

Progress = Callable[[float, float], None]  # (time reached, stop time)


class Coordinates(Protocol):
    """The same model with other coordinates."""

    def system(self, states: Sequence[str], signals: Mapping[int, Signal], energy: bool) -> tuple[Plan, System] | None:
        """Return the plan and the system with some variables as states; None where they cannot be."""

    def of_loops(self, signals: Mapping[int, Signal], energy: bool) -> tuple[Plan, System] | None:
        """Return the same with all coordinates of the loops as states."""

    def leaving_out_others(
        self, current: Reduced, place: Mapping[str, float], signals: Mapping[int, Signal], energy: bool
    ) -> Iterator[tuple[Plan, System]]:
        """Yield plans and systems that take other constraints for the redundant ones."""


@dataclass(frozen=True, eq=False)
class Task:
    """The data shared by all segments of a run.

    Attributes
    ----------
    values : (flat.count,) parameter values
    signals : by flat variable
    report : collects what there is to say
    others : the model with other coordinates, where there may be some
    near : where the start is looked for: the end of the way there from a simplified model; None without one
    sizes : how large the motion is, as far as it is known
    occasions : takes the instants at which something happens; None where nobody asks
    clock : values of `time.perf_counter` when the run was requested, and when its system was ready
    """

    values: np.ndarray
    signals: Mapping[int, Signal]
    options: RunOptions
    span: TimeSpan
    report: Report
    progress: Progress | None
    others: Coordinates | None
    clock: tuple[float, float]
    near: RunState | None = None
    sizes: Sizes = field(default_factory=dict)
    occasions: list[Occasion] | None = None


class Segment:
    """A segment under way.

    Attributes
    ----------
    begin : s
    first : number of output times that lie before it
    mode, rounding : of the laws, as in `SegmentRecord`
    largest : (n,) the magnitude of each state at the steps; None where they were not looked at
    watch : judges its coordinates; None where their choice never divides by anything that changes
    loops : watches over its closures; None in minimal coordinates
    """

    def __init__(
        self, observer: Observer, system: System, begin: float, times: np.ndarray, first: int, variables
    ) -> None:
        self.observer, self.system, self.begin, self.first = observer, system, begin, first
        self.plan, self.base = observer.plan, observer.base
        self.recorder = Recorder(observer, times[first:], variables)
        self.watch: CoordinateWatch | None = None
        self.mode: Mode | None = None
        self.largest: np.ndarray | None = None
        self.rounding: np.ndarray | None = None
        self.loops: LoopWatch | None = None

    @property
    def reached(self) -> int:
        """Number of output times behind."""
        return self.first + self.recorder.reached

    def take_path(self) -> None:
        """Let variables be read along the way that its watch has seen so far."""
        if self.watch is not None:
            self.observer.path = self.watch.path

    def record(self, outcome: Outcome | None = None) -> SegmentRecord:
        """Return what it has given; where it failed behind its last output time, with the place reached."""
        times, table = self.recorder.taken()
        failed = outcome is not None and outcome.status.failed and np.isfinite(outcome.x).all()
        if failed and outcome.time > (times[-1] if len(times) else -np.inf):
            times = np.append(times, outcome.time)
            table = np.vstack([table, self.recorder.kept(times[-1:], outcome.x[None])])
        self.take_path()
        sampled = self.recorder.sampled()
        return SegmentRecord(self.observer, self.begin, times, table, sampled, self.mode, self.largest, self.rounding)


class Cost:
    """The accumulated cost of the segments of a run.

    Attributes
    ----------
    stats : for the statistics of the run
    """

    def __init__(self) -> None:
        self.stats: dict[str, object] = {"solver": "", "reason": "", "evaluations": 0}

    def add(self, outcome: Outcome, system: System, solver: str, reason: str) -> Outcome:
        """Count an integration; returns its outcome."""
        stats = self.stats
        counts = {"evaluations": system.evaluations} | outcome.counts
        system.evaluations = 0
        stats |= {key: stats.get(key, 0) + value for key, value in counts.items()}
        used = dict.fromkeys([*filter(None, str(stats["solver"]).split(", ")), *solver.split(", ")])
        if len(used) > 1:
            used.pop("none", None)  # a segment without extent or states, beside others
        stats["solver"] = ", ".join(used)
        stats["reason"] = stats["reason"] or reason
        stats["evaluation"] = outcome.evaluation or stats.get("evaluation") or system.description
        stats["matrix"] = outcome.matrix or stats.get("matrix", "")
        return outcome
