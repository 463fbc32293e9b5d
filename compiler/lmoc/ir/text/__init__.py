"""Printers of what one stage hands to the next, in the user's names."""

from __future__ import annotations

from functools import singledispatch

from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import Normalized
from lmoc.ir.reduced import Reduced
from lmoc.ir.text.flat import flat_text
from lmoc.ir.text.normalized import normalized_text
from lmoc.ir.text.reduced import reduced_text


@singledispatch
def text(structure: object) -> str:
    """Return a structure as text.

    Raises
    ------
    TypeError
        There is no printer for such a structure.
    """
    raise TypeError(f"there is no printer for {type(structure).__name__}")


text.register(FlatDAE, flat_text)
text.register(Normalized, normalized_text)
text.register(Reduced, reduced_text)
