"""Nonlinear blocks along a trajectory: each solution is sought near the one before it.

A block may have several solutions (the two ways to close a linkage), and the right one is the one that continues the
motion. Newton's method finds it where it starts near enough. Where output times are too far apart for that, the way
between them is gone in shorter steps: continuation with step size control after Deuflhard, Newton Methods for
Nonlinear Problems (2004), section 5.1, along the straight line between the two states.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from lmoc.numerics.solve.newton import Newton

SHORTEST = 2.0**-10  # of the way between two output times
_KEPT = 32  # places to go on from: more than a search for roots looks at in a step, and few to choose from

Solved = tuple[tuple[np.ndarray, float], list[np.ndarray | None]]  # registers given, time, and what has been found


class Follower:
    """Runs a program at one time after the other.

    Parameters
    ----------
    run : ``(w, time)`` fills the registers (count,) from those given
    newtons : the solvers of all nonlinear blocks in it
    unknowns : the registers of each of these, in the shape of its solutions
    """

    def __init__(
        self,
        run: Callable[[np.ndarray, float], None],
        newtons: Sequence[Newton],
        unknowns: Sequence[np.ndarray] = (),
    ) -> None:
        self.run = run
        self.newtons, self.unknowns = newtons, unknowns
        self.before: tuple[np.ndarray, float] | None = None  # where all blocks have been solved last
        self._known: deque[Solved] = deque(maxlen=_KEPT)  # this place and those before it, with their solutions
        self._lost = 0  # times in a row without a solution

        self._marked: tuple[tuple[np.ndarray, float], list[np.ndarray | None]] | None = None

    def forget(self) -> None:
        self.before, self._marked, self._lost = None, None, 0
        self._known.clear()

    def mark(self) -> None:
        """Take the last solutions for some to go back to, where the way from later ones fails."""
        if self.before is not None:
            self._marked = self.before, self._solutions()

    def go_back(self) -> None:
        """Go on from the solutions marked last."""
        if self._marked is not None:
            self.before, marked = self._marked
            self._restore(marked)
            self._known.clear()

    def __call__(self, w: np.ndarray, times: np.ndarray) -> None:
        """Fill w (registers, times)."""
        for k, t in enumerate(times.tolist()):
            column = np.ascontiguousarray(w[:, k])
            self.go(column, t)
            w[:, k] = column

    def begin_at(self, w: np.ndarray) -> None:
        """Go on from solutions that stand in the registers (registers,)."""
        self.forget()
        for newton, unknowns in zip(self.newtons, self.unknowns, strict=True):
            newton.last = w[unknowns]

    def go(self, w: np.ndarray, time: float) -> None:
        """Fill w (registers,) at a time that may lie ahead of the last one or behind it.

        It is gone to from the place nearest to it in time: a search within a step returns to where the step begins, and
        from its end Newton's method may come to another branch there.
        """
        if len(self._known) > 1:
            self.before, nearest = min(reversed(self._known), key=lambda known: abs(known[0][1] - time))
            self._restore(nearest)
        given, solutions = w.copy(), self._solutions()
        if self._lost & (self._lost - 1):  # all ways are tried again only when as long without a solution as before
            self._seek(w, time, False)
            if not self._near():
                self._lost += 1
                self._restore(solutions)
                return
        self._seek(w, time, self.before is None)
        if self.before is not None and not self._near():
            self._restore(solutions)
            solutions, arrived = self._approach(*self.before, given, time)
            if not arrived and self._marked is not None:  # the last solutions may stand at an attempt that led astray
                self.before, marked = self._marked
                self._restore(marked)
                solutions, arrived = self._approach(*self.before, given, time)
            w[:] = given
            self._seek(w, time, True)
        if all(np.isfinite(newton.target).all() for newton in self.newtons):
            self.before, self._lost = (given, time), 0
            self._known.append((self.before, self._solutions()))
        else:
            self._lost += 1
            self._restore(solutions)

    def _approach(
        self, old: np.ndarray, old_time: float, new: np.ndarray, time: float
    ) -> tuple[list[np.ndarray | None], bool]:
        """The solutions at `time`, or where the way to it ends: at a singular place, or where there are none.

        The second result tells whether it has led all the way.
        """
        reached, step, solutions = 0.0, 0.5, self._solutions()
        while reached < 1.0 and step >= SHORTEST:
            goal = min(1.0, reached + step)
            w = np.where(old == new, new, (1.0 - goal) * old + goal * new)
            self._seek(w, (1.0 - goal) * old_time + goal * time, False)
            if self._near():
                reached, step, solutions = goal, 2.0 * step, self._solutions()
            else:
                self._restore(solutions)
                step /= 2.0
        return solutions, reached >= 1.0

    def _seek(self, w: np.ndarray, time: float, patient: bool) -> None:
        for newton in self.newtons:
            newton.patient = patient
        self.run(w, time)

    def _near(self) -> bool:
        return all(newton.near for newton in self.newtons)

    def _solutions(self) -> list[np.ndarray | None]:
        return [newton.last for newton in self.newtons]

    def _restore(self, solutions: Sequence[np.ndarray | None]) -> None:
        for newton, last in zip(self.newtons, solutions, strict=True):
            newton.last = last
