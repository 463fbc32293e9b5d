"""Definition and references of a name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lmoc.editor.analysis import Analysis, place_of
from lmoc.editor.names import Occurrence, at, occurrences
from lmoc.messages.source import Span
from lmoc.support.records import dataclass

LIBRARY = "stdlib/"


@dataclass(frozen=True)
class Known:
    """An analysis and the names in it."""

    analysis: Analysis
    names: list[Occurrence]


def known(analysis: Analysis) -> Known:
    """Return an analysis with its names."""
    return Known(analysis, occurrences(analysis))


def definition(own: Known, offset: int) -> Span | None:
    """Return where the name at a character is declared."""
    found = at(own.names, offset)
    return None if found is None else found.declared


def references(own: Known, offset: int, others: Iterable[Known]) -> list[Span]:
    """Return all places of the name at a character, in this text and in others; its declaration is one of them."""
    found = at(own.names, offset)
    if found is None or found.declared is None:
        return []
    place = place_of(found.declared)
    return [span for one in (own, *others) for span in places(one, place)]


def places(one: Known, declared: tuple[str, int]) -> list[Span]:
    """Return all places in a text of what is declared somewhere (`analysis.place_of`)."""
    source = one.analysis.source
    return [Span(source, o.start, o.end) for o in one.names
            if o.declared is not None and place_of(o.declared) == declared]  # fmt: skip


def location(span: Span) -> Path:
    """Return the file of a span; of the library, where it is installed."""
    name = span.source.name
    if not name.startswith(LIBRARY):
        return Path(name)
    import lmoc.stdlib

    return Path(lmoc.stdlib.__file__).parent / name.removeprefix(LIBRARY)
