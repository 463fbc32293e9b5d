"""Values on a passage over a singular position (``c/passage.h``)."""

from __future__ import annotations

import numpy as np

from lmoc.engine.library import library

_BESIDE = 4


def lagrange(places: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the values (times, places) of polynomials, each one at its own place and zero at the others."""
    own, found = np.ascontiguousarray(places, float), np.empty((len(times), len(places)))
    for row, time in zip(found, times.tolist(), strict=True):
        library().lmoc_lagrange(len(own), own.ctypes.data, time, row.ctypes.data)
    return found


def places_beside(time: float, singular: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return from which times (k,), with which weights (k,), values at a time on a passage are made up."""
    times, weights = np.empty(_BESIDE), np.empty(_BESIDE)
    count = library().lmoc_passage_beside(time, singular, width, times.ctypes.data, weights.ctypes.data)
    return times[:count], weights[:count]
