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


class SettledInC(ctypes.Structure):
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
    laws : (n,) those that contradict each other, where there is no mode
    """

    mode: Mode
    force: Array
    level: Array
    unique: Mask
    laws: Mask

    @classmethod
    def empty(cls, count: int) -> Settled:
        """Return a place for one that C fills."""
        closed, implied, unique, laws = np.zeros((4, count), bool)
        push, force, level = np.zeros((3, count))
        return cls(Mode(closed, np.zeros(count, np.int64), implied, push), force, level, unique, laws)

    @property
    def in_c(self) -> SettledInC:
        """The structure that the engine fills; valid as long as this lives."""
        m = self.mode
        arrays = m.closed, m.implied, self.unique, self.laws, m.direction, m.push, self.force, self.level
        return SettledInC(*(a.ctypes.data for a in arrays))

    def take(self, mode: Mode) -> None:
        """Take another mode in place of this one."""
        for name in ("closed", "direction", "implied", "push"):
            getattr(self.mode, name)[:] = getattr(mode, name)


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
    given = [numbers(v) for v in (now.bias, now.delassus, now.slip, now.stick)]
    before = [np.ascontiguousarray(v, bool) for v in (mode.closed, candidate)]
    before += [np.ascontiguousarray(v, np.int64) for v in (sliding, at_limit)]
    others = None if opening is None else np.ascontiguousarray(opening, bool)
    settled = Settled.empty(len(candidate))
    levels, found = _Levels(*(v.ctypes.data for v in given)), settled.in_c
    status = library().lmoc_settle(
        ctypes.addressof(table.in_c), ctypes.addressof(levels), *(v.ctypes.data for v in before),
        None if others is None else others.ctypes.data, ctypes.addressof(found),
    )  # fmt: skip
    if status == NO_SOLUTION:
        raise Contradiction(np.flatnonzero(settled.laws), "no forces keep them")
    checked(status, settled.force)
    return settled


def free_mode(table: LawTable) -> Mode:
    """Return the mode in which every law is open and no friction slides."""
    n = len(table.kind)
    return Mode(np.zeros(n, bool), np.zeros(n, int), np.zeros(n, bool), np.zeros(n))
