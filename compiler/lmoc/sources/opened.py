"""The model named by a user: files, or a class in a folder; and the folders in which further classes are found."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.sources.files import PACKAGE, SUFFIXES, package_file, read_source, refusal
from lmoc.sources.packages import Folder
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.classwise import parse_classwise

VARIABLE = "LMOPATH"  # of the environment: folders in which classes are looked for
_CLASS_NAME = re.compile(r"\.?[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")

Named = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


@dataclass(frozen=True)
class Opened:
    """The files that a user has named, parsed.

    Attributes
    ----------
    files : their syntax trees
    folders : where further classes are looked for, in this order
    model : the class that was named instead of a file; None where there were files only
    """

    files: tuple[tree.File, ...]
    folders: tuple[Folder, ...] = ()
    model: str | None = None


def open_files(named: Named, path: Named | None = None) -> Opened:
    """Return the parsed files and the folders of their classes.

    Parameters
    ----------
    named : a file, or the folder of a package, or several; one can be the name of a class instead, which is then looked
        for in the folders and in the current one
    path : folders that are searched after those of the files, before those of ``LMOPATH``

    Raises
    ------
    ModelError
        E0610 to E0612 for a file or a folder that cannot be read; the mistakes that belong to no class.
    """
    names = [named] if isinstance(named, str | os.PathLike) else list(named)
    if not names:
        raise refusal("E0610", "no file is given", hint="name the file of the scene")
    searched = folders_of_path(path)
    classes = [str(name) for name in names if is_class_name(name)]
    if len(classes) > 1:
        raise refusal("E0610", f"neither '{classes[0]}' nor '{classes[1]}' is a file", hint="name one class at most")
    sources = [read_source(package_file(Path(name)) or name) for name in names if not is_class_name(name)]
    report = Report()
    files = tuple(parse_classwise(source, report) for source in sources)
    report.check()
    own = [Folder(top_folder(Path(file.span.source.name), file)) for file in files]
    own += [Folder(Path())] if classes else []
    return Opened(files, _distinct([*own, *searched]), classes[0].removeprefix(".") if classes else None)


def open_source(source: Source | tree.File, path: Named | None = None) -> Opened:
    """Return a text, parsed if it is not yet, that belongs to no folder; otherwise as `open_files`."""
    report = Report()
    file = parse_classwise(source, report) if isinstance(source, Source) else source
    report.check()
    return Opened((file,), folders_of_path(path))


def folders_of_path(path: Named | None) -> tuple[Folder, ...]:
    """Return the folders that a user has named, and those of the environment that exist."""
    given = [] if path is None else [path] if isinstance(path, str | os.PathLike) else list(path)
    for name in given:
        if not str(name) or not Path(name).is_dir():
            what = "is a file, not a folder" if str(name) and Path(name).exists() else "does not exist"
            raise refusal("E0610", f"the folder '{name}' {what}", hint="classes are looked for in folders")
    around = [name for name in os.environ.get(VARIABLE, "").split(os.pathsep) if name and Path(name).is_dir()]
    return _distinct([Folder(Path(name), library=True) for name in (*given, *around)])


def is_class_name(name: str | os.PathLike[str]) -> bool:
    """Return whether a name that is no file's can be that of a class."""
    if not isinstance(name, str) or not _CLASS_NAME.fullmatch(name) or name.endswith(SUFFIXES):
        return False
    return not Path(name).exists() or Path(name).is_dir() and not name.startswith(".")


def top_folder(path: Path, file: tree.File) -> Path:
    """The folder in which the outermost package of a file is found: its own, or that many further out."""
    folder = path.parent
    for name in ((path.parent.name,) if path.stem == PACKAGE else ()) + file.within[::-1]:
        if folder.absolute().name != name:
            break  # it says that it belongs elsewhere
        folder = folder.absolute().parent
    return folder


def _distinct(folders: Sequence[Folder]) -> tuple[Folder, ...]:
    """The folders, each once; of libraries where it is named as such."""
    seen: dict[Path, Folder] = {}
    for folder in folders:
        first = seen.setdefault(folder.path.absolute(), folder)
        first.library |= folder.library
    return tuple(seen.values())
