"""Classes in folders: found by the names of files and read when first needed (Modelica specification, 13.4).

A class ``Name`` is in ``Name.lmo``, ``Name.mo`` or, with the classes inside of it, in a folder ``Name`` with
``package.lmo`` or ``package.mo``. The files in the folder of a package begin with ``within`` and its full name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path

from lmoc.messages.diagnostics import Diagnostic, Label, ModelError, Report, nearest
from lmoc.messages.source import Source, Span
from lmoc.sources.files import PACKAGE, SUFFIXES, class_files, package_file, read_source, refusal
from lmoc.sources.kept import package_file_tree
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.classwise import parse_classwise


@dataclass(frozen=True)
class Found:
    """A class in a folder.

    Attributes
    ----------
    definition : the class; None where the file cannot be read or defines no such class
    others : further classes of its file, which are seen from it alone
    folder : that of its classes, where it is a package in a folder
    diagnostics : what is wrong with the file
    """

    definition: tree.Class | None = None
    others: tuple[tree.Class, ...] = ()
    folder: Folder | None = None
    diagnostics: tuple[Diagnostic, ...] = ()


@dataclass
class Folder:
    """The classes that the files of a folder define.

    Attributes
    ----------
    path : the folder
    within : full name of the package whose folder it is; empty for one in which top-level classes are looked for
    library : whether the user has named it as a folder of libraries
    """

    path: Path
    within: tuple[str, ...] = ()
    library: bool = False
    _entries: dict[str, list[str]] | None = None
    _found: dict[str, Found | None] = field(default_factory=dict)
    sources: list[Source] = field(default_factory=list)  # of the files that have been read

    def names(self) -> Iterator[str]:
        """Yield the names of the classes, in the order of ``package.order`` and then of the alphabet."""
        entries = self._listing()
        order = [name for name in self.order() if name in entries]
        yield from order
        yield from sorted(name for name in entries if name not in order)

    def order(self) -> list[str]:
        """Return the lines of ``package.order``, empty where there is none."""
        try:
            return (self.path / "package.order").read_text("utf-8-sig").split()
        except (OSError, UnicodeDecodeError):
            return []

    def find(self, name: str) -> Found | None:
        """Return the class of that name; None where no file has its name. A file is read once."""
        if name not in self._found:
            entries = self._listing().get(name)
            self._found[name] = self._read(name, entries) if entries else None
        return self._found[name]

    def may_define(self, name: str) -> bool:
        """Return whether the file of that name has such a class, as far as its text says; of a folder, true."""
        files = [self.path / entry for entry in self._listing().get(name, ()) if entry != name]
        kinds = "model|block|class|connector|record|package|function|type"
        return not files or any(re.search(rf"\b(?:{kinds})\s+{re.escape(name)}\b", _text(f)) for f in files)

    def consulted(self) -> Iterator[Folder]:
        """Yield this folder and those of packages inside of it, as far as something has been looked for there."""
        if self._entries is not None:
            yield self
        for found in self._found.values():
            if found is not None and found.folder is not None:
                yield from found.folder.consulted()

    def _listing(self) -> dict[str, list[str]]:
        """File names by the class that they are named after."""
        if self._entries is None:
            try:
                self._entries = class_files(self.path)
            except OSError as error:
                raise refusal("E0611", f"the folder '{self.path}' cannot be read: {error.strerror}") from None
        return self._entries

    def _read(self, name: str, entries: list[str]) -> Found | None:
        own = next((e for suffix in SUFFIXES for e in entries if e.endswith(suffix)), None)
        if own is not None and name in entries:
            message = f"'{name}' is both a file and a folder in '{self.path}'"
            return Found(diagnostics=(Diagnostic("E0244", message, found=f"{own} and {name}/"),))
        file = self.path / own if own is not None else package_file(self.path / name)
        if file is None:
            return None  # it was there when the folder was listed
        folder = None if own is not None else Folder(self.path / name, (*self.within, name))
        try:
            report = Report()
            read = package_file_tree if folder is not None or self.within else parse_classwise
            source = read_source(file)
            self.sources.append(source)
            parsed = read(source, report)
        except ModelError as error:
            return Found(diagnostics=error.diagnostics)
        definition = next((c for c in parsed.classes if c.name == name), None)
        others = tuple(c for c in parsed.classes if c is not definition)
        if definition is None:
            return Found(diagnostics=tuple(report.diagnostics) or (_misnamed(name, file, parsed),))
        said = [*report.diagnostics, *self._misplaced(parsed, definition, file)]
        if folder is not None:
            said += _not_in_folder(folder, definition, file)
        return Found(definition, others, folder, tuple(said))

    def _misplaced(self, file: tree.File, definition: tree.Class, path: Path) -> Iterator[Diagnostic]:
        """Complain where ``within`` is not the package whose folder this is."""
        if file.within == self.within:
            return
        expected = f"within {'.'.join(self.within)};" if self.within else "no 'within'"
        if not file.within:
            message = f"'{path.name}' belongs to the package '{'.'.join(self.within)}' and does not say so"
            yield Diagnostic("W0245", message, definition.name_span, hint=f"begin the file with '{expected}'")
        else:
            message = f"'{definition.name}' is not where its file says"
            found = f"within {'.'.join(file.within)};"
            yield Diagnostic("E0244", message, Span(file.span.source, 0, 0), expected=expected, found=found)


def _text(file: Path) -> str:
    """What is in a file; nothing where it cannot be read, which is said where its class is needed."""
    try:
        return read_source(file).text
    except ModelError:
        return ""


def own_folders(file: tree.File, definition: tree.Class) -> tuple[Folder, ...]:
    """Return the folder of the classes in a class, where a file that was named is that of a package in a folder."""
    path = Path(file.span.source.name)
    if path.stem != PACKAGE or path.suffix not in SUFFIXES or not path.is_file():
        return ()
    return (Folder(path.parent, (*file.within, definition.name)),)


def _misnamed(name: str, path: Path, file: tree.File) -> Diagnostic:
    names = [c.name for c in file.classes]
    near = nearest(name, names)
    hint = near or "a file has the name of the class that it defines"
    if near and path.stem == name:
        hint = f"{near} The file itself is named with its ending: {path.name}"
    place = file.classes[0].name_span if file.classes else None
    return Diagnostic("E0244", f"'{path}' defines no class '{name}'", place, expected=f"a class '{name}'",
                      found=", ".join(f"'{n}'" for n in names) or "no class", hint=hint)  # fmt: skip


def _not_in_folder(folder: Folder, definition: tree.Class, path: Path) -> Iterator[Diagnostic]:
    """Complain about a class that is there twice, and about entries of ``package.order`` that are not there."""
    own = {e.name: e for e in definition.elements if isinstance(e, tree.Class | tree.Component)}
    files = set(folder.names())
    for name in files & own.keys():
        labels = (Label(definition.name_span, f"the folder is '{folder.path}'"),)
        message = f"'{name}' is both in '{path.name}' and in a file of its own"
        yield Diagnostic("E0244", message, own[name].name_span, labels=labels)
    for name in folder.order():
        if name not in own and name not in files:
            hint = nearest(name, (*own, *files))
            message = f"'package.order' names '{name}', which is not in the package '{definition.name}'"
            yield Diagnostic("W0245", message, definition.name_span, hint=hint)
