"""The watch over the choice of coordinates: at every accepted step, by the condition of what it divides by."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.program import Program, needed_steps, read, written
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.tableau import Tableau, exchanged, rank_margin, tableau, vanishes
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, Buffered, Lowered, can_lower
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.integrate.status import Status
from lmoc.numerics.plan import Plan

if TYPE_CHECKING:
    import casadi

# by which the tableau's largest entry must have grown since the choice was made for another one to be looked for; and
# the largest entry that a choice may have from the beginning and still count as good
_MARGIN, _TOLERATED = 2.0, 25.0
# by which the tableau jumps from one branch to another, how near to dependent the constraints are then at the ends of a
# step however long, and as near as they are at a bifurcation
_JUMP, _NEAR, _DEPENDENT = 1.0, 0.5, 1e-2


class CoordinateWatch:
    """Judges the coordinates of one piece; called with every accepted step.

    Attributes
    ----------
    constraints : those of the reduction
    barred : (watched,) mask of dependent coordinates that cannot be states
    at : s, the time of the last step judged
    path : (times, states) of all steps judged well
    """

    def __init__(self, system: System, base: np.ndarray) -> None:
        self.system = system
        self.constraints: Constraints = system.plan.reduced.constraints
        self.barred = np.zeros(len(self.constraints.watched), bool)
        self._entries = _entries(system, base, self.constraints)
        self._size = np.zeros(0)
        self._scale: np.ndarray | None = None
        self.at = np.nan
        self._last: tuple[np.ndarray, Tableau] | None = None
        self._before: tuple[np.ndarray, Tableau] | None = None
        self.path: tuple[list[float], list[np.ndarray]] = ([], [])

    def begin(self, t: float, x: np.ndarray) -> Status:
        """Judge the place where the piece begins; its coordinates are compared with what they are there."""
        matrix = self._matrix(t, x)
        self._size, self._scale = np.zeros(matrix.shape), None
        found = self._look(matrix)
        worst = found.worst(~self.barred)
        self.limit = _MARGIN * min(max(1.0, worst), _TOLERATED)
        self._last, self.at = (matrix, found), t
        self._note(t, x)
        return Status.COORDINATES if worst > self.limit or vanishes(matrix) else Status.OK

    def __call__(self, t: float, x: np.ndarray) -> Status:
        """Judge an accepted step: COORDINATES where others have become better by a margin."""
        matrix = self._matrix(t, x)
        found = self._look(matrix)
        self.at = t
        self._before, self._last = self._last, (matrix, found)
        if found.worst(~self.barred) > self.limit or self.passed_a_singular_place:
            return Status.COORDINATES
        self._note(t, x)
        return Status.OK

    def stuck(self, status: Status) -> Status:
        """Return COORDINATES where no step was short enough and others would be better here."""
        return Status.COORDINATES if self.better() else status

    def better(self) -> list[list[int]]:
        """Return choices of coordinates (columns to be the states) that are better than the present one, best first.

        Those that are good where the step rejected has led to, as long as it has passed no singular place; otherwise
        those that are best where it began.
        """
        passed = self._before is not None and self.passed_a_singular_place
        matrix, found = self._before if passed else self._last
        if found.sign == 0.0:
            held = self._by_pivots(matrix)
            return [held] if held else []
        exchanges = exchanged(found, self.barred)
        some = [exchanges, exchanges[:1]] if len(exchanges) > 1 else [exchanges] if exchanges else []
        return [self._states(e) for e in some]

    def bar(self, refused: Collection[int]) -> None:
        """Take note of flat variables that cannot be states."""
        self.barred |= np.isin(self.constraints.variable[self.constraints.watched], list(refused))

    @property
    def passed_a_singular_place(self) -> bool:
        """Whether the last step judged has led over a place where the coordinates do not determine the rest.

        The determinant has changed its sign; or else the constraints have come near to depend on each other, and the
        tableau, which gives the velocities, has jumped: the solution is on another branch.
        """
        before, last = self._before, self._last
        if before is None or last[1].sign == 0.0:
            return last[1].sign == 0.0
        if before[1].sign != last[1].sign:
            return True
        jump = float(np.abs(last[1].table - before[1].table).max(initial=0.0))
        return jump > _JUMP and self._margin() < _NEAR

    def tolerate(self) -> None:
        """Take the last step's coordinates for as good as they can be."""
        self.limit = _MARGIN * max(self.limit, self._last[1].worst(~self.barred))

    @property
    def bifurcation(self) -> bool:
        """Whether no choice of coordinates serves about here, neither where the last step begins nor where it ends."""
        place = self._before or self._last
        size = self._size.max(axis=1, keepdims=True)
        return self._margin() < _DEPENDENT and rank_margin(place[0], size) < 5 * _DEPENDENT

    def lost(self) -> int:
        """Return the flat variable that follows least from the states."""
        table = self._last[1].table
        worst = np.where(np.isfinite(table), np.abs(table), np.inf)
        row = int(np.argmax(worst.max(axis=1, initial=0.0)))
        return int(self.constraints.variable[self.constraints.watched[row]])

    # ------------------------------------------------------------------ behind it

    def _margin(self) -> float:
        """The smallest singular value of the constraints at the ends of the last step, in rows of the sizes so far."""
        places = [p[0] for p in (self._before, self._last) if p is not None]
        size = self._size.max(axis=1, keepdims=True)
        return min(rank_margin(matrix, size) for matrix in places)

    def _note(self, t: float, x: np.ndarray) -> None:
        self.system.mark()
        self.path[0].append(t)
        self.path[1].append(x.copy())

    def _matrix(self, t: float, x: np.ndarray) -> np.ndarray:
        own = self.constraints
        count = int(own.row.max()) + 1
        matrix = np.zeros((count, len(own.variable)))
        np.add.at(matrix, (own.row, own.column), self._entries(t, x))
        return matrix

    def _look(self, matrix: np.ndarray) -> Tableau:
        """Rows and columns are compared in the sizes that they have had so far: one that vanishes now is small."""
        size = np.abs(matrix)
        if not (size <= self._size).all():
            with np.errstate(invalid="ignore"):
                self._size = np.fmax(self._size, size)
            self._scale = None
        if self._scale is None:
            row = self._size.max(axis=1, keepdims=True)
            scale = (self._size / np.where(row > 0, row, 1.0)).max(axis=0)
            self._scale = np.where(scale > 0, scale, 1.0)
        return tableau(matrix, self.constraints.watched, self._scale)

    def _states(self, exchanges: list[tuple[int, int]]) -> list[int]:
        """The columns that are states after some exchanges."""
        own = self.constraints
        rows = int(own.row.max()) + 1
        held, dependent = list(range(rows, len(own.variable))), own.watched.tolist()
        for i, j in exchanges:
            dependent[i], held[j] = held[j], dependent[i]
        return held

    def _by_pivots(self, matrix: np.ndarray) -> list[int]:
        """The states left where the dependent coordinates are chosen anew, by elimination with full pivoting."""
        rows = len(matrix)
        a = matrix / np.where((size := np.abs(self._size).max(axis=1, keepdims=True)) > 0, size, 1.0)
        chosen: list[int] = []
        left = list(range(rows))
        for _ in range(rows):
            block = np.abs(a[left])
            block[:, chosen] = 0.0
            i, j = np.unravel_index(int(np.argmax(block)), block.shape)
            if not block[i, j] > 1e-12:
                return []
            r = left.pop(int(i))
            chosen.append(int(j))
            a[left] -= np.outer(a[left, j] / a[r, j], a[r])
        held = [k for k in range(matrix.shape[1]) if k not in chosen]
        return held if held != list(range(rows, matrix.shape[1])) else []


def _entries(system: System, base: np.ndarray, own: Constraints) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return ``(t, x) -> entries``, from the registers of a system that keeps them, else by a function of its own."""
    plan, kept = system.plan, system.registers is not None
    program, used, function = plan.once(_from_registers if kept else _from_states)
    out, sampled = np.empty(system.n), np.zeros(len(plan.sampled))
    if function is None:
        w, interpreter = np.zeros(own.count), Interpreter(program, own.count)

        def by_numpy(t: float, x: np.ndarray) -> np.ndarray:
            _evaluate(system, t, x, out)
            w[: plan.count] = system.registers[: plan.count]
            interpreter.run(w, t)
            return w[own.register]

        return by_numpy
    time, at, known = np.zeros(1), np.zeros(0 if kept else len(plan.states)), base[used].copy()
    call = Buffered(function, (time, at, known, np.zeros(0) if kept else sampled))

    def entries(t: float, x: np.ndarray) -> np.ndarray:
        time[0] = t
        if kept:
            _evaluate(system, t, x, out)
            np.take(system.registers, used, out=known)
        else:
            at[:] = x
            system.sample(t, sampled)
        call()
        return call.results[0].copy()

    return entries


def _from_registers(plan: Plan) -> tuple[Program, np.ndarray, casadi.Function | None]:
    """The entries from the registers of the system: a program, the registers it reads, and the compiled function."""
    own, none = plan.reduced.constraints, np.zeros(0, int)
    return _lowered(own, own.program, none, none)


def _from_states(plan: Plan) -> tuple[Program, np.ndarray, casadi.Function | None]:
    """Return the function that computes the entries from the states and sampled inputs."""
    own = plan.reduced.constraints
    program = needed_steps((*plan.program, *own.program), own.register, own.count)
    return _lowered(own, program, plan.states, plan.sampled)


def _lowered(
    own: Constraints, program: Program, states: np.ndarray, signals: np.ndarray
) -> tuple[Program, np.ndarray, casadi.Function | None]:
    inside = np.zeros(own.count, bool)
    for registers in (*map(written, program), states, signals):
        inside[registers] = True
    used = np.zeros(own.count, bool)
    for step in program:
        used[read(step)] = True
    reads = np.flatnonzero(used & ~inside)
    if not can_lower(program) or sum(len(written(s)) for s in program) > CASADI_ROWS:
        return program, reads, None
    function = Lowered(program, own.count, states, reads, signals, own.register).function("constraints")
    return program, reads, function


def _evaluate(system: System, t: float, x: np.ndarray, out: np.ndarray) -> None:
    """Fill the system's registers; the look does not count as one of the method's evaluations."""
    count = system.evaluations
    system.rhs(t, x, out)
    system.evaluations = count
