"""What an editor knows of a text: its tree, as far as it can be understood, and the scopes of its names.

Nothing is flattened or solved here: an analysis takes as long as parsing. A text that is wrong in the middle of typing
has a tree as well, since the parser repairs it (`syntax.recovery`); of a class that it cannot understand nothing is
known until it can.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
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
    root : the scope of its classes, and of those of which it is a piece, that of the library around it
    """

    source: Source
    file: tree.File
    root: Scope

    @cached_property
    def scopes(self) -> dict[int, Scope]:
        """The scope of each class of the text, by the place of its name."""
        own = (s for s in scopes_in(self.root) if s.definition.span.source is self.source)
        return {s.definition.name_span.start: s for s in own}

    def classes(self, around: int | None = None) -> Iterator[tree.Class]:
        """Yield the classes of the text, or those around a character; the classes inside of them after these."""
        pending = [c for c in reversed(self.file.classes) if around is None or c.span.start <= around <= c.span.end]
        while pending:
            definition = pending.pop()
            yield definition
            pending += reversed([e for e in definition.elements if isinstance(e, tree.Class)])

    def class_at(self, offset: int) -> Scope | None:
        """Return the innermost class around a character."""
        around = [c for c in self.classes(offset) if c.span.start <= offset <= c.span.end]
        known = [c for c in around if c.name_span.start in self.scopes]
        return self.scopes[min(known, key=lambda c: c.span.end - c.span.start).name_span.start] if known else None


def scopes_in(root: Scope) -> Iterator[Scope]:
    """Yield the scopes of all classes of a file."""
    pending = [*root.local.values()]
    while pending:
        scope = pending.pop()
        yield scope
        pending += scope.local.values()


def analyse(text: str, path: str) -> Analysis:
    """Return what is known of a text that stands in a file, or will.

    Parameters
    ----------
    path : of the file; its folder is searched for classes as `lmoc check` does
    """
    source = Source(path, text)
    file = parse(source, Report())
    return Analysis(source, file, opened(path, file))


def opened(path: str, file: tree.File) -> Scope:
    """Return the scope of the classes of a file, which stands among those of its folder and of the library."""
    return open_scopes([file], library.load(None), Report(), folders(path, file))


def folders(path: str, file: tree.File) -> tuple[Folder, ...]:
    """Return the folders in which the compiler looks for further classes of a file."""
    return (*own_folder(path, file), *folders_of_path(None))


def own_folder(path: str, file: tree.File) -> tuple[Folder, ...]:
    """Return the folder of a file, if it exists."""
    folder = top_folder(Path(path), file)
    return (Folder(folder),) if folder.is_dir() else ()


def folders_around(text: str, path: str) -> tuple[Folder, ...]:
    """Return the folder in which `lmoc check` looks for further classes of a file; none where it does not exist."""
    return own_folder(path, parse(Source(path, text), Report()))
