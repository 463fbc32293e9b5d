"""Laws that no forces, impulses or states satisfy together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Contradiction(Exception):
    """The laws of a scene contradict each other at an instant.

    Attributes
    ----------
    laws : (k,) the laws that take part
    """

    def __init__(self, laws: NDArray[np.int64], reason: str) -> None:
        super().__init__(reason)
        self.laws = laws
