"""The engine's shared library, built where the package was installed (``compiler/building/lmoc_build.py``)."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from importlib import import_module

_POINTER, _COUNT, _INT = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int
# Functions with their results and arguments, in the order of the headers in `c/`.
_FUNCTIONS = {
    "lmoc_lu_new": (_POINTER, [_COUNT, _POINTER, _POINTER]),
    "lmoc_lu_free": (None, [_POINTER]),
    "lmoc_lu_forget": (None, [_POINTER]),
    "lmoc_lu_choose": (_INT, [_POINTER, _POINTER]),
    "lmoc_lu_refactor": (_INT, [_POINTER, _POINTER, _POINTER]),
    "lmoc_lu_factor": (_INT, [_POINTER, _POINTER, _POINTER]),
    "lmoc_lu_solve": (None, [_POINTER, _POINTER]),
}


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Return the engine with the types of its functions.

    Raises
    ------
    ImportError
        The package has not been installed, so that its engine has not been built.
    """
    built = import_module("lmoc.engine._engine")
    loaded = ctypes.CDLL(built.__file__)
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded
