"""Other reductions of a scene with closed loops that derivations ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Released:
    """How a scene with closed loops is reduced in other coordinates.

    Attributes
    ----------
    everywhere : the reduction with all coordinates of the loops as states; E0626 where not all of them can be
    at : from a flat model and parameter values to the reduction in coordinates that serve at a place {name: value}
    """

    everywhere: Callable[[Prepared], Reduced]
    at: Callable[[FlatDAE, np.ndarray, Mapping[str, float]], Reduced]
