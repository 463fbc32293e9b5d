"""A folder of the user where results that are costly to make again are kept between processes.

Nothing depends on it: where the folder cannot be read or written, or a file in it is damaged or
was made from something else, the result is simply made again.
"""

from __future__ import annotations

import os
import sys
from hashlib import blake2b

_DIGEST = 16


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


def digest(*parts: bytes) -> bytes:
    """A key for what a result is made from: the parts, and the Python that made it."""
    state = blake2b(sys.implementation.cache_tag.encode(), digest_size=_DIGEST)
    for part in parts:
        state.update(len(part).to_bytes(8, "little") + part)
    return state.digest()


def read(name: str, key: bytes) -> bytes | None:
    """What was kept under `name` if it was made from `key` and is undamaged, else None."""
    try:
        with open(os.path.join(folder(), name), "rb") as file:
            found = file.read()
    except OSError:
        return None
    kept_key, check, payload = found[:_DIGEST], found[_DIGEST : 2 * _DIGEST], found[2 * _DIGEST :]
    if kept_key != key or check != digest(payload):
        return None
    return payload


def write(name: str, key: bytes, payload: bytes) -> None:
    """Keep `payload` under `name`; silently does nothing where that is not possible."""
    place = os.path.join(folder(), name)
    partial = f"{place}.{os.getpid()}"
    try:
        os.makedirs(folder(), exist_ok=True)
        with open(partial, "wb") as file:
            file.write(key + digest(payload) + payload)
        os.replace(partial, place)  # readers see the old file or the new one, never half of it
    except OSError:
        try:
            os.remove(partial)
        except OSError:
            pass
