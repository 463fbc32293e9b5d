"""What is going on, on a terminal, when it takes more than a second."""

from __future__ import annotations

import sys
import threading
import time

WAIT = 1.0  # seconds without a word


class Progress:
    """A line with the present stage, and a bar while simulated time advances; nothing where it is quick or not seen."""

    def __init__(self, enabled: bool = True):
        self._enabled = enabled and sys.stderr.isatty()
        self._stage = ""
        self._range = (0.0, 1.0)
        self._done: float | None = None
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        if self._enabled:
            self._thread = threading.Thread(target=self._draw, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join()

    def stage(self, name: str) -> None:
        """A stage begins."""
        self._stage, self._done = name, None

    def span(self, start: float, stop: float) -> None:
        """The simulated time that lies ahead."""
        self._range = (start, stop)

    def reached(self, simulated: float) -> None:
        """The simulation has come to this time."""
        start, stop = self._range
        self._done = (simulated - start) / (stop - start)

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
                time.sleep(0)
