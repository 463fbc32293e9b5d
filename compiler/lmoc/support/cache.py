"""A folder of the user where results that are costly to make again are kept between processes.

Nothing depends on it: where the folder cannot be read or written, or a file in it is damaged or
was made from something else, the result is simply made again.
"""

from __future__ import annotations

import os
import sys
from zlib import crc32


def folder() -> str | None:
    """The folder: ``LMOC_CACHE``, else ``lmoc`` in the platform's place for caches; None where there is none.

    A relative name is none: it would be another folder wherever one stands (the XDG specification says the same).
    """
    if "LMOC_CACHE" in os.environ:
        chosen = os.environ["LMOC_CACHE"]
        return chosen if os.path.isabs(chosen) else None
    if sys.platform == "win32":
        places = [os.environ.get("LOCALAPPDATA", ""), os.path.expanduser("~\\AppData\\Local")]
    elif sys.platform == "darwin":
        places = [os.path.expanduser("~/Library/Caches")]
    else:
        places = [os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache")]
    return next((os.path.join(place, "lmoc") for place in places if os.path.isabs(place)), None)


def own_folder(*below: str) -> str | None:
    """The folder, or one below it, made where it is missing; None where it is not the user's own.

    What is kept is executed (compiled kernels, pickles), so nobody else may be able to put a file there.
    """
    root = folder()
    if root is None:
        return None
    path = root
    try:
        os.makedirs(root, mode=0o700, exist_ok=True)
        for name in ("", *below):
            path = os.path.join(path, name) if name else path
            os.makedirs(path, mode=0o700, exist_ok=True)
            if not (is_own(path) or _keep_others_out(path)):
                return None
    except OSError:
        return None
    return path


def is_own(path: str) -> bool:
    """Return whether a file or folder belongs to the user alone: nobody else could have written to it.

    Raises
    ------
    OSError
        There is no such file.
    """
    if not hasattr(os, "getuid"):
        return True  # Windows keeps others out of a user's folders by its own rights
    status = os.stat(path)
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


def _keep_others_out(path: str) -> bool:
    """Take the permission to write from others, who may have it by the user's umask; whether that was possible."""
    status = os.stat(path)
    if status.st_uid == os.getuid():
        os.chmod(path, status.st_mode & 0o7755)
    return is_own(path)


def read(name: str, key: bytes) -> bytes | None:
    """Return the entry kept under `name` if it was made from `key`, is undamaged and the user's own, else None."""
    place = _place(name)
    if place is None:
        return None
    try:
        if not is_own(place):
            return None
        with open(place, "rb") as file:
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
    if place is None:
        return
    partial = f"{place}.{os.getpid()}"
    kept = _head(key) + payload
    try:
        with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(_check(kept) + kept)
        os.replace(partial, place)  # readers see the old file or the new one, never half of it
    except OSError:
        try:
            os.remove(partial)
        except OSError:
            pass


def prune(name: str, most: int) -> None:
    """Remove the oldest of the entries whose names begin alike, so that no more than some stay."""
    own = own_folder()
    if own is None:
        return
    try:
        entries = sorted((e for e in os.scandir(own) if e.name.startswith(name)), key=lambda e: e.stat().st_mtime)
        for entry in entries[:-most]:
            os.remove(entry.path)
    except OSError:  # another process is at it
        pass


def _place(name: str) -> str | None:
    """The file of a name, one for each installation of lmoc, so that two do not take turns in overwriting it."""
    installation = f"{__file__} {sys.implementation.cache_tag}"
    own = own_folder()
    return None if own is None else os.path.join(own, f"{name}-{crc32(installation.encode()):08x}")


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
    """The key as it appears in the file. All of it: comparing is faster than importing a hash function."""
    return len(key).to_bytes(8, "little") + key


def _check(kept: bytes) -> bytes:
    return crc32(kept).to_bytes(4, "little")
