"""A folder of the user where results that are costly to make again are kept between processes.

Nothing depends on it: where the folder cannot be read or written, or a file in it is damaged or
was made from something else, the result is simply made again.
"""

from __future__ import annotations

import os
import sys
from zlib import crc32


def folder() -> str:
    """The folder: ``LMOC_CACHE``, else ``lmoc`` in the platform's place for caches."""
    chosen = os.environ.get("LMOC_CACHE")
    if chosen:
        return chosen
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or os.path.expanduser("~\\AppData\\Local")
    elif sys.platform == "darwin":
        base = os.path.expanduser("~/Library/Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(base, "lmoc")


def read(name: str, key: bytes) -> bytes | None:
    """What was kept under `name` if it was made from `key` and is undamaged, else None."""
    try:
        with open(_place(name), "rb") as file:
            found = file.read()
    except OSError:
        return None
    head = _head(key)
    check, kept = found[:4], found[4:]
    if not kept.startswith(head) or check != _check(kept):
        return None
    return kept[len(head) :]


def write(name: str, key: bytes, payload: bytes) -> None:
    """Keep `payload` under `name`; silently does nothing where that is not possible."""
    place = _place(name)
    partial = f"{place}.{os.getpid()}"
    kept = _head(key) + payload
    try:
        os.makedirs(folder(), exist_ok=True)
        with open(partial, "wb") as file:
            file.write(_check(kept) + kept)
        os.replace(partial, place)  # readers see the old file or the new one, never half of it
    except OSError:
        try:
            os.remove(partial)
        except OSError:
            pass


def _place(name: str) -> str:
    """The file of a name: one for each installation of lmoc, so that two do not take turns in overwriting it."""
    installation = f"{__file__} {sys.implementation.cache_tag}"
    return os.path.join(folder(), f"{name}-{crc32(installation.encode()):08x}")


def fingerprint(*files: str) -> bytes:
    """Size and time of files, such as those of the program that makes a result: part of a key."""
    found = []
    for file in files:
        try:
            status = os.stat(file)
            found.append(f"{file}:{status.st_size}:{status.st_mtime_ns}")
        except OSError:
            found.append(file)
    return "\n".join(found).encode()


def _head(key: bytes) -> bytes:
    """The key as it stands in the file. All of it: comparing is faster than importing a hash function."""
    return len(key).to_bytes(8, "little") + key


def _check(kept: bytes) -> bytes:
    return crc32(kept).to_bytes(4, "little")
