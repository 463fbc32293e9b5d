"""The switch for the checkers between the stages."""

from __future__ import annotations

import os
from typing import TypeVar

Structure = TypeVar("Structure")


def checked(structure: Structure) -> Structure:
    """Return a structure, checked first where the environment says ``LMOC_CHECK=1``.

    Raises
    ------
    CorruptStructureError
        A stage has made a mistake.
    """
    if os.environ.get("LMOC_CHECK", "") not in ("", "0"):
        from lmoc.ir.check import check

        check(structure)
    return structure
