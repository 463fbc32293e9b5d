"""Checks in a process of their own, so that typing is never slowed by them.

One check runs at a time, that of the newest text first. A newer text of the same file takes the place of one that
waits, and of one that runs, which is given up after the model that is being checked; for a text of another file it is
put off, and goes on behind that one with the models that are left. A model that takes longer than its budget ends the
process, and that is said beside what has been found until then. What a long check has found is delivered as it comes,
with how many models are still to be checked.
"""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from lmoc.editor.checking import Checked, Checks, Finding, Part, Stopped
from lmoc.support.records import dataclass

BUDGET = 30.0  # s
PATIENCE = 5.0  # s that a model is checked when there is a newer text: with a process goes all that it has checked
EVERY = 1.0  # s between two deliveries of the same text
_MOVES, _PART, _STOP = "moves on", "part", "stop"


@dataclass(frozen=True)
class Request:
    """A text to check."""

    path: str
    text: str
    version: int | None


Deliver = Callable[[Request, Checked], None]


class Checker:
    """Checks texts one after the other and delivers what it finds, from a thread of its own.

    Parameters
    ----------
    deliver : called for every text that has been checked and that is still the newest of its file
    budget : s, for one model
    """

    def __init__(self, deliver: Deliver, budget: float = BUDGET) -> None:
        self._deliver, self._budget = deliver, budget
        self._waiting: dict[str, Request] = {}
        self._running: Request | None = None
        self._overtaken = False  # another file was asked for since
        self._wake = threading.Condition()
        self._closed = False
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._thread = threading.Thread(target=self._work, daemon=True, name="lmoc-checks")
        self._thread.start()

    def ask(self, request: Request) -> None:
        """Have a text checked, instead of an older one of its file."""
        with self._wake:
            self._waiting.pop(request.path, None)
            self._waiting[request.path] = request
            self._overtaken |= self._running is not None and self._running.path != request.path
            self._wake.notify()

    def forget(self, path: str) -> None:
        """A file is closed: nothing is said of it any more."""
        with self._wake:
            self._waiting.pop(path, None)
            if self._running is not None and self._running.path == path:
                self._running = None

    def close(self) -> None:
        """End the process."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        self._end_process()

    # ------------------------------------------------------------------ the thread

    def _work(self) -> None:
        while True:
            with self._wake:
                while not self._waiting and not self._closed:
                    self._wake.wait()
                if self._closed:
                    return
                _, request = self._waiting.popitem()
                self._running, self._overtaken = request, False
            found = self._checked(request)
            with self._wake:
                current = self._is_newest(request)
                self._running = None
                if found is None and current:  # put off
                    self._waiting = {request.path: request, **self._waiting}
            if found is not None and current:
                self._deliver(request, found)

    def _is_newest(self, request: Request) -> bool:
        with self._wake:
            return self._running is request and request.path not in self._waiting and not self._closed

    def _checked(self, request: Request) -> Checked | None:
        """The outcome; None where a newer text has come in the meantime."""
        try:
            pipe = self._connected()
            pipe.send((request.text, request.path))
            waited, told, part = 0.0, False, Checked((), ())
            while True:
                while not pipe.poll(0.05):
                    waited += 0.05
                    newer = self._closed or request.path in self._waiting
                    if (newer or self._overtaken) and not told:
                        pipe.send(_STOP)
                        waited, told = 0.0, True
                    if self._closed or newer and waited > PATIENCE:
                        self._end_process()
                        return None
                    if waited > self._budget:
                        self._end_process()
                        return _without_end(self._budget, part)
                kind, answer = pipe.recv()
                if kind == _PART:
                    part = answer
                    if self._is_newest(request):
                        self._deliver(request, replace(part, findings=(*part.findings, _still(part))))
                elif kind != _MOVES:
                    break
                waited = 0.0
        except (OSError, EOFError):  # the process has died: of memory, say
            self._end_process()
            return None if self._closed else _failed("the process that checks this file has ended")
        return _failed(answer) if isinstance(answer, str) else answer

    def _connected(self) -> Connection:
        if self._process is None or not self._process.is_alive() or self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, far = context.Pipe()
            self._process = context.Process(target=_serve, args=(far,), daemon=True)
            self._process.start()
            far.close()
        return self._pipe

    def _end_process(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.terminate()


def _serve(pipe: Connection) -> None:
    """The work of the process: a text in, what is found out."""
    checks, told = Checks(), 0.0

    def tell(part: Part) -> None:
        nonlocal told
        if time.monotonic() - told >= EVERY:
            pipe.send((_PART, part()))
            told = time.monotonic()

    def go_on() -> bool:
        pipe.send((_MOVES, None))
        return not pipe.poll()

    while True:
        try:
            asked = pipe.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        if asked == _STOP:
            continue  # that had ended in the meantime
        answer: Checked | str | None
        try:
            text, path = asked
            told = time.monotonic()
            answer = checks.check(text, path, go_on, tell)
        except Stopped:
            answer = None
        except Exception as error:  # a mistake of lmoc's: said in the editor, not lost in a process
            answer = f"lmoc itself failed: {type(error).__name__}: {error}"
        pipe.send(("answer", answer))


def _failed(what: str) -> Checked:
    return Checked((Finding("E0665", "error", what, None, "", "", "please report it with the file", ()),), ())


def _still(part: Checked) -> Finding:
    message = f"{part.left} of {part.models} models of this file are still being checked"
    return Finding("N0670", "note", message, None, "", "", "", ())


def _without_end(budget: float, part: Checked) -> Checked:
    message = f"the check has not ended within {budget:g} s"
    hint = "`lmoc check` goes on without limit and shows how far it is"
    if part.left:
        message += f": {part.left} of {part.models} models of this file, at the most, have not been checked"
    return replace(part, findings=(*part.findings, Finding("W0666", "warning", message, None, "", "", hint, ())))
