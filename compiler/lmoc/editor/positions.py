"""Places in a text as editors count them: lines from 0, characters in units of UTF-16 (LSP 3.17, "Position")."""

from __future__ import annotations

from bisect import bisect_right

from lsprotocol import types as lsp

from lmoc.messages.source import Source, Span


def position(source: Source, offset: int) -> lsp.Position:
    """Return the place of a character, counted from 0 in the text."""
    offset = min(max(offset, 0), len(source.text))
    line = bisect_right(source.line_starts, offset) - 1
    before = source.text[source.line_starts[line] : offset]
    return lsp.Position(line, _units(before))


def offset(source: Source, place: lsp.Position) -> int:
    """Return the character at a place; places behind the end of a line or of the text are those ends."""
    starts = source.line_starts
    if place.line >= len(starts):
        return len(source.text)
    start = starts[place.line]
    line = source.text[start : starts[place.line + 1] - 1 if place.line + 1 < len(starts) else len(source.text)]
    if line.isascii():
        return start + min(place.character, len(line))
    left = place.character
    for k, char in enumerate(line):
        if left <= 0:
            return start + k
        left -= _units(char)
    return start + len(line)


def span_range(span: Span) -> lsp.Range:
    """Return a span as a range."""
    return lsp.Range(position(span.source, span.start), position(span.source, span.end))


def _units(text: str) -> int:
    return len(text) if text.isascii() else len(text.encode("utf-16-le")) // 2
