"""Reports about one segment of a run: values that are not finite, and the reason why the run has stopped."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Report, Subject
from lmoc.numerics.coordinates.change import block_unknowns
from lmoc.numerics.failures.diagnosis import fastest, first_not_finite, lost_ahead, moving_risks, suspects, unsolved
from lmoc.numerics.observe.trajectory import SegmentRecord
from lmoc.numerics.options.options import TimeSpan
from lmoc.numerics.problem.base import Outcome
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System
from lmoc.numerics.start.singular import BESIDE, StartSingular, starts_singular
from lmoc.numerics.task.task import Segment
from lmoc.structure.messages.equations import SHOWN

if TYPE_CHECKING:
    from lmoc.numerics.run.changes import Changes

_SLOW = (Status.TOO_MANY_STEPS, Status.TOO_LONG, Status.INTERRUPTED, Status.SPENT, Status.CRAWLING)
_GROWN = 1e6  # times its size in the first half: what grows so has left the scale of the scene


def check_start(segment: Segment, time: float, x: np.ndarray, report: Report) -> None:
    """Check that all derivatives are finite at the start.

    Equations that no derivative needs must have a solution too. Of their other values, those that are not finite
    cause a warning only, since the motion does not depend on them.

    Raises
    ------
    StartSingular
        A derivative is not finite, or nonlinear equations have no solution.
    """
    hint = "look at the start values, and at divisions by zero"
    derivative = np.empty(len(x))
    segment.system.rhs(time, x, derivative)
    needed = not (np.isfinite(derivative).all() and np.isfinite(x).all())
    program = None if needed else segment.plan.full_program
    near = segment.system.registers
    if near is not None and not needed:  # what is read later goes on from the solutions that the motion begins with
        unknowns = segment.plan.once(block_unknowns)
        segment.base[unknowns] = near[unknowns]
    found, span, nonlinear = first_not_finite(segment.observer, time, x, program, near, near is not None)
    if needed or nonlinear:
        singular = starts_singular(segment, time, x) if np.isfinite(x).all() else ""
        if singular:
            found, hint = f"{singular}: {found}", BESIDE
        elif nonlinear:
            hint = "give start values (start = …) near a place where they hold, such as the angles of an assembled loop"
        asked = _initial_equations(segment)
        if asked:
            hint = f"perhaps the model does not allow {asked}; {hint}"
        report.error("E0535", f"{found} at the start", span, hint=hint)
        raise StartSingular(report.diagnostics, segment.plan.reduced.state_names, span)
    if found:
        report.warning("W0537", f"{found} at the start", span, hint=hint, subject=Subject.NOT_FINITE)


def _initial_equations(segment: Segment) -> str:
    """Return the initial equations of a scene with their lines, for a hint; empty where it has none."""
    flat = segment.plan.reduced.flat
    rows = [(group, row) for group in flat.initial_groups for row in range(group.rows)]
    texts = []
    for group, row in rows[:SHOWN]:
        line = "" if group.span is None else f" in line {group.span.line}"
        texts.append(f"`{flat.row_text(group, row)}`{line}")
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    return f"the initial equation{'s' * (len(rows) > 1)} {', '.join(texts)}{more}" if rows else ""


def check_values(segment: Segment, outcome: Outcome, everything: bool, report: Report) -> None:
    """Warn of values that have become NaN during a segment, such as a square root, where the motion does not need them.

    Parameters
    ----------
    everything : whether the states at all output times have been kept, not only some variables
    """
    recorder = segment.recorder
    times, _ = recorder.taken()
    if report.says(Subject.NOT_FINITE) or not len(times):
        return
    rows = suspects(segment.observer, times, recorder.table) if everything else np.zeros(0, int)
    risks = segment.plan.once(moving_risks)
    if risks.others or (len(risks.registers) and not everything):
        rows = np.append(rows, len(times) - 1)
    for k in rows.tolist():
        time, x, near = float(times[k]), None, None
        if k == len(times) - 1:
            time, x, near = outcome.time, outcome.x, registers_at_end(segment.system, outcome)
        else:
            x = recorder.table[k]
        known, program = near is not None, segment.plan.full_program
        found, span, nonlinear = first_not_finite(segment.observer, time, x, program, near, known)
        if found and not nonlinear:  # nonlinear equations are solved along the motion, not from their start
            report.warning("W0537", f"{found} at t = {times[k]:g} s", span, subject=Subject.NOT_FINITE)
            return

    segment.take_path()
    without = unsolved(segment.observer, *recorder.sampled())
    if without is not None:
        sentence, span, time = without
        report.warning("W0537", f"{sentence} at t = {time:g} s", span, subject=Subject.NOT_FINITE)


def registers_at_end(system: System, outcome: Outcome) -> np.ndarray | None:
    """Return the registers where an integration has ended; None where the system does not keep them."""
    rate = np.empty(len(outcome.x))
    if system.registers is None:
        return None
    count = system.evaluations
    system.rhs(outcome.time, outcome.x, rate)
    system.evaluations = count
    return system.registers if np.isfinite(rate).all() else None


def explanation(
    segment: Segment,
    outcome: Outcome,
    span: TimeSpan,
    segments: Sequence[SegmentRecord],
    sizes: np.ndarray | None,
    known: str,
) -> str:
    """Return the sentence about a run that has stopped early.

    Parameters
    ----------
    segments : of the run
    sizes : (n,) magnitudes of the states; None where nothing has been integrated
    known : the reason, where it is known better than from the status
    """
    place = segment.observer, segment.system, outcome.time, outcome.x
    found = ""
    if not known and outcome.status in (Status.NOT_FINITE, Status.COLLAPSED):
        found = lost_ahead(*place, span.end)
    if not known and not found and outcome.status is Status.COLLAPSED and sizes is not None:
        found = fastest(*place, sizes, span.end - span.start)
    if not known and outcome.status in _SLOW:
        found = "; ".join(filter(None, (pace(outcome), growth(segments, outcome))))
    detail = f": {found}" if found else ""
    return f"the run stopped at t = {outcome.time:.6g} s of {span.end:g} s: {known or outcome.status.value}{detail}"


def pace(outcome: Outcome) -> str:
    """Describe the steps of a run that needs too many of them; empty where it has ended for another reason."""
    if outcome.status not in (Status.TOO_MANY_STEPS, Status.SPENT, Status.CRAWLING) or not np.isfinite(outcome.step):
        return ""
    return f"the last ones are {outcome.step:.2g} s long"


def growth(segments: Sequence[SegmentRecord], outcome: Outcome) -> str:
    """Describe the state that has left all scale: how much larger it is than in the first half; empty if none has."""
    last = segments[-1]
    alike = [p for p in segments if p.coordinates == last.coordinates]
    times = np.concatenate([p.samples[0] for p in alike])
    n = len(last.coordinates)
    if not len(times):
        return ""
    early = np.concatenate([np.abs(p.samples[1][:, :n]) for p in alike])[times <= (times[0] + outcome.time) / 2]
    before, now = early.max(axis=0, initial=0.0), np.abs(outcome.x[:n])
    grown = np.flatnonzero((now > _GROWN * before) & (before > 0.0))
    if not len(grown):
        return ""
    k = int(grown[(now[grown] / before[grown]).argmax()])
    return f"{last.coordinates[k]} has grown to {outcome.x[k]:.3g} from at most {before[k]:.3g} in the first half"


def note_coordinates(segments: Sequence[SegmentRecord], changes: Changes | None, report: Report) -> None:
    """Report how often coordinates have changed, and between which, and which singular positions were passed.

    Parameters
    ----------
    changes : None where the coordinates could not have changed
    """
    names = [tuple(p.coordinates) for p in segments]
    count = sum(a != b for a, b in pairwise(names))
    if count:
        sets = "; ".join(", ".join(n) for n in dict.fromkeys(names))
        often = "once" if count == 1 else f"{count} times"
        report.note("N0632", f"coordinates changed {often}, between {sets}")
    if changes is None:
        return
    if changes.together is not None:
        begin, end = changes.together, changes.returned
        when = f"from t = {begin:.6g} s on" if end is None else f"from t = {begin:.6g} s to {end:.6g} s"
        report.note("N0635", f"all coordinates of the loops were integrated {when}: few changed often")
    if changes.passed:
        passed = changes.passed
        often = "a singular position was" if len(passed) == 1 else f"{len(passed)} singular positions were"
        first = f"at t = {passed[0]:.6g} s" if len(passed) == 1 else f"the first at t = {passed[0]:.6g} s"
        report.note("N0633", f"{often} passed, {first}: the motion goes on with continuous velocities")
