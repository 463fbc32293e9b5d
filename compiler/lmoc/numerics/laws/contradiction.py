"""Laws that no forces, impulses or states satisfy together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from lmoc.numerics.laws.complementarity import NoSolution

_SHARE = 1e-3  # of the largest iterate: a component below it does not take part in the contradiction


class Contradiction(Exception):
    """The laws of a scene contradict each other at an instant.

    Attributes
    ----------
    laws : (k,) the laws that take part
    """

    def __init__(self, laws: NDArray[np.int64], reason: str) -> None:
        super().__init__(reason)
        self.laws = laws


@contextmanager
def solving(laws: NDArray[np.int64], reason: str) -> Iterator[None]:
    """Turn a problem without a solution into a contradiction between the laws that its components belong to.

    The iterates of the proximal point method grow without bound in the components that cannot be satisfied
    (`numerics.laws.complementarity`), so that their sizes say which laws these are.
    """
    try:
        yield
    except NoSolution as failed:
        size = np.abs(failed.x)
        raise Contradiction(laws[size >= _SHARE * size.max()], reason) from None
