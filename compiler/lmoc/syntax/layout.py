"""A text in the standard layout."""

from __future__ import annotations

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.syntax.format import format
from lmoc.syntax.parse import parse


def formatted(source: Source) -> str:
    """Return the text of a source in the standard layout.

    Raises
    ------
    ModelError
        With its syntax errors: what was not understood would be lost.
    """
    report = Report()
    file = parse(source, report)
    report.check()
    return format(file)
