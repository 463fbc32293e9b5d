"""Source texts and the places in them."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import field
from functools import cached_property
from itertools import accumulate

from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Source:
    """One text that the compiler has read; compared by identity.

    Attributes
    ----------
    goes_on : whether it is a part of a text that ends later
    """

    name: str
    text: str
    goes_on: bool = False

    @cached_property
    def line_starts(self) -> list[int]:
        return [0, *accumulate(len(line) + 1 for line in self.text.split("\n")[:-1])]

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column of a character offset, both counted from 1."""
        line = bisect_right(self.line_starts, offset)
        return line, offset - self.line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """The text of one line (counted from 1), without its end."""
        starts = self.line_starts
        end = starts[number] if number < len(starts) else len(self.text)
        return self.text[starts[number - 1] : end].rstrip("\r\n")


@dataclass(frozen=True, slots=True)
class Span:
    """A half-open range of characters of one source."""

    source: Source = field(repr=False)
    start: int
    end: int

    @property
    def line(self) -> int:
        return self.source.position(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.position(self.start)[1]

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    def to(self, other: Span) -> Span:
        """The range from the start of this one to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))

    def __reduce__(self) -> tuple[type[Span], tuple[Source, int, int]]:
        """For the trees in the cache: pickle's own way for dataclasses with slots takes twice as long."""
        return Span, (self.source, self.start, self.end)

    def __str__(self) -> str:
        return f"{self.source.name}:{self.line}:{self.column}"
