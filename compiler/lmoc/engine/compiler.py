"""A C compiler where there is one, and a cache of what it has made, keyed by the text."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
import threading
import zlib
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from lmoc.support import cache

_NICE = ("nice", "-n", "19") if shutil.which("nice") else ()  # a run that goes on comes first
# Not for this processor alone: where it multiplies and adds in one operation, gcc 12 does so in pairs of sums and
# differences even if told not to, and the bits are others.
FLAGS = ("-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")


@lru_cache(maxsize=1)
def find_compiler() -> str | None:
    """Path of a C compiler: ``$LMOC_CC`` (empty: none wanted), else gcc, clang, cc or tcc, or None."""
    wanted = os.environ.get("LMOC_CC")
    if wanted is not None:
        return shutil.which(wanted) if wanted else None
    return next((path for name in ("gcc", "clang", "cc", "tcc") if (path := shutil.which(name))), None)


def cache_folder() -> Path | None:
    """The user's own folder for compiled kernels, None where there is none."""
    found = cache.own_folder("kernels")
    return None if found is None else Path(found)


def load_library(text: str, optimization: str = "-O2") -> ctypes.CDLL | None:
    """Compile a C text, or take it from the cache.

    Parameters
    ----------
    optimization : the compiler's options

    Returns
    -------
    The loaded library, or None where there is no compiler or it refuses (the caller then takes another way of
    evaluating, and says so).
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    key = _key(compiler, text, optimization)
    return _load_kept(key) or _make(compiler, text, optimization, key)


def _key(compiler: str, text: str, optimization: str) -> str:
    return hashlib.sha256("\0".join([text, compiler, optimization, *FLAGS]).encode()).hexdigest()[:32]


def _load_kept(key: str) -> ctypes.CDLL | None:
    """A library from the cache. Its name ends in its checksum: loading a damaged one could end the process."""
    folder = cache_folder()
    for path in folder.glob(f"{key}-*.so") if folder is not None else ():
        try:
            if cache.is_own(str(path)) and path.name == _name(key, path.read_bytes()):
                return ctypes.CDLL(str(path))
            path.unlink()
        except OSError:
            continue  # gone meanwhile, or of another system
    return None


def _make(compiler: str, text: str, optimization: str, key: str) -> ctypes.CDLL | None:
    """Compile in a folder of this process alone, never one that others could fill; keep what comes out if possible."""
    with tempfile.TemporaryDirectory(prefix="lmoc-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "kernel.so"
        try:
            if not _compile(compiler, text, path, optimization):
                return None
            return ctypes.CDLL(str(_keep(path, key) or path))
        except OSError:
            return None


def _keep(path: Path, key: str) -> Path | None:
    """Copy a library into the cache; None where that cannot be written."""
    content, folder = path.read_bytes(), cache_folder()
    if folder is None:
        return None
    kept = folder / _name(key, content)
    partial = kept.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    try:
        partial.write_bytes(content)
        os.replace(partial, kept)  # atomic: two processes may compile the same text at once
        return kept
    except OSError:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        return None


def _name(key: str, content: bytes) -> str:
    return f"{key}-{zlib.crc32(content):08x}.so"


def _compile(compiler: str, text: str, path: Path, optimization: str) -> bool:
    source = path.with_name("kernel.c")
    source.write_text(text)
    flags = [*optimization.split(), *FLAGS]
    if compiler.endswith("tcc"):
        flags = [f for f in flags if not f.startswith(("-ff", "-fno"))]
    command = [*_NICE, compiler, *flags, str(source), "-o", str(path), "-lm"]
    return subprocess.run(command, capture_output=True).returncode == 0
