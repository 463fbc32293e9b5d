"""Threads, and workers of Dask, among which the runs of an ensemble are shared out."""

from __future__ import annotations

import os
import pickle
import threading
from collections.abc import Callable, Iterator, Sequence
from contextvars import copy_context
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from lmoc.support import budget

Done = TypeVar("Done")
Work = Callable[[Sequence[int]], Done]  # makes the rows of these numbers
_FEW = 16  # rows for which no scene is copied
_HEARTBEAT = 1.0  # s


def thread_count(workers: object, rows: int) -> int:
    """Return how many threads share the rows.

    Raises
    ------
    ValueError
        The number of workers is not a positive whole number.
    """
    if workers is None:
        affinity = getattr(os, "sched_getaffinity", None)
        available = len(affinity(0)) if affinity else os.cpu_count() or 1
        return available if rows > _FEW else 1
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ValueError(f"workers is a positive number of threads, or a Client of dask; found {workers!r}")
    return min(workers, rows)


def on_threads(parts: Sequence[Sequence[int]], works: Sequence[Work[Done]]) -> Iterator[tuple[int, Done]]:
    """Yield (number of the part, what has been made of it) as parts are done, one thread for each of `works`.

    What one of them raises is raised here, and the others end behind the part that they are at. An interruption ends
    here at once: what has been yielded is whole.
    """
    if len(works) == 1:
        for k, part in enumerate(parts):
            yield k, works[0](part)
        return
    waiting: SimpleQueue[int] = SimpleQueue()
    for k in range(len(parts)):
        waiting.put(k)
    done: SimpleQueue[tuple[int, Done | None, BaseException | None]] = SimpleQueue()
    over = threading.Event()

    def go(work: Work[Done]) -> None:
        while not over.is_set():
            try:
                k = waiting.get_nowait()
            except Empty:
                return
            try:
                done.put((k, work(parts[k]), None))
            except BaseException as error:
                done.put((k, None, error))
                return

    for work in works:
        threading.Thread(target=copy_context().run, args=(go, work), daemon=True, name="lmoc ensemble").start()
    try:
        for heard in range(len(parts)):
            k, made, failure = _next(done, heard)
            if failure is not None:
                raise failure
            yield k, made  # type: ignore[misc]
    finally:
        over.set()


def _next(done: SimpleQueue[Any], heard: int) -> Any:
    """Return what is done next; every run has a budget of its own, so that waiting for it needs none."""
    beats = 0
    while True:
        try:
            return done.get(timeout=_HEARTBEAT)
        except Empty:
            beats += 1
            budget.moved_on(f"part {heard}, {beats}")


def is_client(workers: object) -> bool:
    """Return whether something is a Client of dask.distributed, without importing it."""
    return type(workers).__module__.partition(".")[0] == "distributed" and hasattr(workers, "submit")


def on_dask(
    parts: Sequence[Sequence[int]], client: Any, data: object, work: Callable[[object, Sequence[int]], Done]
) -> Iterator[tuple[int, Done]]:
    """Yield what `on_threads` does, made by the workers of a cluster.

    The data travel once to each worker. A part whose worker dies is made by another one.

    Parameters
    ----------
    data : is pickled, and given to `work` as it is unpickled in the worker, once
    work : called with the data and a part
    """
    from distributed import as_completed

    packed = pickle.dumps(data)
    sent = client.scatter(packed, broadcast=True, hash=False)
    futures = {client.submit(_in_worker, work, sent, part, pure=False): k for k, part in enumerate(parts)}
    try:
        for heard, future in enumerate(as_completed(list(futures))):
            budget.moved_on(f"part {heard}")
            yield futures[future], future.result()
    finally:
        client.cancel(list(futures))


_here = threading.local()


def _in_worker(work: Callable[[object, Sequence[int]], Done], packed: bytes, part: Sequence[int]) -> Done:
    """Make a part in a worker; each of its threads keeps what has been unpickled last."""
    if getattr(_here, "packed", None) is not packed:
        _here.packed, _here.data = packed, pickle.loads(packed)  # noqa: S301  (from the user's own process)
    return work(_here.data, part)
