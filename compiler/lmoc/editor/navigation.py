"""Where a declaration is, as an editor can open it."""

from __future__ import annotations

from pathlib import Path

from lmoc.messages.source import Span

LIBRARY = "stdlib/"


def location(span: Span) -> Path:
    """Return the file of a span; of the library, where it is installed."""
    name = span.source.name
    if not name.startswith(LIBRARY):
        return Path(name)
    import lmoc.stdlib

    return Path(lmoc.stdlib.__file__).parent / name.removeprefix(LIBRARY)
