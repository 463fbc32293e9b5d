"""Changes of the text that a diagnostic's hint proposes."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lmoc.editor.checking import Finding
from lmoc.support.records import dataclass

_MEANT = re.compile(r"did you mean '([^']+)'\?")
_IMPORT = re.compile(r"'(import [\w.]+(?:\.\*)?;)' in the model")
_WRITE = re.compile(r"^write '([^'…]+)'$")
_CLASS = re.compile(r"\b(?:model|block|package)\s+[^\W\d]\w*(?:\s*\"(?:[^\"\\]|\\.)*\")*[^\n]*\n")


@dataclass(frozen=True)
class Fix:
    """A replacement of some characters of the text."""

    title: str
    start: int
    end: int
    text: str


def fixes(finding: Finding, text: str) -> Iterator[Fix]:
    """Yield what the hint of a diagnostic would have a person write."""
    place = finding.place
    if place is None:
        return
    written = text[place.start : place.end]
    meant = _MEANT.search(finding.hint)
    if meant:
        at = _unknown(finding, written, place.start)
        if at is not None:
            yield Fix(f"Replace by '{meant[1]}'", *at, meant[1])
    brought = _IMPORT.search(finding.hint)
    if brought:
        heads = [m for m in _CLASS.finditer(text) if m.start() <= place.start]
        if heads:
            yield Fix(f"Add '{brought[1]}'", heads[-1].end(), heads[-1].end(), f"  {brought[1]}\n")
    new = _WRITE.search(finding.hint)
    if new and "\n" not in written:
        yield Fix(f"Write '{new[1]}'", place.start, place.end, new[1])


def _unknown(finding: Finding, written: str, start: int) -> tuple[int, int] | None:
    """The characters of the name that the message says is unknown, else of the whole place where it is one name."""
    for name in re.findall(r"'([^']+)'", finding.message):
        for last in (name, name.split(".")[-1]):
            found = list(re.finditer(rf"(?<!\w){re.escape(last)}(?!\w)", written))
            if len(found) == 1:
                return start + found[0].start(), start + found[0].end()
    return (start, start + len(written)) if re.fullmatch(r"[\w.]+", written) else None
