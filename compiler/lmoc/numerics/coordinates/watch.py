"""The watch over the choice of coordinates: at every accepted step, by the condition of what it divides by."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from lmoc.engine.roots import lowest
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.bounds_kernel import NEIGHBOURS, UNEXPLAINED
from lmoc.numerics.coordinates.change import block_unknowns, with_solutions
from lmoc.numerics.coordinates.condition_bounds import MOST_ROWS, ConditionBounds, Scales, parts_of
from lmoc.numerics.coordinates.constraint_state import ConstraintState
from lmoc.numerics.coordinates.entries import entries_of
from lmoc.numerics.coordinates.equilibration import Equilibration
from lmoc.numerics.coordinates.local_form import LocalForm, LocalRows
from lmoc.numerics.coordinates.passage import Passage
from lmoc.numerics.coordinates.step_check import CheckLimits
from lmoc.numerics.coordinates.tableau import (
    SHARE,
    Tableau,
    exchanged,
    in_rows_of_one_size,
    rank_margin,
    scaled,
    states_after,
    states_by_pivots,
    stays_regular,
    tableau,
    vanishes,
)
from lmoc.numerics.observe.observer import Path
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System

# by which the tableau's largest entry must have grown since the choice was made for another one to be looked for; and
# the largest entry that a choice may have from the beginning and still count as good
_MARGIN, _TOLERATED = 2.0, 25.0
_HALVINGS = 4  # of a step, for a look at what happens within
_ROUNDING = 1e-6  # way of a coordinate that is none
_AT_ONCE = 0.5  # of what velocities leave unexplained, what a sixteenth of the step may have at the most
# smallest singular values, in equilibrated form: below the first a place ahead where constraints depend on each other
# is looked for, below the second they do where no step is short enough
_ALERT, _DEPENDENT = 0.1, 1e-3
_SURE = 0.12  # a lower bound of the smallest singular value with which it need not be computed


class CoordinateWatch:
    """Judges the coordinates of one segment; called with every accepted step.

    Attributes
    ----------
    constraints : those of the reduction
    barred : (watched,) mask of dependent coordinates that cannot be states
    unknowns : registers of the unknowns of the system's nonlinear blocks
    accepted : ConstraintState
        The last one judged well; the next step begins there.
    last : ConstraintState
        The last one judged.
    lost_rank : whether the last step judged has come near to a place where the constraints depend on each other, or may
        have led over it
    singular : s, where that is
    """

    def __init__(self, system: System, base: np.ndarray) -> None:
        self.system = system
        self.constraints: Constraints = system.plan.reduced.constraints
        self.barred = np.zeros(len(self.constraints.watched), bool)
        self.unknowns = system.plan.once(block_unknowns) if system.registers is not None else np.zeros(0, int)
        own = system.plan.reduced.register_of[self.constraints.variable]
        told = len(self.unknowns) > 0 and bool((own >= 0).all())
        self._registers = own if told else np.zeros(0, int)
        self._entries = entries_of(system, base, self.constraints)
        own = self.constraints
        self._place = own.row.astype(int) * len(own.variable) + own.column
        # scaled matrix of the last look, `ConstraintState.least` of it, and the factors of both
        self._recent: tuple[np.ndarray, float, tuple[np.ndarray, np.ndarray]] | None = None
        self.accepted: ConstraintState
        self.last: ConstraintState
        self.lost_rank, self.singular, self.limit = False, np.inf, 0.0
        self._parts = parts_of(system, self._registers)
        # few are seen as a whole, whose smallest singular value is then a matter of the place, not of their number
        self._form = LocalForm(system.plan) if own.rows > MOST_ROWS else None
        many = self._form is not None
        self._sizes = self._form.equilibration() if many else Equilibration(own.rows, len(own.variable))
        self._condition: ConditionBounds | None = None
        self._bounds: list[float] | None = None  # of the last look
        self._alert, self._looked_inside = _ALERT, False
        self._places: list[tuple[float, np.ndarray, np.ndarray]] = []

    def inherit(self, before: CoordinateWatch) -> None:
        """Compare entries with the sizes that they have had in the segment before, in whatever coordinates that was.

        Near a singular place all entries of a coordinate may be small: in the sizes of that place alone they would not
        show it. Beyond one the choice is still the one made before, and is compared with what it was then.
        """
        if np.array_equal(self.constraints.variable, before.constraints.variable):
            self.limit = before.limit
        (rows, own_rows), (columns, own_columns) = (
            np.intersect1d(mine, others, return_indices=True)[1:]
            for mine, others in (
                (self.constraints.source, before.constraints.source),
                (self.constraints.variable, before.constraints.variable),
            )
        )
        size = self.sizes.copy()
        size[np.ix_(rows, columns)] = before.sizes[np.ix_(own_rows, own_columns)]
        self._sizes.replace(size if self._form is None else self._form.entries(size))

    @property
    def sizes(self) -> np.ndarray:
        """Return the largest magnitude that each entry of the constraint matrix has had."""
        if self._form is not None:
            return self._form.dense(self._sizes.size)
        told = self._condition is not None and self._condition.place is not None
        return self._condition.sizes(self._sizes.size) if told else self._sizes.size

    def begin(self, t: float, x: np.ndarray) -> Status:
        """Judge the place where the segment begins; its coordinates are compared with what they are there."""
        self.last = place = self._look(t, x)
        worst = place.found.worst(~self.barred)
        self.limit = max(self.limit, _MARGIN * min(max(1.0, worst), self._tolerated))
        self._accept(place)
        return Status.COORDINATES if worst > self.limit or self._vanishes(place) else Status.OK

    @property
    def determines(self) -> bool:
        """Return whether the rest follows from the coordinates at the last place accepted, however badly."""
        return self.accepted.found.sign != 0.0 and not self._vanishes(self.accepted)

    def __call__(self, t: float, x: np.ndarray) -> Status:
        """Judge an accepted step: COORDINATES where others are better by a margin, or where it may lead astray."""
        self._make_condition()
        self.last = place = self._look(t, x)
        self.lost_rank = False
        if self._is_certain(place):
            self._accept(place)
            return Status.OK
        if place.found.worst(~self.barred) > self.limit or self.passed_a_singular_place:
            return Status.COORDINATES
        self._looked_inside = False
        keeps = self._stays_regular(self.accepted, place, _HALVINGS) and self._keeps_on(place)
        self.lost_rank = not keeps or self._comes_near(place)
        if self.lost_rank:
            return Status.COORDINATES
        if self._looked_inside:  # the system's blocks go on from the end of the step
            self._look(t, x)
        self._accept(place)
        return Status.OK

    def enter(self, most: int) -> int | None:
        """Return what judges up to `most` steps in C; None where the next is to be judged here."""
        self._make_condition()
        if self._condition is None or self._sizes.scales is None:
            return None
        self._begin_condition()
        limits = CheckLimits(self.limit, _SURE, *self._sizes.scales, self.barred)
        return self._condition.enter(limits, self.unknowns, most)

    def leave(self, t: float, x: np.ndarray) -> None:
        """Take the steps judged in C for accepted."""
        places, scales = self._condition.left()
        if scales is not None:
            self._sizes.size = self._condition.sizes(self._sizes.size)
            self._sizes.take(scales)
        self._places += places
        self.accepted = self.last = self._condition.stand(places, self._sizes.factor, self._sizes.ranges)
        self.lost_rank = False

    def stuck(self, status: Status) -> Status:
        """Return COORDINATES where no step was short enough and others would be better here, or none would serve."""
        crawling = status is Status.CRAWLING  # not the fault of coordinates: they are watched
        self.lost_rank = self.accepted.margin < (_ALERT if crawling else _DEPENDENT)
        if crawling and not self.lost_rank:  # begun so near that all entries of a column have been small ever since
            self.lost_rank = self.margin_at_once(self.accepted) < _DEPENDENT
        self.last, self.singular = self.accepted, self.accepted.t
        return Status.COORDINATES if self.lost_rank or (not crawling and self.better()) else status

    def better(self) -> list[list[int]]:
        """Return choices of coordinates (columns to be the states) that are better than the present one, best first.

        Those that are good where the step rejected has led to, as long as it has passed no singular place; otherwise
        those that are best where it began.
        """
        place = self.accepted if self.passed_a_singular_place or self.lost_rank else self.last
        if place.found.sign == 0.0:
            even = self._sizes.scaled(place.matrix)
            held = states_by_pivots(even if self._form is None else self._form.dense(even))
            return [held] if held else []
        own, exchanges = self.constraints, exchanged(place.found, self.barred)
        some = [exchanges, exchanges[:1]] if len(exchanges) > 1 else [exchanges] if exchanges else []
        return [states_after(e, own.watched, own.rows, len(own.variable)) for e in some]

    def bar(self, refused: Collection[int]) -> None:
        """Take note of flat variables that cannot be states."""
        self.barred = self.barred | np.isin(self.constraints.variable[self.constraints.watched], list(refused))
        if self._condition is not None and self._condition.place is not None:
            self._sizes.size, self._condition.place = self.sizes, None

    @property
    def passed_a_singular_place(self) -> bool:
        """Return whether the last step judged has led over a place where the coordinates do not determine the rest."""
        now, before = self.last.found, self.accepted.found
        return now.sign == 0.0 or now.sign != before.sign or now.signs != before.signs

    def tolerate(self) -> None:
        """Take the last step's coordinates for as good as they can be."""
        self.limit = _MARGIN * max(self.limit, self.last.found.worst(~self.barred))

    @property
    def path(self) -> Path:
        """Return the places judged well."""
        times, states, solutions = (np.array(column) for column in zip(*self._places, strict=True))
        return Path(times, states, self.unknowns, solutions)

    @property
    def cornered(self) -> bool:
        """Return whether the constraints almost depend on each other where the next step would begin."""
        return self.lost_rank and self.accepted.margin < _DEPENDENT

    def relent(self) -> None:
        """Go on towards a place where constraints depend on each other, until it is twice as near."""
        self._alert = min(self._alert, self.accepted.margin) / 2

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
            return self._rank_margin(self._sizes.scaled(self._matrix(t, states[0])), self._sizes)

        last = len(found.times) - 1
        k = int(np.argmin([margin(t) for t in found.times.tolist()]))
        t, least = lowest(margin, float(found.times[max(k - 1, 0)]), float(found.times[min(k + 1, last)]))
        return t if least < _DEPENDENT else None

    def margin_at_once(self, place: ConstraintState) -> float:
        """Return the smallest singular value of all constraints, in rows of the sizes that they have at a place."""
        whole = place.matrix if self._form is None else self._form.dense(place.matrix)
        return rank_margin(in_rows_of_one_size(whole))

    def lost(self) -> int:
        """Return the flat variable that follows least from the states."""
        table = self.last.found.table
        worst = np.where(np.isfinite(table), np.abs(table), np.inf)
        row = int(np.argmax(worst.max(axis=1, initial=0.0)))
        return int(self.constraints.variable[self.constraints.watched[row]])

    # ------------------------------------------------------------------ behind it

    @property
    def _tolerated(self) -> float:
        """Return the largest entry that counts as good: along a row of n loops the motion of one adds up n times."""
        return _TOLERATED if self._form is None else max(_TOLERATED, float(len(self._form.sizes)))

    def _accept(self, place: ConstraintState) -> None:
        self.accepted = place
        if self._bounds is not None:
            self._condition.go_on(place)
        self.system.mark()
        self._places.append((place.t, place.x, place.solutions))

    def _is_certain(self, place: ConstraintState) -> bool:
        """Return whether bounds show the last step to be good in all that is judged. Written so that NaN fails."""
        if self._bounds is None:
            return False
        worst, sign, least, change, unexplained, _ = self._bounds
        regular = least > _SURE and change <= SHARE * (self.accepted.least + least)
        return regular and worst <= self.limit and unexplained <= 0.0 and sign == self.accepted.found.sign

    def _look(self, t: float, x: np.ndarray) -> ConstraintState:
        """Rows and columns are compared in the sizes that they have had so far: one that vanishes now is small."""
        condition, sizes, self._bounds = self._condition, self._sizes, None
        solutions, coordinates, own, local = np.zeros(0), np.zeros(0), self.constraints, None
        if condition is None or sizes.scales is None:
            matrix = self._matrix(t, x)
            sizes.grow(np.abs(matrix))
            even = sizes.scaled(matrix)
            if self._form is None:
                found, least = tableau(matrix, own.watched, sizes.ranges), self._least(even)
                self._recent = even, least, sizes.scales
            else:
                found, local = self._seen_locally(self._form, even)
                least = local.margin
        else:
            self._begin_condition()
            bounds = condition(t, x)
            if bounds[-1] > 0.0:
                self._rescale()
                self._begin_condition()
                bounds = condition(t, x)
            matrix, found = condition.found()
            if bounds[-1] <= 0.0:
                self._bounds, even, least = bounds, matrix * sizes.factor, bounds[2]
            else:  # some have no value
                sizes.replace(condition.sizes(sizes.size))
                condition.place = None
                even, least = sizes.scaled(matrix), 0.0
                found = scaled(found.plain, found.sign, own.watched, sizes.ranges)
            if not least > _SURE:
                least = rank_margin(even)
        if len(self.unknowns):
            solutions = self.system.registers[self.unknowns]
        if len(self._registers):
            coordinates = self.system.registers[self._registers]
        return ConstraintState(t, x.copy(), matrix, found, even, least, solutions, coordinates, local)

    def _seen_locally(self, form: LocalForm, even: np.ndarray) -> tuple[Tableau, LocalRows]:
        """The tableau of scaled entries, and the rows of their blocks."""
        own, factors = self.constraints, self._sizes.factors()
        columns = factors[1]
        table, signs = form.followed(even)
        plain = columns[: own.rows, None] * table / columns[own.rows :]
        sign = float(np.prod(np.frombuffer(signs, np.int8))) if signs else 0.0
        found = scaled(plain[own.watched], sign, own.watched, self._sizes.ranges)
        return replace(found, signs=signs), form.local(even, self._sizes, table)

    def _vanishes(self, place: ConstraintState) -> bool:
        return vanishes(place.matrix) if self._form is None else self._form.vanishes(place.matrix)

    def _rank_margin(self, even: np.ndarray, sizes: Equilibration | None = None) -> float:
        return rank_margin(even) if self._form is None else self._form.local(even, sizes).margin

    def _make_condition(self) -> None:
        if self._condition is None and self._parts is not None:
            self._condition = ConditionBounds(self.system, self._parts, self._registers, self._parts.evaluation())

    def _begin_condition(self) -> None:
        """Have the bounds begin at the last place accepted."""
        if self._condition.place is not self.accepted:
            own = self._sizes
            short = NEIGHBOURS * own.scales[1][self.constraints.watched]
            scales = Scales(own.factor, own.size, own.bound, own.ranges, self.barred, short)
            self._condition.begin(self.accepted, scales)

    def _rescale(self) -> None:
        """Compare entries in the sizes to which they have grown, at the last place accepted as well.

        Its smallest singular value shrinks by no more than the factors of a row and of a column together.
        """
        sizes, place = self._sizes, self.accepted
        rows, columns = sizes.scales
        sizes.replace(self._condition.sizes(sizes.size))
        now = sizes.factors()
        shrunk = float((now[0] / rows).min() * (now[1] / columns).min())
        found = scaled(place.found.plain, place.found.sign, self.constraints.watched, sizes.ranges)
        self.accepted = replace(
            place, found=found, scaled=place.matrix * sizes.factor, least=place.least * min(1.0, shrunk)
        )

    def _least(self, even: np.ndarray) -> float:
        """A lower bound of the smallest singular value, which changes by no more than the matrix does (Weyl)."""
        if self._recent is not None and self._recent[2] is self._sizes.scales:
            change = (even - self._recent[0]).ravel()
            least = self._recent[1] - math.sqrt(float(change @ change))
            if least > _SURE:
                return least
        return rank_margin(even)

    def _stays_regular(self, first: ConstraintState, second: ConstraintState, halvings: int) -> bool:
        """Return whether the constraints keep their rank between two places, judged in between if necessary."""
        if self._is_regular_between(first, second):
            return True
        if not halvings:
            both = first.margin + second.margin
            self.singular = first.t + (second.t - first.t) * (first.margin / both if both else 0.5)
            return False
        self._looked_inside = True
        middle = self._look((first.t + second.t) / 2, (first.x + second.x) / 2)
        return self._stays_regular(first, middle, halvings - 1) and self._stays_regular(middle, second, halvings - 1)

    def _is_regular_between(self, first: ConstraintState, second: ConstraintState) -> bool:
        if self._form is not None:
            return self._seen_now(first).stays_regular(self._seen_now(second))
        change = self._sizes.scaled(second.matrix - first.matrix)
        return stays_regular(change, first.least + second.least) or (
            first.least + second.least < first.margin + second.margin
            and stays_regular(change, first.margin + second.margin)
        )

    def _seen_now(self, place: ConstraintState) -> LocalRows:
        """The blocks of a place in the sizes that entries have by now."""
        factors = self._sizes.factors()
        if place.local is None or place.local.factors is not factors:
            place = replace(place, local=self._form.local(self._sizes.scaled(place.matrix), self._sizes))
        return place.local

    def _keeps_on(self, place: ConstraintState) -> bool:
        """Return whether the dependent coordinates have come by their velocities to where they are.

        Constraints are the same after a whole turn of an angle, so that they do not tell if Newton's method has gone
        over to another solution. What is unexplained by velocities becomes less with every half of a step, a jump does
        not.
        """
        first, second, watched = self.accepted, place, self.constraints.watched
        before = first.unexplained(second, watched)
        way = np.abs(second.coordinates - first.coordinates)[watched] if len(before) else before
        row = int(np.argmax(before - UNEXPLAINED * way)) if len(before) else 0
        if not len(before) or not before[row] > UNEXPLAINED * way[row] + _ROUNDING:
            return True
        if before[row] < NEIGHBOURS * self._sizes.factors()[1][watched[row]]:
            return True
        most = last = before[row]
        for _ in range(_HALVINGS):
            self._looked_inside = True
            middle = self._look((first.t + second.t) / 2, (first.x + second.x) / 2)
            halves = (first, middle), (middle, second)
            first, second = max(halves, key=lambda half: half[0].unexplained(half[1], watched)[row])
            last = first.unexplained(second, watched)[row]
            most = max(most, last)  # a prescribed motion that turns round within the step has hardly come on in all
        if last <= _AT_ONCE * most + _ROUNDING:
            return True
        self.singular = (first.t + second.t) / 2
        return False

    def _comes_near(self, place: ConstraintState) -> bool:
        """Return whether the constraints are about to depend on each other, and when."""
        if place.least >= self._alert:
            return False
        before, now, length = self.accepted.margin, place.margin, place.t - self.accepted.t
        if not now < min(self._alert, before):
            return False
        self.singular = place.t + now / (before - now) * length
        return True

    def _matrix(self, t: float, x: np.ndarray) -> np.ndarray:
        entries = self._entries(t, x)
        if self._form is not None:
            return self._form.summed(entries)
        rows, columns = self._sizes.size.shape
        return np.bincount(self._place, entries, rows * columns).reshape(rows, columns)
