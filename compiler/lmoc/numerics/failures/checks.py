"""The model's assertions over the output times, where `assertions` has not watched them on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Check
from lmoc.messages.diagnostics import Report, SimulationError
from lmoc.numerics.failures.assertions import broken
from lmoc.numerics.failures.onset import onset
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory


def run_checks(run: Trajectory, watched: bool = False) -> Trajectory:
    """Evaluate the assertions; warnings become notes of the run.

    Those about parameters alone that are errors have been judged before it (`lmoc.semantics.parameter_checks`).

    Parameters
    ----------
    watched : whether those that depend on the motion have been watched on the way (`failures.assertions`)

    Raises
    ------
    SimulationError
        At the first output time at which an assertion of level error does not hold; the partial result ends there.
    """
    flat = run.flat
    if not flat.checks or not len(run.time):
        return run
    report = Report()
    failures: list[tuple[int, Check, int]] = []
    for check in flat.checks:
        constant = check in flat.constant_checks
        if check.at_events or (check.error if constant else watched):
            continue
        holds = _holds(run, check)
        times, rows = np.nonzero(~holds.T) if holds.size else (np.zeros(0, int), np.zeros(0, int))
        if not len(times):
            continue
        if check.error:
            failures.append((int(times[0]), check, int(rows[0])))
        else:
            message, since = flat.message_of(check, int(rows[0])), _since(run, check, int(times[0]), int(rows[0]))
            report.warning("W0551", f"{message} (from t = {since:.9g} s)", check.span)
    if failures:
        k, check, row = min(failures, key=lambda f: f[0])
        partial = run.until(k + 1)
        since = _since(run, check, k, row)
        raise SimulationError(broken(flat, check, row, since), since, partial)
    return replace(run, notes=run.notes + tuple(report.diagnostics), _cache={}) if report.diagnostics else run


def _since(run: Trajectory, check: Check, index: int, row: int) -> float:
    """Return since when one row of an assertion does not hold that is seen not to at an output time."""
    slots = check.slots[row]
    used, place = np.unique(slots, return_inverse=True)

    def holds(segment: SegmentRecord, t: float, x: np.ndarray) -> bool:
        values = segment.observer(used, np.array([t]), x[None])[0][place]
        return bool(np.all(evaluate(check.condition, lambda k, _: values[k], t)))

    return onset(run, index, holds)


def _holds(run: Trajectory, check: Check) -> np.ndarray:
    """(rows, times) of logical values, one time for all where none matters; what has no value is not judged."""
    if check in run.flat.constant_checks:
        values = run.observer.values
        return (check.holds(values) | ~np.isfinite(values[check.slots]).all(axis=1))[:, None]
    used, place = np.unique(check.slots, return_inverse=True)
    place = place.reshape(check.slots.shape)
    values = run.of(used).T
    result = evaluate(check.condition, lambda k, _: values[place[:, k]], run.time)
    result = np.asarray(np.broadcast_to(result, (len(check.slots), len(run.time))), float)
    known = np.isfinite(values)[place].all(axis=1) if place.size else np.ones(result.shape, bool)
    return (result != 0) | ~known
