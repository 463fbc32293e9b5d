"""Passing a bifurcation on the branch on which the velocities are continuous (``engine/c/passage.c``)."""

from __future__ import annotations

import ctypes
from functools import lru_cache

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import library
from lmoc.engine.passage import lagrange
from lmoc.numerics.coordinates.change import block_unknowns
from lmoc.numerics.problem.system import System
from lmoc.support.records import dataclass

_STAGES, _FEWER = 8, 6  # even, so that none is in the middle; two orders are compared
_FOUND, _NO_MEMORY = 1, 3
_NEAR = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 4)


class _Passage(ctypes.Structure):
    """``lmoc_passage``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("n", "m")],
        *[(name, ctypes.c_void_p) for name in ("owner", "near", "gauss", "times", "states", "solutions", "slopes")],
        *[(name, ctypes.c_void_p) for name in ("slope", "rates", "curvature", "end", "x", "sought", "found")],
        ("halted", ctypes.c_int64),
    ]


@dataclass(frozen=True, eq=False)
class Passage:
    """A step over a place where the constraints depend on each other.

    Attributes
    ----------
    times : (k,) s, its beginning, the stages, its end
    states : (k, n)
    solutions : (k, m) of the nonlinear blocks
    """

    times: np.ndarray
    states: np.ndarray
    solutions: np.ndarray

    @property
    def width(self) -> float:
        """s"""
        return float(self.times[-1] - self.times[0])

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states and solutions of the blocks at times within, by the polynomial through all places."""
        weights = lagrange(self.times, times)
        return weights @ self.states, weights @ self.solutions


def passage(
    system: System, place: tuple[float, np.ndarray, np.ndarray], width: float, tolerance: np.ndarray
) -> Passage | None:
    """Return a step from a place to beyond the singular one in its middle; None where it cannot be trusted.

    Parameters
    ----------
    system : its blocks are left at any place
    place : s, (n,) the state, and the solutions of the blocks
    width : s, of the step
    tolerance : (n,) of the state at its end
    """
    time, x, solutions = place
    n, m, unknowns = len(x), len(solutions), system.plan.once(block_unknowns)
    asked = Answers(_NO_MEMORY)

    def near(_: int, t: float, x: int, near: int, slope: int, found: int) -> int:
        def work() -> None:
            system.rhs_near(t, doubles(x, n).copy(), unknowns, doubles(near, m).copy(), out := np.empty(n))
            doubles(slope, n)[:] = out
            doubles(found, m)[:] = system.registers[unknowns]

        return asked.answer(work)

    hook = _NEAR(near)
    table = gauss_tables()
    own = _Passage(n, m, None, ctypes.cast(hook, ctypes.c_void_p).value, table.ctypes.data)
    lib, reference, count = library(), ctypes.byref(own), _STAGES + 2
    memory = np.zeros(lib.lmoc_passage_lay_out(reference, None))
    lib.lmoc_passage_lay_out(reference, memory.ctypes.data)
    times, states, found = np.split(memory[: count * (1 + n + m)], [count, count * (1 + n)])
    times[0], states[:n], found[:m] = time, x, solutions
    tolerance = np.ascontiguousarray(tolerance, float)
    if asked.judge(lib.lmoc_passage_find(reference, width, tolerance.ctypes.data)) != _FOUND:
        return None
    return Passage(times, states.reshape(count, n), found.reshape(count, m))


@lru_cache(maxsize=1)
def gauss_tables() -> np.ndarray:
    """Return nodes in 0 … 1, the matrix, and the weights of Gauss's methods of fewer stages and of all, in a row."""
    return np.concatenate([part.ravel() for stages in (_FEWER, _STAGES) for part in _gauss(stages)])


def _gauss(stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, weights = np.polynomial.legendre.leggauss(stages)
    nodes = (points + 1) / 2
    matrix = np.array([(c * weights / 2) @ lagrange(nodes, c * nodes) for c in nodes])
    return nodes, matrix, weights / 2
