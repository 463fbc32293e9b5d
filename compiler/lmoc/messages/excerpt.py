"""Places of a text as a person sees them: the lines, with marks below."""

from __future__ import annotations

import unicodedata
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate, groupby
from typing import NamedTuple

from lmoc.messages.source import Source, Span

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
        yield _Piece(first, column - 1, column - 1 + end - start, mark.sign, mark.text)
        return
    yield _Piece(first, column - 1, max(column, len(source.line(first))), mark.sign, "")
    text = source.line(last)
    yield _Piece(last, len(text) - len(text.lstrip()), last_column, mark.sign, mark.text)


def _rows(line: str, pieces: Sequence[_Piece]) -> list[str]:
    """A line as it can be shown, and a row for each piece: tabs spread, what is far from the marks left out."""
    cells = list(_spread(line))
    edges = [0, *accumulate(map(_width, cells))]  # the column at which each character begins, and the end
    places = [(_column(edges, piece.start), _column(edges, piece.end)) for piece in pieces]
    left, right = 0, len(cells)
    if edges[-1] > _WIDTH:
        first = max(0, min(_anchor(pieces, places) - _CONTEXT, edges[-1] - _WIDTH))
        left = bisect_left(edges, first)
        right = bisect_right(edges, edges[left] + _WIDTH) - 1
    begin, end = edges[left], edges[right]
    shown = cells[left:right]
    if left:
        shown[0] = "…" + " " * (_width(shown[0]) - 1)
    if right < len(cells):
        shown[-1] = "…" + " " * (_width(shown[-1]) - 1)
    rows = ["".join(shown)]
    beyond = end + 1 if right == len(cells) else end  # behind the end of a line is a place, behind dots is none
    for piece, (start, stop) in zip(pieces, places, strict=True):
        start = max(begin, min(start, beyond - 1)) - begin
        stop = max(start + 1, min(stop, beyond) - begin)
        rows.append(f"{' ' * start}{piece.sign * (stop - start)} {piece.text}")
    return rows


def _anchor(pieces: Sequence[_Piece], places: Sequence[tuple[int, int]]) -> int:
    """The column from which a long line is shown: where the first mark begins, unless the main one is far from it."""
    first = min(start for start, _ in places)
    main = min((start for piece, (start, _) in zip(pieces, places, strict=True) if piece.sign == "^"), default=first)
    return first if main - first < _WIDTH - 2 * _CONTEXT else main


def _spread(line: str) -> Iterator[str]:
    """The characters of a line, a tab as the spaces up to the next stop, what cannot be seen as a dot."""
    column = 0
    for char in line:
        shown = " " * (_TAB - column % _TAB) if char == "\t" else char if char.isprintable() else "·"
        column += len(shown)
        yield shown


def _column(edges: Sequence[int], position: int) -> int:
    """The column of a screen at which a character of a line begins; one for each beyond the line's end."""
    return edges[position] if position < len(edges) else edges[-1] + position - len(edges) + 1


def _width(text: str) -> int:
    """Return the number of screen columns of a text."""
    if text.isascii():
        return len(text)
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def by_source(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Marks of the same source together, in the order in which the sources come up."""
    groups: dict[Source, list[Mark]] = {}
    for mark in marks:
        groups.setdefault(mark.span.source, []).append(mark)
    return list(groups.values())
