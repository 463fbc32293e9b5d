"""Files of text: read, with what is wrong with them as diagnostics."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache as once
from pathlib import Path

from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.messages.source import Source

SUFFIXES = (".lmo", ".mo")  # of files with classes, the first going before the second
PACKAGE = "package"  # the file of a folder that makes a package of it


OPEN: dict[str, str] = {}  # texts by the absolute paths of files in whose place an editor has them, saved or not
_held: ContextVar[Mapping[str, str]] = ContextVar("_held", default=OPEN)


@contextmanager
def holding(texts: Mapping[str, str]) -> Iterator[None]:
    """Have texts read in the place of files, by their absolute paths, and those that are open."""
    token = _held.set({**OPEN, **texts})
    try:
        yield
    finally:
        _held.reset(token)


def read_source(path: str | os.PathLike[str]) -> Source:
    """Return the text of a file.

    Raises
    ------
    ModelError
        E0610 no such file, E0611 a folder or not readable, E0612 not text in UTF-8.
    """
    name = str(path)
    held = _held.get()
    if held and os.path.abspath(name) in held:
        return Source(name, held[os.path.abspath(name)])
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise refusal("E0610", f"there is no file '{name}'", hint=_similar_file(Path(path))) from None
    except IsADirectoryError:
        inside = sorted(p.name for p in Path(path).glob("*.lmo"))
        hint = f"it contains {', '.join(inside[:5])}{' …' if len(inside) > 5 else ''}" if inside else ""
        raise refusal("E0611", f"'{name}' is a folder, not a file", hint=hint) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refusal("E0611", f"'{name}' cannot be read: {reason}") from None
    return Source(name, _decode(name, data))


def _decode(name: str, data: bytes) -> str:
    if b"\0" in data:
        raise refusal("E0612", f"'{name}' is not a text file", expected="text in UTF-8", found="binary data")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        found = f"byte 0x{data[error.start]:02x} in line {line}"
        raise refusal(
            "E0612", f"'{name}' is not text in UTF-8", expected="text in UTF-8", found=found,
            hint="save it with encoding UTF-8",
        ) from None  # fmt: skip
    return re.sub(r"\r(?!\n)", "\n", text) if "\r" in text else text  # lines that end as on the first Macintosh


def _similar_file(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f"there is no folder '{folder}' either"
    near = nearest(path.name, (p.name for p in folder.iterdir()))
    return near or ("`lmoc new` lists scenes to start from" if path.suffix == ".lmo" else "")


def class_files(folder: str | Path) -> dict[str, list[str]]:
    """Return the files and folders in a folder that define classes, by the class that they are named after.

    Raises
    ------
    OSError
        The folder cannot be read.
    """
    found: dict[str, list[str]] = {}
    for name in sorted(os.listdir(folder)):
        stem, suffix = os.path.splitext(name)
        if suffix in SUFFIXES and stem != PACKAGE:
            found.setdefault(stem, []).append(name)
        elif not suffix and package_file(Path(folder, name)) is not None:
            found.setdefault(name, []).append(name)
    return found


def package_file(folder: Path) -> Path | None:
    """Return the file that makes a package of a folder; None where there is none."""
    return next((file for suffix in SUFFIXES if (file := folder / (PACKAGE + suffix)).is_file()), None)


@once
def library_texts() -> tuple[tuple[str, str], ...]:
    """Return names and texts of the library's files."""
    import lmoc.stdlib

    folder = os.path.dirname(lmoc.stdlib.__file__)
    found = []
    for name in sorted(os.listdir(folder)):
        if name.endswith(".lmo"):
            with open(os.path.join(folder, name), encoding="utf-8") as file:
                found.append((name, file.read()))
    return tuple(found)


def refusal(code: str, message: str, *, expected: str = "", found: str = "", hint: str = "") -> ModelError:
    """Return the error for a file that cannot be used."""
    return ModelError([Diagnostic(code, message, expected=expected, found=found, hint=hint)])
