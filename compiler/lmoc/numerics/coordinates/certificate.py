"""A certificate that a step has kept to good coordinates: bounds of what `watch` judges, in one casadi function.

The bounds are on the safe side: where they hold, the watch comes to the same judgement in full; where they do not, it
has to be asked. Most steps of a run are certified, at a tenth of the cost.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.certificate_layout import Layout
from lmoc.numerics.coordinates.compiled_certificate import CompiledCertificate, Text
from lmoc.numerics.coordinates.entries import at_hand, evaluate, lowered_entries, reads_of_entries
from lmoc.numerics.coordinates.equilibration import GROWN
from lmoc.numerics.coordinates.judge import Judge, Judged, Step
from lmoc.numerics.coordinates.place import Place
from lmoc.numerics.coordinates.tableau import AGAIN, NORMAL, ROUNDING, Tableau
from lmoc.numerics.coordinates.unrolled_tableau import MOST_ROWS, unrolled
from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    import casadi

# of the way of a dependent coordinate: as much as velocities may leave unexplained before it is looked at what happens
# within a step
UNEXPLAINED = 0.5
NEIGHBOURS = 0.02  # in equilibrated form, about radians: solutions nearer than that are so at singular places alone
_WORTHWHILE = 50  # steps after which casadi's function is made
_SQUARINGS = 2  # of the inverse, with which the bound of the smallest singular value is within a tenth for eight rows


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


class _ByCasadi:
    """The casadi function on arrays of its own."""

    def __init__(self, function, layout: Layout) -> None:
        self._time, nothing = np.zeros(1), np.zeros(0)
        self._known = np.zeros(function.nnz_in(2))
        self.given, _ = layout.given()
        self._call = Buffered(function, (self._time, nothing, self._known, nothing, *self.given))
        self.results = self._call.results

    def __call__(self, t: float, known: np.ndarray, reads: np.ndarray) -> None:
        self._time[0], self._known[:] = t, known
        self._call()


class Recipe:
    """The parts of which certifiers of a plan are made.

    Attributes
    ----------
    reads : registers
    layout : Layout
    """

    def __init__(self, plan: Plan, reads: np.ndarray, layout: Layout) -> None:
        self.reads, self.layout, self._plan = reads, layout, plan
        own, (watched, states) = plan.reduced.constraints, layout.table
        sizes = {"ROWS": own.rows, "COLUMNS": len(own.variable), "COUNT": len(layout.places), "STATES": states,
                 "ENTRIES": len(own.register), "WATCHED": watched, "TOLD": layout.told, "SQUARINGS": _SQUARINGS,
                 "UNEXPLAINED": UNEXPLAINED, "GROWN": GROWN, "NEIGHBOURS": NEIGHBOURS, "AGAIN": AGAIN,
                 "NORMAL": NORMAL, "ROUNDING": ROUNDING}  # fmt: skip
        self._text = Text(plan, layout, "".join(f"#define {name} {value}\n" for name, value in sizes.items()))

    @cached_property
    def _function(self) -> casadi.Function:
        import casadi as ca

        _, _, lowered = lowered_entries(self._plan, kept=True)
        given, outputs = certificate(lowered.out, self._plan.reduced.constraints, self.layout)
        arguments = [lowered.time, lowered.x, lowered.p, lowered.u, *given]
        return ca.Function("certificate", arguments, [ca.densify(o) for o in outputs])

    def evaluation(self, steps: int) -> _ByCasadi | CompiledCertificate | None:
        """Return the compiled function; where there is none casadi's, if so many steps of a run show it to be worth it.
        """
        library = self._text.library
        if library is not None:
            return CompiledCertificate(self._plan, self._text.function, library, self.layout)
        return None if steps < _WORTHWHILE else _ByCasadi(self._function, self.layout)


class Certifier:
    """Computes the bounds of one system, for one step after the other.

    Attributes
    ----------
    place : where the next step begins; None where that has not been told
    """

    place: Place | None

    def __init__(self, system: System, recipe: Recipe, registers: np.ndarray, evaluation) -> None:
        own = system.plan.reduced.constraints
        self.system, self.own = system, own
        self.place = None
        self._evaluation, self._given, self._results = evaluation, evaluation.given, evaluation.results
        self._places, self._reads, self._registers = recipe.layout.places, recipe.reads, registers
        self._shape, self._table = (own.rows, len(own.variable)), recipe.layout.table
        self._out = np.empty(system.n)
        self._ratio: np.ndarray
        self._judge: Judge | None = None

    def begin(self, place: Place, scales: Scales) -> None:
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
        """Return the bounds for the step to (t, x), as `certificate` lists them."""
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

    def go_on(self, place: Place) -> None:
        """Stand at the end of the step."""
        self.place = place
        matrix, table, before, after, *_ = self._given
        matrix[:], table[:] = self._results[:2]
        before[:] = after

    def enter(self, judged: Judged, unknowns: np.ndarray, most: int) -> int | None:
        """Return what judges up to `most` steps in C from where it stands; None where C does not evaluate the system.

        Parameters
        ----------
        unknowns : registers whose values are put on record
        """
        system = self.system.in_c()
        if system is None or not isinstance(self._evaluation, CompiledCertificate):
            return None
        if self._judge is None or self._judge.system != system:
            registers = self._reads, self._registers, unknowns
            self._judge = Judge(self._evaluation, system, self.system.n, *registers)
        self._judge.enter(self.place, judged, most)
        return self._judge.address

    def left(self) -> tuple[list[Step], tuple[np.ndarray, np.ndarray] | None]:
        """Return the ends of the steps judged in C, and the factors of rows and columns where these are others now."""
        return self._judge.places(), self._judge.scales()

    def stand(self, places: list[Step], factor: np.ndarray, ranges: np.ndarray) -> Place:
        """Stand at the last of the places to which steps judged in C have led, if there is one; returns it.

        Parameters
        ----------
        factor, ranges : as in `Scales`, now
        """
        last = self.place
        t, x, solutions = places[-1] if places else (last.t, last.x, last.solutions)
        self._measure(ranges)
        matrix, found = self._of(self._given[0], self._given[1], last.found.sign)
        least, coordinates = self._judge.least, self._given[2].copy()
        self.place = Place(t, x, matrix, found, matrix * factor, least, solutions, coordinates)
        return self.place

    def sizes(self, size: np.ndarray) -> np.ndarray:
        """Return the (rows, columns) largest entries, from those at the beginning."""
        size = size.copy()
        size.flat[self._places] = self._given[5]
        return size


def recipe_of(system: System, registers: np.ndarray) -> Recipe | None:
    """Return how certifiers of a system are made; None where casadi does not take it, or registers are not kept.

    Parameters
    ----------
    registers : of the coordinates by the columns of the constraints (`Reduced.register_of`), or none
    """
    plan = system.plan
    own = plan.reduced.constraints
    if system.registers is None or own.rows > MOST_ROWS or not len(own.watched) or own.rows == len(own.variable):
        return None
    return plan.once(_with_coordinates if len(registers) else _without_coordinates)


def _with_coordinates(plan: Plan) -> Recipe | None:
    own = plan.reduced.constraints.variable
    known = np.isin(plan.reduced.register_of[own], plan.once(at_hand)).all()
    return _recipe(plan, len(own)) if known else None


def _without_coordinates(plan: Plan) -> Recipe | None:
    return _recipe(plan, 0)


def _recipe(plan: Plan, told: int) -> Recipe | None:
    reads = reads_of_entries(plan)
    if reads is None or not np.isin(reads, plan.once(at_hand)).all():
        return None
    return Recipe(plan, reads, Layout(plan.reduced.constraints, told))


def certificate(entries: casadi.SX, own: Constraints, layout: Layout) -> tuple[list, list]:
    """Return the symbols of `Layout.given`, and expressions of `Layout.found`.

    The bounds are the largest entry of the tableau, the sign of the determinant, a lower bound of the smallest singular
    value, the length by which the scaled matrix has changed (Frobenius), the most that velocities leave unexplained of
    the way of a dependent coordinate beyond what they may, and by how much an entry exceeds its bound.

    Parameters
    ----------
    entries : of the constraints, in their order
    """
    import casadi as ca

    places, states = layout.places, layout.table[1]
    given = [ca.SX.sym("g", len(values)) for values in layout.given()[0]]
    matrix, tableau, before, after, factor, sizes, bound, scale, short = given
    sums: list = [ca.SX(0)] * len(places)
    for k, value in zip(layout.targets.tolist(), ca.vertsplit(entries), strict=True):
        sums[k] = sums[k] + value
    now = ca.vertcat(*sums)
    table, sign = unrolled(entries, own)
    by_rows = ca.vec(table.T)
    unexplained = ca.SX(0)
    if layout.told:
        way = after - before
        dependent = ca.vertcat(*[way[k] for k in own.watched.tolist()])
        mean = ca.reshape((tableau + by_rows) / 2, states, len(own.watched)).T
        rest = ca.fabs(dependent + ca.mtimes(mean, way[own.rows :]))
        unexplained = ca.mmax(rest - ca.fmax(UNEXPLAINED * ca.fabs(dependent), short))
    larger = ca.fmax(sizes, ca.fabs(now))
    bounds = ca.vertcat(
        ca.mmax(ca.fabs(by_rows * scale)),
        sign,
        _least_singular_value(now * factor, places, own),
        ca.sqrt(ca.sumsqr((now - matrix) * factor)),
        unexplained,
        ca.mmax(larger - bound),
    )
    return given, [now, by_rows, larger, bounds]


def _least_singular_value(entries, places: np.ndarray, own: Constraints):
    """A lower bound: ``σ² = λ ≥ (Σ λᵢ⁻ᵖ)^(-1/p)`` of M·Mᵀ with p = 2·2ˢ, from s squarings of its inverse.

    NaN where Cholesky's method finds no factors.
    """
    import casadi as ca

    rows, none = range(own.rows), ca.SX(0)
    inverse = _inverse(_cholesky(_times_transpose(entries, places, own)))
    power = [[sum((inverse[k][i] * inverse[k][j] for k in rows[i:]), none) for j in rows[: i + 1]] for i in rows]
    for _ in range(_SQUARINGS):
        full = [[power[max(i, j)][min(i, j)] for j in rows] for i in rows]
        power = [[sum((full[i][k] * full[k][j] for k in rows), none) for j in rows[: i + 1]] for i in rows]
    return _sum_of_squares(power) ** (-1.0 / (4 * 2**_SQUARINGS))


def _times_transpose(entries, places: np.ndarray, own: Constraints) -> list[list]:
    """Return the lower half of M·Mᵀ."""
    import casadi as ca

    rows, columns = own.rows, len(own.variable)
    matrix: list[dict] = [{} for _ in range(rows)]
    for place, value in zip(places.tolist(), ca.vertsplit(entries), strict=True):
        matrix[place // columns][place % columns] = value

    def product(first: dict, second: dict):
        return sum((first[k] * second[k] for k in first if k in second), ca.SX(0))

    return [[product(matrix[i], matrix[j]) for j in range(i + 1)] for i in range(rows)]


def _sum_of_squares(lower: list[list]):
    """Return the squared Frobenius norm of a symmetric matrix given by its lower half."""
    return sum((1.0 if i == j else 2.0) * x * x for i, row in enumerate(lower) for j, x in enumerate(row))


def _cholesky(square: list[list]) -> list[list]:
    """Return the lower factor of a symmetric matrix given by its lower half."""
    import casadi as ca

    factor: list[list] = []
    for i, row in enumerate(square):
        own: list = []
        for j in range(i + 1):
            partner = own if j == i else factor[j]
            rest = row[j] - sum((own[k] * partner[k] for k in range(j)), ca.SX(0))
            own.append(ca.sqrt(rest) if j == i else rest / factor[j][j])
        factor.append(own)
    return factor


def _inverse(factor: list[list]) -> list[list]:
    """Return the inverse of a lower triangular matrix, its lower half."""
    import casadi as ca

    inverse: list[list] = []
    for i, row in enumerate(factor):
        own = [-sum((row[k] * inverse[k][j] for k in range(j, i)), ca.SX(0)) / row[i] for j in range(i)]
        inverse.append([*own, 1.0 / row[i]])
    return inverse
