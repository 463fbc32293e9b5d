"""C source files that generated programs call, kept beside this module."""

from __future__ import annotations

from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).with_name("c")


@cache
def c_text(*names: str) -> str:
    """Return the text of some files in the folder ``c``, one after the other."""
    return "".join((_FOLDER / f"{name}.c").read_text(encoding="utf-8") for name in names)
