"""The parts of a text: each begins with a class at the beginning of a line, as far as the text alone can say.

It can be mistaken: such a line can be in a comment, or in a class that is not indented. Parts are therefore only used
where each of them is right by itself, or wrong by itself with all that is between them. In a part that is a package,
classes inside of it are such parts, too.
"""

from __future__ import annotations

import re
from typing import NamedTuple

_PREFIXES = r"(?:(?:partial|encapsulated|expandable|pure|impure|operator|final|replaceable|redeclare)[ \t]+)*"
_KINDS = r"(?:class|model|block|connector|type|record|package|function)"
_HEAD = re.compile(rf"^{_PREFIXES}{_KINDS}[ \t]+(?=[^\W\d]|')", re.MULTILINE)
_INSIDE = re.compile(
    rf"^([ \t]+)(?:(?:partial|encapsulated|expandable|pure|impure)[ \t]+)*({_KINDS})[ \t]+"
    r"([^\W\d]\w*|'(?:[^'\\\n]|\\.)+')(?!\w|[ \t]*=)",
    re.MULTILINE,
)


class Part(NamedTuple):
    """A range of characters of a text."""

    start: int
    end: int


def divided(text: str) -> list[Part]:
    """The parts of a text, one at least; what stands before the first class belongs to its part."""
    starts = [m.start() for m in _HEAD.finditer(text)]
    return [Part(a, b) for a, b in zip([0, *starts[1:]], [*starts[1:], len(text)])]


class Inside(NamedTuple):
    """A class inside of a package, on lines of its own.

    Attributes
    ----------
    start, end : all its lines
    head, foot : where its name ends, and where the line with its end begins
    """

    start: int
    head: int
    foot: int
    end: int

    @property
    def part(self) -> Part:
        return Part(self.start, self.end)


def inside(text: str, part: Part) -> list[Inside]:
    """Return the classes inside of a part that is a package, and of packages in it, but these themselves."""
    found: list[Inside] = []
    first = _HEAD.search(text, part.start, part.end)
    at = part.end if first is None or "package" not in first[0] else first.end()
    while (head := _INSIDE.search(text, at, part.end)) is not None:
        at = head.end()
        if head[2] != "package":
            foot = re.compile(rf"^{head[1]}end[ \t]+{re.escape(head[3])}[ \t]*;[ \t]*\n", re.MULTILINE)
            last = foot.search(text, at, part.end)
            if last is not None:
                found.append(Inside(head.start(), head.end(), last.start(), last.end()))
                at = last.end()
    return found


def blank(text: str) -> str:
    """Return a text that says nothing and is as long, line by line."""
    return re.sub(r"[^\n]", " ", text)


def emptied(text: str) -> str:
    """Return the text of a class inside of a package, as long as it was, with nothing in it."""
    head = _INSIDE.match(text)
    assert head is not None
    foot = text.rfind("\n", 0, -1) + 1
    return text[: head.end()] + blank(text[head.end() : foot]) + text[foot:]
