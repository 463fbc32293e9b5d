"""A C compiler where there is one, and a cache of what it has made, keyed by the text."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

FLAGS = ("-march=native", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")


@lru_cache(maxsize=1)
def find_compiler() -> str | None:
    """Path of a C compiler: ``$LMOC_CC`` (empty: none wanted), else gcc, clang, cc or tcc, or None."""
    wanted = os.environ.get("LMOC_CC")
    if wanted is not None:
        return shutil.which(wanted) if wanted else None
    return next((path for name in ("gcc", "clang", "cc", "tcc") if (path := shutil.which(name))), None)


def cache_folder() -> Path:
    """Where compiled kernels are kept between runs."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "lmoc" / "kernels"


def load_library(text: str, optimization: str = "-O2") -> ctypes.CDLL | None:
    """Compile a C text, or take it from the cache.

    Parameters
    ----------
    optimization : the compiler's option

    Returns
    -------
    The loaded library, or None where there is no compiler or it refuses (the caller then takes another way of
    evaluating, and says so).
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    # -march=native ties the file to this processor, so its name is part of the key
    key = hashlib.sha256("\0".join([text, compiler, optimization, *FLAGS, _processor()]).encode()).hexdigest()[:32]
    path = cache_folder() / f"{key}.so"
    if not path.exists() and not _compile(compiler, text, path, optimization):
        # a cache that cannot be written: a folder of this process alone, never one that others could fill
        path = Path(tempfile.mkdtemp(prefix="lmoc-")) / f"{key}.so"
        if not _compile(compiler, text, path, optimization):
            return None
    try:
        return ctypes.CDLL(str(path))
    except OSError:
        path.unlink(missing_ok=True)  # a damaged file: made again next time
        return None


@lru_cache(maxsize=1)
def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line for line in lines if line.startswith("flags"))
    except (OSError, StopIteration):
        return sys.platform


def _compile(compiler: str, text: str, path: Path, optimization: str) -> bool:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            source, target = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
            source.write_text(text)
            flags = [f for f in FLAGS if not (compiler.endswith("tcc") and f.startswith(("-march", "-ff", "-fno")))]
            command = [compiler, optimization, *flags, str(source), "-o", str(target), "-lm"]
            done = subprocess.run(command, capture_output=True)
            if done.returncode != 0:
                return False
            os.replace(target, path)  # atomic: two processes may compile the same text at once
            return True
    except OSError:
        return False
