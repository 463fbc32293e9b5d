"""Laws that act on each other: the connected components of a coupling matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def groups(coupled: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return the connected components of a symmetric matrix (n, n), each as places in order."""
    left = np.ones(len(coupled), bool)
    found = []
    for start in range(len(coupled)):
        if not left[start]:
            continue
        left[start] = False
        own, front = [start], coupled[start] & left
        while front.any():
            left &= ~front
            own += np.flatnonzero(front).tolist()
            front = coupled[front].any(axis=0) & left
        found.append(np.array(sorted(own)))
    return found
