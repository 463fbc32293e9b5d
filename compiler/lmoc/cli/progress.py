"""What is shown of work that takes its time: a bar on a terminal after a second, else a line after some seconds."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from lmoc.cli import process
from lmoc.pipeline import BY_NAME

WAIT = 1.0  # seconds without a word
# seconds of work (not of waiting for a machine that is busy) after which a log is told that it goes on, and how much
# longer until it is told again
TOLD, RARER = 8.0, 4.0
_LOOK = 0.5  # seconds between two looks at the work


class Progress:
    """A line with the present stage, and a bar while simulated time advances; nothing where it is quick.

    Where nobody looks on, as in a log, a line says that long work goes on: what the command has worked since it said
    so last counts, whichever stages it was.
    """

    _told = 0.0  # s, what it had worked then

    def __init__(self, enabled: bool = True):
        self._enabled, self._seen = enabled, sys.stderr.isatty()
        self._stage = ""
        self._start = 0.0
        self._done: float | None = None
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        if self._enabled:
            self._thread = threading.Thread(target=self._draw if self._seen else self._tell, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join()

    def stage(self, name: str) -> None:
        """A stage begins."""
        self._stage, self._done = BY_NAME[name].label if name in BY_NAME else name, None

    def reached(self, simulated: float, stop: float) -> None:
        """The simulation has come to this time on its way to the stop."""
        if self._done is None:
            self._stage, self._start = "simulate", simulated
        self._done = (simulated - self._start) / (stop - self._start) if stop > self._start else 1.0

    def part(self, text: str, share: float) -> None:
        """One of many pieces of work begins, when this share of all is done."""
        self._stage, self._done = text, share

    def _tell(self) -> None:
        begin, limit = process.worked(), TOLD
        if Progress._told > begin:  # by a command before this one
            Progress._told = 0.0
        while not self._end.wait(_LOOK):
            now, done = process.worked(), self._done
            if now - Progress._told < limit:
                continue
            ahead = (now - begin) * (1 - done) / done if done else 0.0
            left = f", {100 * done:.0f} % done, about {ahead:.0f} s left" if done else ""
            sys.stderr.write(f"lmoc: {self._stage or 'the work'} goes on after {now:.0f} s{left}\n")
            sys.stderr.flush()
            Progress._told, limit = now, limit * RARER

    def _draw(self) -> None:
        if self._end.wait(WAIT):
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(self._stage, total=None)
            while not self._end.wait(0.1):
                known = self._done is not None
                bar.update(task, description=self._stage, total=1.0 if known else None, completed=self._done or 0.0)


@contextmanager
def working(stage: str) -> Iterator[None]:
    """One stage that takes its time."""
    with Progress() as progress:
        progress.stage(stage)
        yield
