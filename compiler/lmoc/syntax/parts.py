"""The parts of a text: each begins with a class at the beginning of a line, as far as the text alone can say.

It can be mistaken: such a line can be in a comment, or in a class that is not indented. Parts are therefore only used
where each of them is right by itself, or wrong by itself with all that is between them.
"""

from __future__ import annotations

import re
from typing import NamedTuple

_HEAD = re.compile(
    r"^(?:(?:partial|encapsulated|expandable|pure|impure|operator|final|replaceable|redeclare)[ \t]+)*"
    r"(?:class|model|block|connector|type|record|package|function)[ \t]+(?=[^\W\d]|')",
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
