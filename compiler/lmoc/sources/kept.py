"""Parsed texts in the user's cache: reading their trees there takes a third of the time of parsing."""

from __future__ import annotations

import gc
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache as once
from typing import Any, TypeVar
from zlib import crc32

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Source
from lmoc.sources.lean import lean
from lmoc.support import cache
from lmoc.syntax import tree
from lmoc.syntax.classwise import parse_classwise

_NAME = "file-"
_MOST = 1000  # files of packages kept: the Modelica Standard Library has 600
T = TypeVar("T")


def kept(entry: str, texts: Sequence[str], make: Callable[[], T]) -> T:
    """Return what the cache has under a name, if it was made of these texts, else what `make` gives, which it keeps."""
    key = b"\0".join(part.encode() for part in texts) + _program()
    data = cache.read(entry, key)
    found: T | None = unpacked(data) if data else None
    if found is None:
        found = make()
        cache.write(entry, key, packed(found))
    return found


def package_file_tree(source: Source, report: Report) -> tree.File:
    """Return the tree of a file of a package, as `parse_classwise`, with what is read of its annotations."""

    def make() -> tuple[tree.File, list[Diagnostic]]:
        _make_room()
        found = Report()
        return lean(parse_classwise(source, found)), found.diagnostics

    place = os.path.abspath(source.name)
    entry = f"{_NAME}{crc32(place.encode()):08x}{crc32(place[::-1].encode()):08x}"
    file, said = kept(entry, (source.name, source.text), make)
    report.diagnostics += said
    return file


@once
def _make_room() -> None:
    cache.prune(_NAME, _MOST)


@once
def _program() -> bytes:
    """Return the key of the code that builds the trees: they are rebuilt when it changes."""
    import lmoc.grammar
    import lmoc.messages
    import lmoc.sources.lean

    files = [lmoc.messages.source.__file__, lmoc.messages.diagnostics.__file__, lmoc.sources.lean.__file__]
    for folder in (os.path.dirname(tree.__file__), os.path.dirname(lmoc.grammar.__file__)):
        files += [os.path.join(folder, name) for name in sorted(os.listdir(folder)) if "." in name]
    return cache.fingerprint(*files)


def packed(trees: Any) -> bytes:
    """Return trees as they stand in a file of the cache."""
    with _without_garbage():
        return pickle.dumps(trees, protocol=5)


def unpacked(data: bytes) -> Any:
    """Return the trees in a file of the cache; None if they cannot be made from it."""
    try:
        with _without_garbage():
            return pickle.loads(data)
    except Exception:  # whatever is wrong with it, the text can be parsed
        return None


@contextmanager
def _without_garbage() -> Iterator[None]:
    """Do not look for garbage among thousands of objects that all stay: it doubles the time."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
