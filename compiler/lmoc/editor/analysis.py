"""What an editor knows of a text: its tree, as far as it can be understood, and the scopes of its names.

Nothing is flattened or solved here: an analysis takes as long as parsing. A text that is wrong in the middle of typing
has a tree as well, since the parser repairs it (`syntax.recovery`); of a class that it cannot understand nothing is
known until it can.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
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
from lmoc.syntax.parse import parse


@dataclass(frozen=True, eq=False)
class Analysis:
    """A text, parsed, among the classes that it can use.

    Attributes
    ----------
    source : Source
        Its name is the path of the file.
    file : its tree, as far as the text can be understood
    root : the scope of its classes, that of the library around it
    """

    source: Source
    file: tree.File
    root: Scope

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

    def classes(self) -> Iterator[tree.Class]:
        """Yield the classes of the text, those inside of others after these."""
        pending = list(reversed(self.file.classes))
        while pending:
            definition = pending.pop()
            yield definition
            pending += reversed([e for e in definition.elements if isinstance(e, tree.Class)])

    def class_at(self, offset: int) -> Scope | None:
        """Return the innermost class around a character."""
        around = [c for c in self.classes() if c.span.start <= offset <= c.span.end and id(c) in self.scopes]
        return self.scopes[id(min(around, key=lambda c: c.span.end - c.span.start))] if around else None


def with_change(whole: Analysis, text: str) -> Analysis | None:
    """Return what is known of a text that differs inside of one class from another; None where it differs elsewhere.

    Only this class is parsed: that is why an editor answers at once in a text of thousands of lines. The classes behind
    it are those of the other text, with their places there.
    """
    old = whole.source.text
    if text == old:
        return whole
    start = _alike(old, text)
    behind = _alike(old[start:][::-1], text[start:][::-1])
    end, longer = len(old) - behind, len(text) - len(old)
    for k, definition in enumerate(whole.file.classes):
        if definition.name_span.end < start and end < definition.span.end - len(definition.name):
            alone = _alone(Source(whole.source.name, text), definition.span.start, definition.span.end + longer)
            file = parse(alone, Report())
            if len(file.classes) != 1 or file.classes[0].name != definition.name:
                return None
            classes = (*whole.file.classes[:k], file.classes[0], *whole.file.classes[k + 1 :])
            return _in_scopes(Source(whole.source.name, text), replace(whole.file, classes=classes))
    return None


def _alike(a: str, b: str) -> int:
    """The number of characters with which both begin."""
    low, high = 0, min(len(a), len(b))
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if a[:middle] == b[:middle] else (low, middle - 1)
    return low


def _alone(source: Source, start: int, end: int) -> Source:
    """A part of a text with nothing before and behind it, at its place."""
    line, column = source.position(start)
    space = " " * (start - (line - 1) - (column - 1)) + "\n" * (line - 1) + " " * (column - 1)
    return Source(source.name, space + source.text[start:end])


def analyse(text: str, path: str) -> Analysis:
    """Return what is known of a text that stands in a file, or will.

    Parameters
    ----------
    path : of the file; its folder is searched for classes as `lmoc check` does
    """
    source = Source(path, text)
    file = parse(source, Report())
    return _in_scopes(source, file)


def _in_scopes(source: Source, file: tree.File) -> Analysis:
    folders = (*_own_folder(source.name, file), *folders_of_path(None))
    return Analysis(source, file, open_scopes([file], library.load(None), Report(), folders))


def _own_folder(path: str, file: tree.File) -> tuple[Folder, ...]:
    folder = top_folder(Path(path), file)
    return (Folder(folder),) if folder.is_dir() else ()


def folders_around(text: str, path: str) -> tuple[Folder, ...]:
    """Return the folder in which `lmoc check` looks for further classes of a file; none where it does not exist."""
    return _own_folder(path, parse(Source(path, text), Report()))


def place_of(span: Span) -> tuple[str, int]:
    """Return what identifies a declaration, in whatever analysis it has been found."""
    return span.source.name, span.start
