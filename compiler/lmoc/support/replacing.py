"""Files that are replaced as a whole: readers see the old content or the new one, and a failure leaves the old one."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path


class NotKept(OSError):
    """A disk gave back something other than what was written to it."""


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Have `write` make a file beside `path`, and move it there once it is complete and on the disk.

    Where `path` is no ordinary file (a pipe, a terminal, ``/dev/stdout``) there is nothing to keep, and `write` is
    called with `path` itself. A symbolic link goes on pointing to the file that is replaced, whose permissions stay.

    Parameters
    ----------
    write : called with the name of an empty file that has the ending of `path`

    Raises
    ------
    OSError
        The file could not be written; what stood at `path` is as it was, and nothing is left beside it.
    """
    if path.exists() and not path.is_file():
        write(path)
        return
    path = path.resolve()
    import tempfile  # it imports random and hashlib, and most runs write no file

    number, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(number)
    beside = Path(name)
    try:
        write(beside)
        _flush_to_disk(beside)
        os.chmod(beside, _permissions(path))
        os.replace(beside, path)
    except BaseException:  # an interruption, too
        beside.unlink(missing_ok=True)
        raise


def replace_text(path: Path, text: str) -> None:
    """Replace a file by a text in UTF-8, read back before it takes the old one's place. Errors as `replace_file`."""

    def write(target: Path) -> None:
        target.write_text(text, encoding="utf-8", newline="\n")
        if target.is_file() and target.read_bytes() != text.encode():
            raise NotKept("what was written cannot be read back")

    replace_file(path, write)


def _flush_to_disk(path: Path) -> None:
    """Some file systems report a full disk only when the data are forced out."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _permissions(path: Path) -> int:
    """Permissions of the file that is replaced; of a new file those that the process gives by default."""
    if path.exists():
        return path.stat().st_mode & 0o7777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
