"""Generic numbers: with them only vanishes what vanishes for all numbers.

Multiples of the golden ratio, less their integers, differ from each other as much as can be and from what occurs in
models; they are the same at every call, and importing numpy.random would take 20 ms.
"""

from __future__ import annotations

import numpy as np

GOLDEN = 0.6180339887498949


def spread(count: int, turns: int = 1) -> np.ndarray:
    """(count,) numbers between 0 and 1, no two alike; others for each number of `turns`."""
    return spread_at(np.arange(count), turns)


def spread_at(places: np.ndarray, turns: int = 1) -> np.ndarray:
    """Return the numbers at some places of `spread`."""
    return (places + np.int64(1)) * turns * GOLDEN % 1.0
