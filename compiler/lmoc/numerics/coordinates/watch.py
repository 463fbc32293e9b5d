"""The watch over the choice of coordinates: at every accepted step, by the condition of what it divides by."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from lmoc.engine.roots import lowest
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.change import block_unknowns, with_solutions
from lmoc.numerics.coordinates.entries import entries_of
from lmoc.numerics.coordinates.judge import VALUES, Judge, Place, Step, StepWatch, reads_in_c
from lmoc.numerics.coordinates.limits import LIMITS
from lmoc.numerics.coordinates.local_form import LocalForm
from lmoc.numerics.coordinates.local_places import LocalPlaces, local_limits
from lmoc.numerics.coordinates.passage import Passage
from lmoc.numerics.coordinates.tableau import coordinate_units, in_rows_of_one_size, rank_margin, states_by_pivots
from lmoc.numerics.observe.observer import Path
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System

MOST_ROWS = 8  # seen as a whole: their smallest singular value is then a matter of the place, not of their number


class CoordinateWatch:
    """Judges the coordinates of one segment; called with every accepted step.

    Attributes
    ----------
    constraints : those of the reduction
    unknowns : registers of the unknowns of the system's nonlinear blocks
    judge : who does it, in C
    local : sees the constraints block by block; None where they are seen as a whole
    """

    def __init__(self, system: System, base: np.ndarray) -> None:
        self.system, plan = system, system.plan
        self.constraints: Constraints = plan.reduced.constraints
        own = self.constraints
        self.unknowns = plan.once(block_unknowns) if system.registers is not None else np.zeros(0, int)
        self._told = told_registers(plan) if len(self.unknowns) else np.zeros(0, int)
        self._entries = entries_of(system, base, own)
        self._place = own.place
        sizes = len(self.unknowns), len(self._told), system.n
        form = LocalForm(plan) if own.rows > MOST_ROWS else None
        entries, limits = (None, LIMITS) if form is None else (form.count, local_limits(form))
        units = coordinate_units(plan, base[plan.known[0]])
        self.judge = Judge(own, units, sizes, self._answer, limits, entries)
        self.local = None if form is None else LocalPlaces(form, self.judge)
        self._in_c = self._made_in_c() if form is None else None
        self._places: list[Step] = []

    def _made_in_c(self) -> StepWatch | None:
        system, own = self.system, self.constraints
        states = len(own.variable) - own.rows
        reads = reads_in_c(system.plan, self._told) if system.registers is not None and states else None
        if reads is None or system.in_c() is None:
            return None
        return StepWatch(system.plan, self.judge, reads, self._told, self.unknowns)

    def inherit(self, before: CoordinateWatch) -> None:
        """Compare entries with the sizes that they have had in the segment before, in whatever coordinates that was.

        Near a singular place all entries of a coordinate may be small: in the sizes of that place alone they would not
        show it. Beyond one the choice is still the one made before, and is compared with what it was then.
        """
        if np.array_equal(self.constraints.variable, before.constraints.variable):
            self.judge.data.limit = before.judge.data.limit
        both = zip(self.constraints.keys, before.constraints.keys, strict=True)
        (rows, own_rows), (columns, own_columns) = (_common(mine, theirs) for mine, theirs in both)
        size = self.sizes.copy()
        size[np.ix_(rows, columns)] = before.sizes[np.ix_(own_rows, own_columns)]
        if self.local is None:
            self.judge.grown(size.ravel())
        else:
            self.local.sizes.replace(self.local.form.entries(size))

    @property
    def sizes(self) -> np.ndarray:
        """Return the largest magnitude (rows, columns) that each entry of the constraint matrix has had."""
        if self.local is not None:
            return self.local.form.dense(self.local.sizes.size)
        return self.judge.size.reshape(self.constraints.rows, -1)

    @property
    def accepted(self) -> Place:
        """Return the last place judged well; the next step begins there."""
        return self.judge.accepted

    @property
    def last(self) -> Place:
        """Return the last place judged."""
        return self.judge.last

    def begin(self, t: float, x: np.ndarray) -> Status:
        """Judge the place where the segment begins; its coordinates are compared with what they are there."""
        self._stand_by()
        serve = self.judge.begin(t, x)
        self._accepted()
        return Status.OK if serve else Status.COORDINATES

    @property
    def determines(self) -> bool:
        """Return whether the rest follows from the coordinates at the last place accepted, however badly."""
        return self.accepted.sign != 0.0 and not self.judge.vanishes(self.accepted)

    def __call__(self, t: float, x: np.ndarray) -> Status:
        """Judge an accepted step: COORDINATES where others are better by a margin, or where it may lead astray."""
        self._stand_by()
        serve = self.judge(t, x)
        if serve:
            self._accepted()
        return Status.OK if serve else Status.COORDINATES

    def enter(self, most: int) -> int | None:
        """Return what judges up to `most` steps in C; None where the next is to be judged here."""
        self._stand_by()
        return None if self._in_c is None else self._in_c.enter(most)

    def leave(self, t: float, x: np.ndarray) -> None:
        """Take the steps judged in C for accepted."""
        self._places += self._in_c.left()
        self.judge.stuck(0.0)

    def stuck(self, status: Status) -> Status:
        """Return COORDINATES where no step was short enough and others would be better here, or none would serve."""
        crawling = status is Status.CRAWLING  # not the fault of coordinates: they are watched
        lost_rank = self.judge.stuck(LIMITS.alert if crawling else LIMITS.dependent)
        if crawling and not lost_rank:  # begun so near that all entries of a column have been small ever since
            lost_rank = self.margin_at_once(self.accepted) < LIMITS.dependent
            self.judge.data.lost_rank = lost_rank
        return Status.COORDINATES if lost_rank or (not crawling and self.better()) else status

    @property
    def lost_rank(self) -> bool:
        """Return whether the last step has come near to a place where constraints depend on each other, or over it."""
        return bool(self.judge.data.lost_rank)

    @property
    def singular(self) -> float:
        """Return when that is, s."""
        return float(self.judge.data.singular)

    @property
    def margin(self) -> float:
        """The smallest singular value of the constraints at the last place accepted, rows and columns of one length."""
        return self.judge.margin(self.accepted)

    def better(self) -> list[list[int]]:
        """Return choices of coordinates (columns to be the states) that are better than the present one, best first."""
        place = self.accepted if self.judge.passed() or self.lost_rank else self.last
        if self.local is not None and place.sign == 0.0:
            held = states_by_pivots(self.local.form.dense(self.local.sizes.scaled(place.matrix)))
            return [held] if held else []
        return self.judge.better()

    def bar(self, refused: Collection[int]) -> None:
        """Take note of flat variables that cannot be states."""
        own = self.constraints
        self.judge.barred[: len(own.watched)] |= np.isin(own.variable[own.watched], list(refused))

    @property
    def path(self) -> Path:
        """Return the places judged well."""
        times, states, solutions = (np.array(column) for column in zip(*self._places, strict=True))
        return Path(times, states, self.unknowns, solutions)

    def go_back(self) -> None:
        """Have the nonlinear blocks go on from their solutions at the last place accepted."""
        if len(self.unknowns):
            base, signals = self.system.given
            self.system.prepare(with_solutions(base, self.unknowns, self.accepted.solutions), signals)

    def singular_within(self, found: Passage) -> float | None:
        """Return when within a passage the constraints depend on each other (s); None where they do nowhere.

        A step is rejected as well where Newton's method has gone over to another branch on the way to the place where
        the branches meet. The passage over the jump is right, but passes no singular place. The system's
        blocks are left at any place.
        """
        rate = np.empty(self.system.n)

        def margin(t: float) -> float:
            states, solutions = found.at(np.array([t]))
            self.system.rhs_near(t, states[0], self.unknowns, solutions[0], rate)
            matrix = self._matrix(t, states[0])
            if self.local is not None:
                return self.local.margin(matrix)
            return rank_margin(matrix * self.judge.row_factor[:, None] * self.judge.column_factor)

        t, least = lowest(margin, found.times)
        return t if least < LIMITS.dependent else None

    def margin_at_once(self, place: Place) -> float:
        """Return the smallest singular value of all constraints, in rows of the sizes that they have at a place."""
        whole = place.matrix if self.local is None else self.local.form.dense(place.matrix)
        every = np.arange(whole.size, dtype=np.int32)
        return rank_margin(in_rows_of_one_size(whole.shape, every, whole, self.judge.units).reshape(whole.shape))

    def lost(self) -> int:
        """Return the flat variable that follows least from the states."""
        own = self.constraints
        return int(own.variable[own.watched[self.judge.lost()]])

    # ------------------------------------------------------------------ behind it

    def _accepted(self) -> None:
        self.system.mark()
        self._places.append(self.accepted.step())

    def _stand_by(self) -> None:
        """Have C evaluate the system by what does so now."""
        if self._in_c is not None:
            self._in_c.stand_by(self.system.in_c())

    def _answer(self, what: int, t: float, x: np.ndarray, k: int, other: int) -> float:
        """Tell the judge what it cannot see by itself."""
        places = self.judge.places
        if what != VALUES:
            assert self.local is not None
            return self.local.answer(what, places[k], places[other])
        place = places[k]
        matrix = self._matrix(t, x)
        if len(self.unknowns):
            place.solutions[:] = self.system.registers[self.unknowns]
        if len(self._told):
            place.coordinates[:] = self.system.registers[self._told]
        place.matrix[:] = matrix
        if self.local is not None:
            self.local.see(place)
        return 0.0

    def _matrix(self, t: float, x: np.ndarray) -> np.ndarray:
        """The matrix of the constraints, or its entries where they are seen block by block."""
        entries = self._entries(t, x)
        if self.local is not None:
            return self.local.form.summed(entries)
        shape = self.constraints.shape
        return np.bincount(self._place, entries, shape[0] * shape[1]).reshape(shape)


def told_registers(plan: Plan) -> np.ndarray:
    """Return the registers of the coordinates of a plan's constraints; none without blocks, or where some have none."""
    registers = plan.reduced.register_of[plan.reduced.constraints.variable]
    told = len(plan.once(block_unknowns)) > 0 and bool((registers >= 0).all())
    return registers if told else np.zeros(0, int)


def _common(mine: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where what both have stands in each."""
    _, own, theirs = np.intersect1d(mine, others, return_indices=True)
    return own, theirs
