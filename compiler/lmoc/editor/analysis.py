"""What an editor knows of a text: its tree, as far as it can be understood, and the scopes of its names.

Nothing is flattened or solved here: an analysis takes as long as parsing. A text that is wrong in the middle of typing
has a tree as well, since the parser repairs it (`syntax.recovery`); of a class that it cannot understand nothing is
known until it can.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.choose import open_scopes
from lmoc.semantics.classes.scope import Scope
from lmoc.sources import library
from lmoc.sources.opened import folders_of_path, top_folder
from lmoc.sources.packages import Folder
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.parse import parse, parsed_in_parts, refused
from lmoc.syntax.parts import Part, divided


@dataclass(frozen=True, eq=False)
class Analysis:
    """A text, parsed, among the classes that it can use.

    Attributes
    ----------
    source : Source
        Its name is the path of the file.
    file : its tree, as far as the text can be understood
    root : the scope of its classes, that of the library around it
    mended : the part of the text that is not as the grammar has it
    known : the part whose classes have their places in this text; others may have those of an older one
    """

    source: Source
    file: tree.File
    root: Scope
    mended: Part | None
    known: Part

    @cached_property
    def scopes(self) -> dict[int, Scope]:
        """The scope of each class of the text, by the identity of its definition."""
        own = {id(definition.span.source) for definition in self.file.classes}
        found: dict[int, Scope] = {}
        pending = list(self.root.local.values())
        while pending:
            scope = pending.pop()
            if id(scope.definition.span.source) in own:
                found[id(scope.definition)] = scope
            pending += scope.local.values()
        return found

    @cached_property
    def placed(self) -> tuple[tree.Class, ...]:
        """The classes of the known part."""
        return tuple(c for c in self.file.classes if c.span.source is self.source)

    def classes(self, around: int | None = None) -> Iterator[tree.Class]:
        """Yield the classes of the known part, or those around a character; the classes inside of them after these."""
        pending = [c for c in reversed(self.placed) if around is None or c.span.start <= around <= c.span.end]
        while pending:
            definition = pending.pop()
            yield definition
            pending += reversed([e for e in definition.elements if isinstance(e, tree.Class)])

    def class_at(self, offset: int) -> Scope | None:
        """Return the innermost class around a character of the known part."""
        around = [c for c in self.classes() if c.span.start <= offset <= c.span.end and id(c) in self.scopes]
        return self.scopes[id(min(around, key=lambda c: c.span.end - c.span.start))] if around else None


def with_change(whole: Analysis, text: str) -> Analysis | None:
    """Return what is known of the part of a text that alone differs from another text, of which all is known.

    Only this part is parsed: that is why an editor answers at once in a text of thousands of lines. What is found is
    what `analyse` finds there, since texts are understood part by part (`syntax.parse`). None where that is not
    certain: where parts begin elsewhere, or where what is wrong here could be right with what follows.
    """
    source = Source(whole.source.name, text)
    places = _changed_part(whole.source.text, text)
    if places is None or not _holds(whole):
        return None
    old, new = places
    if whole.mended is not None:  # it is mended together with what is wrong now
        old, new = _hull(old, whole.mended), _hull(new, _moved(whole.mended, old, new))
    found = parsed_in_parts(source, new)
    if found.mended is not None and not refused(source, found.mended):
        return None
    classes = [c for c in whole.file.classes if c.span.start < old.start]
    classes += [*found.file.classes, *(c for c in whole.file.classes if c.span.start >= old.end)]
    within = whole.file.within if new.start else found.file.within
    return _in_scopes(source, tree.File(within, tuple(classes), found.file.span), found.mended, new)


def _holds(whole: Analysis) -> bool:
    """Return whether all of a text is known, and each part but for mended ones means by itself what it means there."""
    starts = {c.span.start: c.span.end for c in whole.file.classes}
    parts = [p for p in divided(whole.source.text) if whole.mended is None or not _overlap(p, whole.mended)]
    begun = all(p.start in starts for p in parts if p.start)
    ends = sorted(p.start for p in parts)
    crossing = any(bisect_right(ends, a) != bisect_right(ends, b - 1) for a, b in starts.items())
    return whole.known == Part(0, len(whole.source.text)) and begun and not crossing


def _moved(other: Part, old: Part, new: Part) -> Part:
    """A part at its new place after another one, or what is in it, has become longer."""
    longer = new.end - old.end
    return Part(other.start + longer * (other.start >= old.end), other.end + longer * (other.end >= old.end))


def _hull(a: Part, b: Part) -> Part:
    return Part(min(a.start, b.start), max(a.end, b.end))


def _overlap(a: Part, b: Part) -> bool:
    return a.start < b.end and b.start < a.end


def _changed_part(old: str, new: str) -> tuple[Part, Part] | None:
    """The part in which alone two texts differ, in both; None where other parts differ, too."""
    if old == new:
        return None
    start = _alike(old, new)
    behind = min(_alike(old[::-1], new[::-1]), len(old) - start, len(new) - start)
    parts, now = divided(old), divided(new)
    k = bisect_right(parts, start, key=lambda p: p.start) - 1
    here = Part(parts[k].start, parts[k].end + len(new) - len(old))
    beside = [*parts[:k], *(_moved(p, parts[k], here) for p in parts[k + 1 :])]
    if len(old) - behind > parts[k].end or now != [*beside[:k], here, *beside[k:]]:
        return None
    return parts[k], here


def _alike(a: str, b: str) -> int:
    """The number of characters with which both begin."""
    low, high = 0, min(len(a), len(b))
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if a[:middle] == b[:middle] else (low, middle - 1)
    return low


def analyse(text: str, path: str) -> Analysis:
    """Return what is known of a text that stands in a file, or will.

    Parameters
    ----------
    path : of the file; its folder is searched for classes as `lmoc check` does
    """
    source = Source(path, text)
    parsed = parsed_in_parts(source)
    return _in_scopes(source, parsed.file, parsed.mended, Part(0, len(text)))


def _in_scopes(source: Source, file: tree.File, mended: Part | None, known: Part) -> Analysis:
    folders = (*_own_folder(source.name, file), *folders_of_path(None))
    root = open_scopes([file], library.load(None), Report(), folders)
    return Analysis(source, file, root, mended, known)


def _own_folder(path: str, file: tree.File) -> tuple[Folder, ...]:
    folder = top_folder(Path(path), file)
    return (Folder(folder),) if folder.is_dir() else ()


def folders_around(text: str, path: str) -> tuple[Folder, ...]:
    """Return the folder in which `lmoc check` looks for further classes of a file; none where it does not exist."""
    return _own_folder(path, parse(Source(path, text), Report()))


def place_of(span: Span) -> tuple[str, int]:
    """Return what identifies a declaration, in whatever analysis it has been found."""
    return span.source.name, span.start
