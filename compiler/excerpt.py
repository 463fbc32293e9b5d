"""Places of a text as a person sees them: the lines, with marks below."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from lmoc.source import Source, Span

_TAB = 4
_WIDTH = 120  # longer lines are shown around their mark
_CONTEXT = 30


class Mark(NamedTuple):
    """A place, the sign that marks it, and what is said about it there."""

    span: Span
    sign: str
    text: str


class _Piece(NamedTuple):
    """The part of a mark on one line, in columns from 0."""

    line: int
    start: int
    end: int
    sign: str
    text: str


def excerpt(marks: Sequence[Mark]) -> list[str]:
    """The lines of one source in which marks stand, below a headline with the place of the first mark."""
    source = marks[0].span.source
    pieces = sorted((p for mark in marks for p in _pieces(mark)), key=lambda p: (p.line, p.sign != "^", -p.start))
    width = len(str(pieces[-1].line))
    margin = " " * width
    line, column = source.position(marks[0].span.start)
    shown = [f"{margin}--> {source.name}:{line}:{column}", f"{margin} |"]
    previous = 0
    for number, group in groupby(pieces, key=lambda p: p.line):
        if previous and number == previous + 2:  # rather the line left out than dots
            shown.append(f"{previous + 1:>{width}} | {''.join(_spread(source.line(previous + 1)))[:_WIDTH]}".rstrip())
        elif previous and number > previous + 1:
            shown.append("..." if width > 1 else " ...")
        previous = number
        rows = _rows(source.line(number), list(group))
        shown += [f"{number:>{width}} | {rows[0]}".rstrip(), *(f"{margin} | {row}".rstrip() for row in rows[1:])]
    return shown


def _pieces(mark: Mark) -> Iterator[_Piece]:
    """A mark on its first line and, if it has several, on its last; what is said stands at the last."""
    source, start, end = mark.span.source, mark.span.start, mark.span.end
    first, column = source.position(start)
    last, last_column = source.position(max(start, end - 1))
    if first == last:
        yield _Piece(first, column - 1, column - 1 + max(1, end - start), mark.sign, mark.text)
        return
    yield _Piece(first, column - 1, max(column, len(source.line(first))), mark.sign, "")
    text = source.line(last)
    yield _Piece(last, len(text) - len(text.lstrip()), last_column, mark.sign, mark.text)


def _rows(line: str, pieces: Sequence[_Piece]) -> list[str]:
    """A line as it can be shown, and a row for each piece: tabs spread, what is far from the marks left out."""
    text = "".join(_spread(line))
    places = [(_columns(line, piece.start), _columns(line, piece.end)) for piece in pieces]
    left, right = 0, len(text)
    if len(text) > _WIDTH and text.isascii():
        left = max(0, min(min(start for start, _ in places) - _CONTEXT, len(text) - _WIDTH))
        right = min(len(text), left + _WIDTH)
        text = "…" * (left > 0) + text[left + (left > 0) : right - (right < len(text))] + "…" * (right < len(text))
    rows = [text]
    for piece, (start, end) in zip(pieces, places, strict=True):
        start, end = min(start, right) - left, min(end, right + 1) - left
        rows.append(f"{' ' * start}{piece.sign * max(1, end - start)} {piece.text}")
    return rows


def _spread(line: str) -> Iterator[str]:
    """The characters of a line, a tab as the spaces up to the next stop, what cannot be seen as a dot."""
    column = 0
    for char in line:
        shown = " " * (_TAB - column % _TAB) if char == "\t" else char if char.isprintable() else "·"
        column += len(shown)
        yield shown


def _columns(line: str, length: int) -> int:
    """How many columns of a screen the first characters of a line take; one for each beyond its end."""
    shown = "".join(list(_spread(line))[:length])
    beyond = max(0, length - len(line))
    if shown.isascii():
        return len(shown) + beyond
    return beyond + sum(_cells(char) for char in shown)


def _cells(char: str) -> int:
    if unicodedata.combining(char):
        return 0
    return 2 if unicodedata.east_asian_width(char) in "WF" else 1


def by_source(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Marks of the same source together, in the order in which the sources come up."""
    groups: dict[Source, list[Mark]] = {}
    for mark in marks:
        groups.setdefault(mark.span.source, []).append(mark)
    return list(groups.values())
