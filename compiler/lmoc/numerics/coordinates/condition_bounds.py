"""A certificate that a step has kept to good coordinates: bounds of what `watch` judges.

They are the largest entry of the tableau, the sign of the determinant, a lower bound of the smallest singular value,
the length by which the scaled matrix has changed (Frobenius), the most that velocities leave unexplained of the way of
a dependent coordinate beyond what they may, and by how much an entry exceeds its bound. The singular value is bounded
by ``σ² = λ ≥ (Σ λᵢ⁻ᵖ)^(-1/p)`` of M·Mᵀ with p = 2·2ˢ, from s squarings of its inverse.

The bounds are on the safe side: where they hold, the watch comes to the same judgement in full; where they do not, it
has to be asked. Most steps of a run are certified, at a tenth of the cost.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.coordinates.bounds_kernel import BoundsKernel
from lmoc.numerics.coordinates.bounds_layout import BoundsLayout
from lmoc.numerics.coordinates.constraint_state import ConstraintState
from lmoc.numerics.coordinates.entries import at_hand, evaluate, reads_of_entries
from lmoc.numerics.coordinates.step_check import CheckLimits, Step, StepCheck
from lmoc.numerics.coordinates.tableau import Tableau
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.support.records import dataclass

MOST_ROWS = 8  # of the constraints: beyond, the bound of the smallest singular value is too coarse


@dataclass(frozen=True, eq=False)
class Scales:
    """The sizes in which a place is judged.

    Attributes
    ----------
    factor : (rows, columns) of the entries, with which rows and columns have one length
    size : (rows, columns) largest entries so far
    bound : (rows, columns) sizes with which the factors serve
    ranges : (columns,) sizes of the coordinates
    barred : (watched,) mask of rows of the tableau that do not count
    short : (watched,) ways of the dependent coordinates that need no explanation
    """

    factor: np.ndarray
    size: np.ndarray
    bound: np.ndarray
    ranges: np.ndarray
    barred: np.ndarray
    short: np.ndarray


class ConditionParts:
    """What bounds of a plan are made of.

    Attributes
    ----------
    reads : registers
    layout : BoundsLayout
    """

    def __init__(self, plan: Plan, reads: np.ndarray, layout: BoundsLayout) -> None:
        self.reads, self.layout, self._plan = reads, layout, plan

    def evaluation(self) -> BoundsKernel:
        """Return what computes the bounds of one system."""
        return BoundsKernel(self._plan, self.layout)


class ConditionBounds:
    """Computes the bounds of one system, for one step after the other.

    Attributes
    ----------
    place : where the next step begins; None where that has not been told
    """

    place: ConstraintState | None

    def __init__(self, system: System, parts: ConditionParts, registers: np.ndarray, evaluation: BoundsKernel) -> None:
        own = system.plan.reduced.constraints
        self.system, self.own = system, own
        self.place = None
        self._evaluation, self._given, self._results = evaluation, evaluation.given, evaluation.results
        self._places, self._reads, self._registers = parts.layout.places, parts.reads, registers
        self._shape, self._table = (own.rows, len(own.variable)), parts.layout.table
        self._out = np.empty(system.n)
        self._ratio: np.ndarray
        self._check: StepCheck | None = None

    def begin(self, place: ConstraintState, scales: Scales) -> None:
        """Stand at a place, and judge in these sizes from now on."""
        self.place = place
        matrix, table, before, _, factor, size, bound, scale, short = self._given
        for values, given in (
            (place.matrix, matrix),
            (scales.factor, factor),
            (scales.size, size),
            (scales.bound, bound),
        ):
            given[:] = values.ravel()[self._places]
        table[:], before[:], short[:] = place.found.plain.ravel(), place.coordinates, scales.short
        self._measure(scales.ranges)
        scale[:] = np.where(scales.barred[:, None], 0.0, self._ratio).ravel()

    def _measure(self, ranges: np.ndarray) -> None:
        """See the tableau in units of these sizes of the coordinates."""
        self._ratio = ranges[self.own.watched][:, None] / ranges[self.own.rows :]

    def __call__(self, t: float, x: np.ndarray) -> list[float]:
        """Return the bounds for the step to (t, x), as they are listed above."""
        evaluate(self.system, t, x, self._out)
        registers = self.system.registers
        self._given[3][:] = registers[self._registers]
        self._evaluation(t, registers[self._reads], self._reads)
        self._given[5][:] = self._results[2]
        return self._results[3].tolist()

    def found(self) -> tuple[np.ndarray, Tableau]:
        """Return the matrix and the tableau at the end of the step."""
        entries, table, _, bounds = self._results
        return self._of(entries, table, float(bounds[1]))

    def _of(self, entries: np.ndarray, table: np.ndarray, sign: float) -> tuple[np.ndarray, Tableau]:
        matrix = np.zeros(self._shape)
        matrix.flat[self._places] = entries
        if abs(sign) != 1.0:
            nothing = np.full(self._table, np.inf)
            return matrix, Tableau(nothing, 0.0, nothing)
        plain = table.reshape(self._table).copy()
        return matrix, Tableau(plain * self._ratio, sign, plain)

    def go_on(self, place: ConstraintState) -> None:
        """Stand at the end of the step."""
        self.place = place
        matrix, table, before, after, *_ = self._given
        matrix[:], table[:] = self._results[:2]
        before[:] = after

    def enter(self, limits: CheckLimits, unknowns: np.ndarray, most: int) -> int | None:
        """Return what judges up to `most` steps in C from where it stands; None where C does not evaluate the system.

        Parameters
        ----------
        unknowns : registers whose values are put on record
        """
        system = self.system.in_c()
        if system is None:
            return None
        if self._check is None or self._check.system != system:
            registers = self._reads, self._registers, unknowns
            self._check = StepCheck(self._evaluation, system, self.system.n, *registers)
        self._check.enter(self.place, limits, most)
        return self._check.address

    def left(self) -> tuple[list[Step], tuple[np.ndarray, np.ndarray] | None]:
        """Return the ends of the steps judged in C, and the factors of rows and columns where these are others now."""
        return self._check.places(), self._check.scales()

    def stand(self, places: list[Step], factor: np.ndarray, ranges: np.ndarray) -> ConstraintState:
        """Stand at the last of the places to which steps judged in C have led, if there is one; returns it.

        Parameters
        ----------
        factor, ranges : as in `Scales`, now
        """
        last = self.place
        t, x, solutions = places[-1] if places else (last.t, last.x, last.solutions)
        self._measure(ranges)
        matrix, found = self._of(self._given[0], self._given[1], last.found.sign)
        least, coordinates = self._check.least, self._given[2].copy()
        self.place = ConstraintState(t, x, matrix, found, matrix * factor, least, solutions, coordinates)
        return self.place

    def sizes(self, size: np.ndarray) -> np.ndarray:
        """Return the (rows, columns) largest entries, from those at the beginning."""
        size = size.copy()
        size.flat[self._places] = self._given[5]
        return size


def parts_of(system: System, registers: np.ndarray) -> ConditionParts | None:
    """Return what bounds of a system are made of; None where there are too many constraints, or registers are not kept.

    Parameters
    ----------
    registers : of the coordinates by the columns of the constraints (`Reduced.register_of`), or none
    """
    plan = system.plan
    own = plan.reduced.constraints
    if system.registers is None or own.rows > MOST_ROWS or not len(own.watched) or own.rows == len(own.variable):
        return None
    return plan.once(_with_coordinates if len(registers) else _without_coordinates)


def _with_coordinates(plan: Plan) -> ConditionParts | None:
    own = plan.reduced.constraints.variable
    known = np.isin(plan.reduced.register_of[own], plan.once(at_hand)).all()
    return _parts(plan, len(own)) if known else None


def _without_coordinates(plan: Plan) -> ConditionParts | None:
    return _parts(plan, 0)


def _parts(plan: Plan, told: int) -> ConditionParts | None:
    reads = reads_of_entries(plan)
    if reads is None or not np.isin(reads, plan.once(at_hand)).all():
        return None
    return ConditionParts(plan, reads, BoundsLayout(plan.reduced.constraints, told))
