"""The library that comes with lmoc (``stdlib/*.lmo``), parsed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache as once

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.sources.files import library_texts
from lmoc.sources.kept import kept
from lmoc.sources.packages import Found
from lmoc.syntax import tree

# packages of parts that a scene must name to have them: {file: package}
PACKAGES = {"planar.lmo": "Planar"}
# files of global names that are read when a scene first uses one of them: most scenes have none
SELDOM = ("machines.lmo",)
_DEFINED = re.compile(r"^(?:partial )?(?:model|block|function|package|connector) (\w+)", re.M)


def load(texts: Iterable[str] | None = None) -> tuple[tree.File, ...]:
    """Return the files of the library.

    Parameters
    ----------
    texts : what the scene is written in: a package whose name does not occur there is left out, and so are the files of
        parts that are seldom used; None: all files

    Raises
    ------
    ModelError
        If a file of the library has a syntax error.
    """
    if texts is None:
        named = {*PACKAGES, *SELDOM}
    else:
        named = {file for text in texts for file, name in PACKAGES.items() if name in text}
    return tuple(file for part in ("", *sorted(named)) for file in _load(part))


def packages_with(name: str) -> list[str]:
    """Return the packages of the library that have a class of that name."""
    files = {package: _load(file) for file, package in PACKAGES.items()}
    return [
        package
        for package, (file,) in files.items()
        if any(isinstance(e, tree.Class) and e.name == name for e in file.classes[0].elements)
    ]


class Packages:
    """The packages of the library, each read when a scene first names it."""

    def names(self) -> Iterator[str]:
        """Yield their names, and those of the parts that are seldom used."""
        yield from PACKAGES.values()
        yield from _seldom_used()

    def find(self, name: str) -> Found | None:
        """Return the package or the part of that name, None where there is none."""
        file = next((f for f, package in PACKAGES.items() if package == name), None) or _seldom_used().get(name)
        if file is None:
            return None
        return Found(next(c for c in _load(file)[0].classes if c.name == name))


@once
def _seldom_used() -> dict[str, str]:
    """The files of parts that are seldom used, by their names."""
    texts = dict(library_texts())
    return {name: file for file in SELDOM for name in _DEFINED.findall(texts[file])}


@once
def _load(package: str) -> tuple[tree.File, ...]:
    """The files of global names, or the file of a package."""
    apart = {*PACKAGES, *SELDOM}
    texts = [(name, text) for name, text in library_texts() if (name if name in apart else "") == package]
    entry = f"library-{package.partition('.')[0]}" if package else "library"
    return kept(entry, [part for text in texts for part in text], lambda: _parse(texts))


def _parse(texts: list[tuple[str, str]]) -> tuple[tree.File, ...]:
    from lmoc.syntax.parse import parse

    report = Report()
    files = tuple(parse(Source(f"stdlib/{name}", text), report) for name, text in texts)
    report.check()
    return files
