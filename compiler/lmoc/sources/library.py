"""The library that comes with lmoc (``stdlib/*.lmo``), parsed.

Its trees are kept in the user's cache: reading them there takes a third of the time of parsing.
"""

from __future__ import annotations

import gc
import os
import pickle
from collections.abc import Iterable, Iterator
from functools import cache as once

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.sources.files import library_texts
from lmoc.sources.packages import Found
from lmoc.support import cache
from lmoc.syntax import tree

# packages of parts that a scene must name to have them: {file: package}
PACKAGES = {"planar.lmo": "Planar"}


def load(texts: Iterable[str] | None = None) -> tuple[tree.File, ...]:
    """Return the files of the library.

    Parameters
    ----------
    texts : what the scene is written in: a package whose name does not occur there is left out; None: all files

    Raises
    ------
    ModelError
        If a file of the library has a syntax error.
    """
    named = set(PACKAGES) if texts is None else {f for text in texts for f, name in PACKAGES.items() if name in text}
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
        """Yield their names."""
        yield from PACKAGES.values()

    def find(self, name: str) -> Found | None:
        """Return the package of that name, None where there is none."""
        for file, package in PACKAGES.items():
            if package == name:
                return Found(_load(file)[0].classes[0])
        return None


@once
def _load(package: str) -> tuple[tree.File, ...]:
    """The files of global names, or the file of a package."""
    texts = [(name, text) for name, text in library_texts() if (name if name in PACKAGES else "") == package]
    entry = f"library-{package.partition('.')[0]}" if package else "library"
    key = b"\0".join(part.encode() for text in texts for part in text) + _program()
    kept = cache.read(entry, key)
    files = _unpack(kept) if kept else None
    if files is None:
        files = _parse(texts)
        cache.write(entry, key, pickle.dumps(files, protocol=5))
    return files


@once
def _program() -> bytes:
    """Return the key of the code that builds the trees: they are rebuilt when it changes."""
    import lmoc.grammar
    import lmoc.messages.source

    files = [lmoc.messages.source.__file__]
    for folder in (os.path.dirname(tree.__file__), os.path.dirname(lmoc.grammar.__file__)):
        files += [os.path.join(folder, name) for name in sorted(os.listdir(folder)) if "." in name]
    return cache.fingerprint(*files)


def _parse(texts: list[tuple[str, str]]) -> tuple[tree.File, ...]:
    from lmoc.syntax.parse import parse

    report = Report()
    files = tuple(parse(Source(f"stdlib/{name}", text), report) for name, text in texts)
    report.check()
    return files


def _unpack(kept: bytes) -> tuple[tree.File, ...] | None:
    """The trees in a file of the cache; None if they cannot be made from it."""
    collecting = gc.isenabled()
    gc.disable()  # thousands of objects that all stay: looking for garbage among them doubles the time
    try:
        return pickle.loads(kept)
    except Exception:  # whatever is wrong with it, the library can be parsed
        return None
    finally:
        if collecting:
            gc.enable()
