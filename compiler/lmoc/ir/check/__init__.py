"""Checkers that run between the stages: `check(structure)` for everything that one stage hands to the next."""

from __future__ import annotations

from functools import singledispatch

from lmoc.ir.check.flat import check_flat
from lmoc.ir.check.normalized import check_normalized
from lmoc.ir.check.reduced import check_reduced
from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import Normalized
from lmoc.ir.reduced import Reduced


@singledispatch
def check(structure: object) -> None:
    """Check what the readers of a structure rely on.

    Raises
    ------
    CorruptStructureError
        A stage has made a mistake.
    TypeError
        There is no checker for such a structure.
    """
    raise TypeError(f"there is no checker for {type(structure).__name__}")


check.register(FlatDAE, check_flat)
check.register(Normalized, check_normalized)
check.register(Reduced, check_reduced)
