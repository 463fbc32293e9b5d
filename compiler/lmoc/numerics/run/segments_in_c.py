"""Segments that laws or events end, in C one after the other (``engine/c/segments.h``), as far as all is as usual.

Usual is that few steps along a Taylor series lead to a root, or to a time event, and that there is one answer to what
happens there. A segment of another kind, and the last one of a run, are left to Python, which finds all as it was where
that has begun.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.segments import Method, Segments
from lmoc.engine.step_functions import Watched
from lmoc.lower.series import LENGTH
from lmoc.numerics.coordinates.change import all_unknowns
from lmoc.numerics.evaluate.function import programs, watched
from lmoc.numerics.evaluate.taylor_system import TaylorSystem
from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
from lmoc.numerics.failures.chatter import jumps
from lmoc.numerics.failures.diagnosis import moving_risks
from lmoc.numerics.limits import FINEST
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.trajectory import SegmentRecord
from lmoc.numerics.plan.activity import pulsing
from lmoc.numerics.plan.kinks import switches
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import Programs
from lmoc.numerics.run.one_segment import SegmentSolver
from lmoc.numerics.steps.automatic import TRIAL
from lmoc.numerics.steps.taylor import order_for
from lmoc.numerics.task.task import Segment, Task


def is_plain(plan: Plan) -> bool:
    """Return whether nothing but laws or events is to be looked at along a segment; to be asked for by `Plan.once`."""
    reduced, risks = plan.reduced, plan.once(moving_risks)
    return (
        (reduced.switched is None) != (reduced.flat.events is None)
        and reduced.constraints is None
        and not reduced.in_all_coordinates
        and len(plan.states) > 0
        and not len(plan.sampled)
        and not len(plan.once(all_unknowns))
        and not any(plan.once(found) for found in (switches, pulsing, jumps))
        and not (len(risks.registers) or risks.others)
    )


def through_segments(
    task: Task, segment: Segment, solver: SegmentSolver, now: HybridDynamics, variables: np.ndarray | None
) -> ThroughSegments | None:
    """Return what goes through segments of a run; None where each of them is looked at in Python.

    Parameters
    ----------
    variables : that are kept; None for the states
    """
    if not segment.plan.once(is_plain) or task.occasions is not None or now.stepping.next < np.inf:
        return None
    found = _functions(now)
    if found is None or not solver.along_series(segment):
        return None
    own, read = found
    tapes = [kernel.tape for kernel, _ in (*segment.system.programs(), *read)]
    tapes += [] if now.laws is None else now.laws.kinematics.scene.tapes
    if any(block.pattern is not None for tape in tapes for block in tape.blocks):
        return None  # pivots are of the place where they were chosen, which a segment that is made again has changed
    return ThroughSegments(task, segment, solver, now, variables, own, read)


def _functions(now: HybridDynamics) -> tuple[Watched | None, Programs] | None:
    """Return what ends segments by a root, and the programs that tell of it; None where C does not know them all."""
    laws, handler = now.laws, now.handler
    if laws is not None:
        read = laws.reader(now.base(), now.signals)
        own = watched(read, 0, laws=laws.run.address)
        return None if own is None or laws.kinematics.in_c is None else (own[0], programs(read))
    assert handler is not None
    if not handler.goes_on_in_c:
        return None
    roots = handler.roots
    if roots is None:
        return None, ()
    return None if roots.in_c is None else (roots.in_c[0], programs(handler.discrete.zeros_in_c))


class ThroughSegments:
    """Goes through segments of a run that have one plan.

    Parameters
    ----------
    own, read : what ends segments by a root, and the programs that tell of it
    """

    def __init__(
        self,
        task: Task,
        segment: Segment,
        solver: SegmentSolver,
        now: HybridDynamics,
        variables: np.ndarray | None,
        own: Watched | None,
        read: Programs,
    ) -> None:
        self.task, self.system, self.solver, self.now, self.variables = task, segment.system, solver, now, variables
        self.series, n = segment.system.with_series(TaylorSystem), segment.system.n
        self._atol, self._rtol = np.zeros(n), max(solver.tolerances.rtol, FINEST)
        memory = np.zeros((2, n)), np.zeros((2, n, LENGTH))
        self._walk = walk = self.series.new_walk(task.span.end, np.inf, self._rtol)
        walk.atol, walk.between, walk.x = (a.ctypes.data for a in (self._atol, *memory[0]))
        walk.q, walk.next = (a.ctypes.data for a in memory[1])
        ((_, rates),) = segment.system.programs()
        self._order = order_for(self._rtol)
        series = self.series.with_series(self._order)
        method = Method(ctypes.addressof(series), ctypes.addressof(walk), rates)
        every, count = (*self.series.programs(), *segment.system.programs(), *read), segment.plan.count
        laws = None if now.laws is None else (now.laws.run.in_c, now.laws.mode_registers)
        events = None if now.handler is None else now.handler.in_c
        self._in_c = Segments(method, own, laws, events, every, count)
        self._kept = memory

    def __call__(
        self, segment: Segment, x: np.ndarray, longest: float, count: Callable[[float, object], None]
    ) -> tuple[list[SegmentRecord], Segment, float, np.ndarray]:
        """Go on from where a segment begins.

        Parameters
        ----------
        longest : s, the longest step
        count : takes the time of each instant, and all events so far

        Returns
        -------
        what has been, the last segment of it, and time and states behind it
        """
        now, task, recorder, began = self.now, self.task, segment.recorder, segment
        self._walk.longest, self._atol[:] = min(longest, now.longest_step), self.solver.tolerances.absolute(segment, x)
        self.series.with_series(self._order)
        table = np.empty((len(recorder.times), len(x)))
        span, output = (task.span.start, task.span.end), (recorder.times, table, 0, recorder.reached)
        past = self._in_c.go((segment.begin, x), span, now.passed, now.open, output, TRIAL)
        records, first, time = [], 0, segment.begin
        for k, mode in enumerate(now.pass_by(past)):
            time, last = float(past.ended[k]), int(past.until[k])
            segment.largest = past.largest[k] if self._in_c.is_watched else None
            segment.recorder.reached = min(segment.recorder.reached, last - first)
            done = segment.recorder.reached
            if first + done < last:
                segment.recorder(done, table[first + done : last])
            count(time, now.records)
            records.append(segment.record())
            if k + 1 < past.passed:
                observer = Observer(segment.plan, task.values, past.base[k + 1], now.signals)
                segment = Segment(observer, self.system, time, task.span.times, began.first + last, self.variables)
                segment.mode, segment.rounding = (None, None) if mode is None else mode
                first = last
        if records:
            x = past.states[-1]
            self.series.evaluations += past.evaluations
            self.system.evaluations += past.evaluations
            counts = {"steps": past.steps, "rejected": past.rejected}
            self.solver.count_series(Outcome(time, x, 0, Status.ROOT, counts), self.system)
        return records, segment, time, x
