"""Compiled scenes kept between processes: the flat model and its reduction, until something they depend on changes.

They depend on the texts of the scene's file and of the library, on the options, on this program, on the classes that
the folders around offer, and on the files of those that have been taken. All of it is compared with what it was, the
texts by content, those of the folders' files by a digest.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from zlib import crc32

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.reduced import Guard, Reduced
from lmoc.ir.stored import NotStorable, restore, store
from lmoc.messages.diagnostics import ModelError
from lmoc.messages.source import Source
from lmoc.sources.files import class_files, library_texts, read_source
from lmoc.sources.packages import Folder
from lmoc.support import cache
from lmoc.support.records import dataclass

_ROOMS = ("", "support", "messages", "expression", "ir", "syntax", "grammar", "sources", "semantics", "structure")
_LARGEST = 2_000_000  # bytes: what is larger does not depend on start-up times
_MOST = 100  # scenes kept
_NAME = "scene-"


@dataclass(frozen=True, eq=False)
class Unchanged:
    """The only assumption of a reduction that has been kept: the parameter values are those that it was made for."""

    values: np.ndarray

    def __call__(self, values: np.ndarray) -> bool:
        return np.array_equal(values, self.values, equal_nan=True)


class Compiled:
    """The place of one scene among those that are kept.

    Parameters
    ----------
    file : as the user has named it, or the name of a class in a folder
    asked : model, parameters, states, path: whatever else makes the scene what it is
    """

    def __init__(self, file: str, asked: Sequence[object]) -> None:
        place = "\0".join([file, os.getcwd(), repr(asked)])
        self._entry = f"{_NAME}{crc32(place.encode()):08x}{crc32(place[::-1].encode()):08x}"
        settings = sorted((k, v) for k, v in os.environ.items() if k.startswith("LMO"))
        own = [read_source(file).text] if os.path.isfile(file) else []
        texts = [*own, *(part for text in library_texts() for part in text)]
        self._key = "\0".join([file, os.getcwd(), repr(asked), repr(settings), *texts]).encode() + _program()

    def read(self) -> tuple[FlatDAE, Reduced] | None:
        """Return the flat model and its reduction; None where they are not kept, or were made from something else."""
        kept = cache.read(self._entry, self._key)
        if kept is None:
            return None
        size = int.from_bytes(kept[:8], "little")
        try:
            folders, files = restore(kept[8 : 8 + size])
            if any(_classes(folder) != names for folder, names in folders):
                return None
            texts = [read_source(name) for name, _ in files]
            if any(_digest(text) != digest for text, (_, digest) in zip(texts, files, strict=True)):
                return None
            flat, reduced = restore(kept[8 + size :], texts)
        except (ModelError, ValueError, KeyError, TypeError, AttributeError, ImportError, IndexError):
            return None
        guard = Guard(Unchanged(reduced.values), "the parameters keep the values that the scene was compiled with")
        return flat, replace(reduced, guards=(guard,))

    def write(self, flat: FlatDAE, reduced: Reduced, folders: Sequence[Folder]) -> None:
        """Keep a flat model and its reduction.

        Parameters
        ----------
        folders : in which classes have been looked for
        """
        around = [str(f.path) for f in folders] + [f for f in os.environ.get("LMOPATH", "").split(os.pathsep) if f]
        used = [inner for folder in folders for inner in folder.consulted()]
        around = list(dict.fromkeys([*around, *(str(f.path) for f in used)]))
        texts = [text for folder in used for text in folder.sources]
        try:
            looked = store(([(f, _classes(f)) for f in around], [(text.name, _digest(text)) for text in texts]))
            payload = store((flat, replace(reduced, guards=(), guess_at=None)), texts)
        except NotStorable:
            return
        payload = len(looked).to_bytes(8, "little") + looked + payload
        if len(payload) <= _LARGEST:
            cache.write(self._entry, self._key, payload)
            cache.prune(_NAME, _MOST)


def _digest(text: Source) -> str:
    """Return a digest of a text."""
    from hashlib import blake2b

    return blake2b(text.text.encode("utf-8", "surrogatepass")).hexdigest()


def _classes(folder: str) -> list[str] | None:
    """Return the names of the classes that a folder offers; None where it cannot be read."""
    try:
        return list(class_files(folder))
    except OSError:
        return None


def _program() -> bytes:
    """Return sizes and times of the files that compile."""
    top = os.path.dirname(os.path.dirname(__file__))
    found = []
    for room in _ROOMS:
        for folder, inner, files in os.walk(os.path.join(top, room)):
            inner[:] = [name for name in inner if room and name != "__pycache__"]
            found += [os.path.join(folder, name) for name in files if name.endswith((".py", ".lark"))]
    return cache.fingerprint(*sorted(found))
