"""The next mode: which laws hold once everything at an instant is taken together (``engine/c/mode.c``)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import NO_SOLUTION, Array, checked, numbers
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import Instant, LawTable, Mask
from lmoc.numerics.problem.mode import Mode
from lmoc.support.records import dataclass

STILL = 1e-11  # rates below this share of the velocities that make them are zero


class _Levels(ctypes.Structure):
    """``lmoc_levels`` in ``engine/c/laws.h``."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("bias", "delassus", "slip", "stick")]


class _Settled(ctypes.Structure):
    """``lmoc_settled`` in the same."""

    _fields_ = [
        (name, ctypes.c_void_p)
        for name in ("closed", "implied", "unique", "laws", "direction", "push", "force", "level")
    ]


@dataclass(frozen=True, eq=False)
class Settled:
    """A mode with its forces.

    Attributes
    ----------
    mode : Mode
    force, level : (n,) forces of the laws, and the level quantities that they lead to
    unique : (n,) whether the force is determined
    """

    mode: Mode
    force: Array
    level: Array
    unique: Mask


def settle(
    table: LawTable,
    now: Instant,
    mode: Mode,
    candidate: Mask,
    sliding: NDArray[np.int64],
    at_limit: NDArray[np.int64],
    opening: Mask | None = None,
) -> Settled:
    """Return the mode that holds from an instant on.

    Parameters
    ----------
    mode : the one before; where both sides of a law would do, it stays where it was
    candidate : (n,) laws that could be closed from here on
    sliding : (n,) direction of friction that is no candidate
    at_limit : (n,) direction in which stuck friction begins to slide that has just reached its limit, else 0
    opening : (n,) laws that could be closed but open here; others may hold their motion

    Raises
    ------
    Contradiction
        No forces satisfy the laws, such as a body pressed between two stops, or Painlevé's paradox.
    """
    n = len(candidate)
    given = [numbers(v) for v in (now.bias, now.delassus, now.slip, now.stick)]
    closed, implied, unique, laws = np.empty((4, n), bool)
    direction, (push, force, level) = np.empty(n, np.int64), np.empty((3, n))
    before = [np.ascontiguousarray(v, bool) for v in (mode.closed, candidate)]
    before += [np.ascontiguousarray(v, np.int64) for v in (sliding, at_limit)]
    others = None if opening is None else np.ascontiguousarray(opening, bool)
    results = (v.ctypes.data for v in (closed, implied, unique, laws, direction, push, force, level))
    levels, found = _Levels(*(v.ctypes.data for v in given)), _Settled(*results)
    status = library().lmoc_settle(
        ctypes.addressof(table.in_c), ctypes.addressof(levels), *(v.ctypes.data for v in before),
        None if others is None else others.ctypes.data, ctypes.addressof(found),
    )  # fmt: skip
    if status == NO_SOLUTION:
        raise Contradiction(np.flatnonzero(laws), "no forces keep them")
    checked(status, force)
    return Settled(Mode(closed, direction, implied, push), force, level, unique)


def free_mode(table: LawTable) -> Mode:
    """Return the mode in which every law is open and no friction slides."""
    n = len(table.kind)
    return Mode(np.zeros(n, bool), np.zeros(n, int), np.zeros(n, bool), np.zeros(n))
