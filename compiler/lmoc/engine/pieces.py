"""A run over the pieces between kinks, as the engine makes it (``c/pieces.c``)."""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.engine.kernel import Call


class Passing(ctypes.Structure):
    """``lmoc_pieces`` in ``c/pieces.h``."""

    _fields_ = [
        ("count", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("begin", "end", "longest")],
        *[(name, ctypes.c_int64) for name in ("most", "overrun", "all")],
        *[(name, ctypes.c_void_p) for name in ("times", "out")],
        *[(name, ctypes.c_int64) for name in ("outputs", "room")],
        ("kept", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("passed", "steps", "rejected", "evaluations", "reached")],
        *[(name, ctypes.c_double) for name in ("before", "time")],
        ("stuck", ctypes.c_int64),
    ]


Bounds = tuple[np.ndarray, np.ndarray, np.ndarray]


def passing(
    call: Call, bounds: Bounds, times: np.ndarray, out: np.ndarray, most: tuple[int, int, int]
) -> Passing:
    """Return what C is told of the pieces ahead; valid as long as the arrays live.

    Parameters
    ----------
    bounds : (k,) where each begins and ends, and its longest step, s
    times, out : (m,) output times ahead, each within its piece; (room, n) the states at the first of them
    most : steps and rejected ones in a piece, more of them where these are expected to reach its end, and steps after
        which no piece is begun
    """
    kept = np.empty(call.n + 3 * (call.remembered + call.given))
    arrays = *bounds, times, out, kept
    begin, end, longest, own, states, memory = (a.ctypes.data for a in arrays)
    made = Passing(len(bounds[0]), begin, end, longest, *most, own, states, len(times), len(out), memory)
    made.arrays = arrays  # kept alive with it
    return made
