"""How the runs of an ensemble are made: checked once, shared out in chunks, put together in their order."""

from __future__ import annotations

import pickle
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc import simulation
from lmoc.ir.names import UnknownNameError
from lmoc.messages.budgeted import budgeted
from lmoc.messages.diagnostics import Diagnostic, ModelError, RunInterrupted, SimulationError
from lmoc.report.units import unit_of
from lmoc.session import Session
from lmoc.simulation import Request
from lmoc.studies import workers as sharing
from lmoc.studies.ensemble import Chunk, Ensemble, joined
from lmoc.studies.job import Job
from lmoc.studies.lanes import rows_in_lanes
from lmoc.studies.rows import Row, reason_of, row_of

if TYPE_CHECKING:
    from lmoc.numerics.observe.event import Event
    from lmoc.run import Run
    from lmoc.studies.store import Store

_SECONDS = 0.5  # of work in a chunk, about
_LARGEST = 4096  # rows of a chunk
_IN_STORE = 64  # rows of a chunk in a store, of runs that are made one by one
_NUMBERS = 1_000_000  # states at output times in a chunk that is made in C
Progress = Callable[[int, int], None]  # (runs done, runs in all)


def run_rows(job: Job, rows: Sequence[int]) -> Chunk:
    """Make some of the runs: in C as far as that goes, the others one by one."""
    return _rows(job, rows, rows_in_lanes(job, rows))


def _rows(job: Job, rows: Sequence[int], done: Sequence[tuple[list[int], Mapping[str, np.ndarray]]]) -> Chunk:
    """Return rows, those that are done and the others."""
    places = {row: k for k, row in enumerate(rows)}
    reasons, events, others = [""] * len(rows), [()] * len(rows), dict(places)
    if len(done) == 1 and done[0][0] == list(rows):
        return _packed(job, dict(done[0][1]), reasons, events)
    series = {name: np.full((len(rows), len(job.times), *job.shapes[name]), np.nan) for name in job.names}
    for part, made in done:
        at = [places[row] for row in part]
        for name, values in made.items():
            series[name][at] = values
        for row in part:
            del others[row]
    for row, k in others.items():
        own = _run_row(job, row)
        for name, values in own.values.items():
            series[name][k] = values
        reasons[k], events[k] = own.reason, own.events if job.series else ()
    return _packed(job, series, reasons, events)


def _run_row(job: Job, row: int) -> Row:
    request = Request(job.options, **job.rows.request(row))
    try:
        run = _budgeted(job.session, request)
        return row_of(run, job.names, job.times, job.shapes, "")
    except (SimulationError, RunInterrupted, ModelError) as failure:
        reason, partial = reason_of(failure, job.rows)
        return row_of(partial, job.names, job.times, job.shapes, reason)
    except UnknownNameError as error:
        raise ModelError([Diagnostic("E0622", str(error))]) from None


@budgeted("the simulation")
def _budgeted(session: Session, request: Request) -> Run:
    return simulation.simulate(session, request)


def _packed(job: Job, series: dict[str, np.ndarray], reasons: list[str], events: list[tuple[Event, ...]]) -> Chunk:
    """Return runs with their summaries; over time only where that has been asked for."""
    summary = {}
    for what, of in (("minimum", np.fmin), ("maximum", np.fmax)):
        summary[what] = {name: of.reduce(values, axis=1) for name, values in series.items()}
    end = {name: np.ascontiguousarray(values[:, -1]) for name, values in series.items()}
    return Chunk(series if job.series else {}, end, reasons=tuple(reasons), events=tuple(events), **summary)


def run(job: Job, workers: Any = None, store: Store | None = None, progress: Progress | None = None) -> Ensemble:
    """Make all runs.

    Parameters
    ----------
    workers : number of threads, or a Client of dask
    store : where chunks are kept as they are done, and found again

    Raises
    ------
    ModelError
        What was asked for cannot be done. Runs that fail are rows with a reason.
    """
    count = job.rows.count
    client = workers if sharing.is_client(workers) else None
    threads = None if client else sharing.thread_count(workers, count)
    chunks: dict[int, Chunk] = {}
    if store is not None:
        size = store.size
    else:  # what a run costs is seen from the first one
        began = clock.perf_counter()
        done_in_c = rows_in_lanes(job, [0])
        chunks[0] = _rows(job, [0], done_in_c)
        size = int(min(max(_SECONDS / (clock.perf_counter() - began), 1), _LARGEST))
        if any(part for part, _ in done_in_c):
            size = _together(job)
        if threads != 1:  # several chunks for each, so that they come to their end together
            size = max(1, min(size, -(-count // (4 * (threads or 1)))))
    starts = [0, *range(1, count, size)] if store is None else list(range(0, count, size))
    ends = [*starts[1:], count]
    if store is not None:
        chunks = {k: found for k in range(len(starts)) if (found := store.read(k)) is not None}
    done = sum(ends[k] - starts[k] for k in chunks)
    left = [k for k in range(len(starts)) if k not in chunks]
    parts = [range(starts[k], ends[k]) for k in left]
    if progress is not None:
        progress(done, count)
    for k, chunk in _shared(job, parts, client, threads):
        if store is not None:
            store.write(left[k], chunk)
        chunks[left[k]] = chunk
        done += len(parts[k])
        if progress is not None:
            progress(done, count)
    rows = job.rows
    given = {**rows.parameters, **rows.initial, **{n: v for n, v in rows.inputs.items() if isinstance(v, np.ndarray)}}
    units = {name: unit_of(job.session.reduced, name) for name in (*job.names, *given)}
    flat_name = job.session.flat.name
    return joined(flat_name, job.times, given, units, [chunks[k] for k in range(len(starts))])


def rows_of_a_chunk(job: Job) -> int:
    """Return how many runs a store keeps in a file: more where C makes them, so that files are not most of the work."""
    in_c = any(part for part, _ in rows_in_lanes(job, [0])) if job.rows.count else False
    return max(_IN_STORE, _together(job)) if in_c else _IN_STORE


def _together(job: Job) -> int:
    """Return how many runs C starts together: that costs little more than one, but memory."""
    return max(1, min(_LARGEST, _NUMBERS // (len(job.times) * max(1, len(job.session.reduced.states)))))


def _shared(job: Job, parts: Sequence[range], client: Any, threads: int | None) -> Iterator[tuple[int, Chunk]]:
    """Yield chunks as they are done."""
    if not parts:
        return
    if client is not None:
        yield from sharing.on_dask(parts, client, job, run_rows)
        return
    own = [job, *copies(job, min(threads or 1, len(parts)) - 1)]
    yield from sharing.on_threads(parts, [_work(each) for each in own])


def copies(job: Job, count: int) -> list[Job]:
    """Return jobs with scenes of their own, each for another thread: a scene has one set of buffers."""
    if not count:
        return []
    packed = pickle.dumps(job.session)
    return [replace(job, session=pickle.loads(packed)) for _ in range(count)]  # noqa: S301


def _work(job: Job) -> Callable[[Sequence[int]], Chunk]:
    return lambda part: run_rows(job, part)
