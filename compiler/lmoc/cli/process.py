"""The command as a process: its standard streams, the signals that end it, and its quiet exit."""

from __future__ import annotations

import errno
import io
import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from lmoc.messages.diagnostics import visible

INTERRUPTED, TERMINATED = 130, 143  # 128 + the number of the signal, as shells tell it
_OUTPUT_LOST = frozenset({errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO, errno.EBADF, errno.EINVAL})
_terminated = False
_began = 0.0  # s, the processor time of this process when the command began
_noted: int | None = None  # the pipe in which the interpreter notes signals, besides what handles them


class _Closed(io.TextIOBase):
    """Standard output that was closed before the command began: the first word written to it is an error."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))


def worked() -> float:
    """Return the processor time of the command so far, s."""
    return time.process_time() - _began


def prepare() -> None:
    """Make the streams usable, and have SIGTERM end the command as Ctrl-C does: what there is by then is kept."""
    global _terminated, _began
    _terminated, _began = False, time.process_time()
    _occupy_closed_streams()
    _note_signals()
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal that cannot show a sign (→, ẍ) shows a question mark
    if not sys.warnoptions:  # what numpy says of an overflow names files of lmoc; a diagnostic says what it means
        import warnings

        warnings.simplefilter("ignore")
    try:
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            signal.signal(signal.SIGTERM, _terminate)
    except ValueError:
        pass  # not the main thread, which alone gets signals


class _Terminal:
    """A terminal to which nothing goes but texts and the command's own colours: names are a model's."""

    _OWN = re.compile(r"(\x1b\[[\d;]*m)")

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        pieces = self._OWN.split(text)
        return self.stream.write("".join(p if k % 2 else visible(p) for k, p in enumerate(pieces)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def shown() -> Iterator[None]:
    """Keep what a model says from commanding the terminal to which standard output goes."""
    before = sys.stdout
    if before.isatty():
        sys.stdout = _Terminal(before)  # type: ignore[assignment]
    try:
        yield
    finally:
        sys.stdout = before


def _occupy_closed_streams() -> None:
    """Open the null device for closed streams: else the next file opened gets their number, and what is meant for
    standard error goes into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free


def _note_signals() -> None:
    global _noted
    if _noted is not None:
        return
    _noted, note = os.pipe()
    try:
        for end in (_noted, note):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(note, warn_on_full_buffer=False)
    except (OSError, ValueError):  # not the main thread, or a system whose pipes cannot do that: none is noted
        os.close(note)


def _is_noted(number: int) -> bool:
    """Return whether a signal has come since this was asked last."""
    try:
        return _noted is not None and number in os.read(_noted, 4096)
    except BlockingIOError:
        return False


def _terminate(*_: object) -> None:
    global _terminated
    _terminated = True
    if not callable(signal.getsignal(signal.SIGINT)):  # ignored, as in a background job of a shell script
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)  # whoever handles Ctrl-C at the moment


def interruption_code() -> int:
    """The exit code of a command that was interrupted: from the keyboard, or by SIGTERM."""
    return TERMINATED if _terminated else INTERRUPTED


def came_from_interruption(error: BaseException) -> bool:
    """Return whether an exception follows from Ctrl-C.

    C extensions turn it into an error of their own while they load, some without a word of what they have caught.
    """
    if _is_noted(signal.SIGINT) and _while_loading(error):
        return True
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, KeyboardInterrupt):
            return True
        seen = seen.__cause__ or seen.__context__
    return False


def _while_loading(error: BaseException) -> bool:
    """Return whether an import was under way; the frames of the import itself are not in the traceback."""
    from opcode import opmap  # looked at after a failure only

    at = error.__traceback__
    while at is not None:
        code = at.tb_frame.f_code
        if code.co_code[at.tb_lasti] == opmap["IMPORT_NAME"] or code.co_name == "import_module":
            return True
        at = at.tb_next
    return False


def is_lost_output(error: OSError) -> bool:
    """Return whether standard output could not be written (errors of files are ModelErrors or have a file name)."""
    return error.filename is None and error.errno in _OUTPUT_LOST


def give_up_output() -> None:
    """Send what is still to be written to standard output nowhere, so that Python does not fail again at its end."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):
        pass  # it has no descriptor: closed from the beginning, or captured
