"""Rows of an ensemble that C makes many at a time: checked and started together, with the bits of single runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.numerics.lanes import runs as lanes
from lmoc.numerics.lanes.scene import NotInLanes, Runs, refuse, sound
from lmoc.numerics.run.simulate import check_options
from lmoc.numerics.signals.signals import Constant, bind_signals
from lmoc.numerics.start.bases import bases
from lmoc.parameters import indexed
from lmoc.report.result import is_array
from lmoc.studies.job import Job

Series = dict[str, np.ndarray]


def rows_in_lanes(job: Job, rows: Sequence[int]) -> list[tuple[list[int], Series]]:
    """Return rows that come to their end in C, and their values over time {name: (rows, T) or (rows, T, m)}.

    All others are for `simulate`: rows that fail, whose reason it tells, and scenes that C cannot run by itself.
    """
    found = []
    for part in _alike(job, rows):
        try:
            with job.session.busy:
                found.append(_of_one_plan(job, part))
        except (NotInLanes, ModelError):  # what is wrong is told by `simulate`
            continue
    return found


def _alike(job: Job, rows: Sequence[int]) -> list[list[int]]:
    """Return the rows by the formulas of their inputs; numbers count as alike."""
    formulas = {name: s for name, s in job.rows.inputs.items() if not isinstance(s, np.ndarray)}
    if not formulas:
        return [list(rows)]
    parts: dict[tuple, list[int]] = {}
    for row in rows:
        own = [(name, signals[row]) for name, signals in formulas.items()]
        key = tuple((name, signal if isinstance(signal, (str, float, int)) else id(signal)) for name, signal in own)
        parts.setdefault(key, []).append(row)
    return list(parts.values())


def _of_one_plan(job: Job, rows: list[int]) -> tuple[list[int], Series]:
    session, options = job.session, job.options
    reduced, report = session.reduced, Report()
    span = check_options(options, reduced, report)
    values = _values(job, rows)
    initial, inputs = _initial(job, rows), job.rows.request(rows[0])["inputs"]
    simulator = session.simulator(reduced)
    signals = bind_signals(reduced.flat, inputs, report, simulator.orders, (span.start, span.end))
    report.check()
    if reduced.switched is not None or reduced.flat.events is not None:
        raise NotInLanes("laws or events")
    plan, system = simulator.system(signals, options.energy, report)
    refuse(plan, system, options)
    numbers = {
        variable: _numbers(job.rows.inputs[name], rows)
        for name, own in job.rows.inputs.items()
        if isinstance(own, np.ndarray)
        for variable in session.flat.find(name).tolist()
        if isinstance(signals.get(variable), Constant)
    }
    runs = Runs(plan, signals, numbers, values, bases(plan, values, signals, numbers))
    good = sound(runs) & session.flat.keeps_shape(values)
    good[good] = reduced.guards_hold(values[:, good])
    if not good.any():
        return [], {}
    runs, rows, initial = _chosen(runs, rows, initial, good)
    states, good = lanes.go(runs, system, options, span, initial)
    runs, rows, _ = _chosen(runs, rows, {}, good)
    states = states if good.all() else states[good]
    return rows, {name: _series(session.flat, runs, name, span.times, states) for name in job.names}


def _chosen(
    runs: Runs, rows: list[int], initial: dict[str, np.ndarray], good: np.ndarray
) -> tuple[Runs, list[int], dict[str, np.ndarray]]:
    """Return what belongs to the good ones among the runs."""
    if good.all():
        return runs, rows, initial
    numbers = {variable: own[good] for variable, own in runs.numbers.items()}
    chosen = Runs(runs.plan, runs.signals, numbers, runs.values[:, good], runs.base[good])
    kept = [row for row, fine in zip(rows, good.tolist(), strict=True) if fine]
    return chosen, kept, {name: own[good] for name, own in initial.items()}


def _values(job: Job, rows: Sequence[int]) -> np.ndarray:
    """Return parameter values (variables of the reduction, runs).

    Raises
    ------
    NotInLanes
        A parameter shapes the model, or is no real number.
    """
    session, flat = job.session, job.session.flat
    same, varied = job.rows.same["parameters"], job.rows.parameters
    for name in (*same, *varied):
        variables = flat.find(name)
        block = None if variables is None else flat.block_at(int(variables[0]))
        shapes = block is None or (block.structural and not block.conditional)
        if shapes or block.quantity in ("Integer", "Boolean", "String"):
            raise NotInLanes(f"'{name}' shapes the model, or is no real number")
    first = indexed(flat, {**flat.overrides, **job.rows.request(rows[0])["parameters"]})
    place = {variable: k for k, variable in enumerate(first)}
    given = np.fromiter(first, int, len(first))
    numbers = np.repeat(np.fromiter(first.values(), float, len(first))[:, None], len(rows), axis=1)
    for name, own in varied.items():
        numbers[[place[v] for v in flat.find(name).tolist()]] = _numbers(own, rows).reshape(len(rows), -1).T
    values = flat.parameter_values_of_runs(given, numbers)
    more = session.reduced.flat.count - flat.count
    return np.concatenate([values, np.full((more, len(rows)), np.nan)])


def _numbers(own: Sequence[object] | np.ndarray, rows: Sequence[int]) -> np.ndarray:
    try:
        return np.asarray(np.asarray(own)[list(rows)], float)
    except (TypeError, ValueError):
        raise NotInLanes("something is no number") from None


def _initial(job: Job, rows: Sequence[int]) -> dict[str, np.ndarray]:
    """Return {name: (runs,) or (runs, m)} of the start values, where these are numbers."""
    same = job.rows.same["initial"] or {}
    if not isinstance(same, Mapping):
        raise NotInLanes("the start is an equilibrium, or the end of another run")
    found = {}
    for name, value in same.items():
        if isinstance(value, str) or not isinstance(value, (int, float, np.ndarray, np.number)):
            raise NotInLanes("a start value is no number")
        found[name] = np.repeat(np.asarray(value, float)[None], len(rows), axis=0)
    found |= {name: _numbers(own, rows) for name, own in job.rows.initial.items()}
    if not all(np.isfinite(own).all() for own in found.values()):
        raise NotInLanes("a start value is not finite")
    return found


def _series(flat: FlatDAE, runs: Runs, name: str, times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return a variable over time, (runs, times) or (runs, times, m).

    Raises
    ------
    NotInLanes
        A run knows more of it than the flat model: it is a derivative.
    """
    variables = flat.find(name)
    if variables is None or name == "time" or not len(variables):
        raise NotInLanes(f"'{name}' is no variable of the model")
    found = runs.of(variables, times, states)
    return found if is_array(flat, name) else np.ascontiguousarray(found[:, :, 0])
