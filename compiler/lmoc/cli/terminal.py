"""Output to standard error: diagnostics, failures, and the report of an internal error."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from typing import TextIO

from lmoc.messages.diagnostics import Diagnostic, render, visible

_COLOUR = {"error": "31", "warning": "33", "note": "36"}


def coloured(stream: TextIO) -> bool:
    """Return whether to write colours to a stream: a terminal, and NO_COLOR not set."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def styled(text: str, style: str, stream: TextIO) -> str:
    """The text with an ANSI style (``1`` bold, ``2`` faint, ``31`` red) where the stream shows it."""
    return f"\x1b[{style}m{text}\x1b[0m" if coloured(stream) else text


def show(diagnostics: Iterable[Diagnostic], severities: tuple[str, ...] = ("error", "warning", "note")) -> None:
    """Write diagnostics, errors last where one looks first; and their number if there are several."""
    order = {"note": 0, "warning": 1, "error": 2}
    chosen = sorted((d for d in diagnostics if d.severity in severities), key=lambda d: order[d.severity])
    for d in chosen:
        print(_painted(render(d), d.severity), end="\n\n", file=sys.stderr)
    errors = sum(d.severity == "error" for d in chosen)
    if errors > 1:
        print(f"{errors} errors", file=sys.stderr)


def _painted(text: str, severity: str) -> str:
    if not coloured(sys.stderr):
        return text
    text = re.sub(r"^\w+\[\w+\]", lambda m: f"\x1b[1;{_COLOUR[severity]}m{m[0]}\x1b[0m", text)
    return re.sub(r"(?m)^( +\|.*?)(\^+)", lambda m: f"{m[1]}\x1b[{_COLOUR[severity]}m{m[2]}\x1b[0m", text)


def failure(message: str) -> None:
    """One line that says why nothing more comes."""
    print(styled("failed: ", "1;31", sys.stderr) + visible(message), file=sys.stderr)


def internal_error(error: BaseException) -> None:
    """Own up to a mistake of the compiler; the traceback goes into a file, with LMOC_TRACEBACK=1 to the screen too."""
    import tempfile
    import traceback

    text = "".join(traceback.format_exception(error))
    said = (
        f"internal error: {type(error).__name__}: {str(error)[:300]}\n"
        "This is a mistake in lmoc, not in your model. Please report it with the model and "
    )
    try:
        with tempfile.NamedTemporaryFile("w", prefix="lmoc-", suffix=".txt", delete=False, encoding="utf-8") as file:
            file.write(f"command: {' '.join(sys.argv)}\n\n{text}")
    except OSError:  # a full disk
        print(f"{said}this:\n{text}", file=sys.stderr)
        return
    if os.environ.get("LMOC_TRACEBACK"):
        print(text, file=sys.stderr)
    print(f"{said}this file:\n  {file.name}", file=sys.stderr)
