"""A certificate that a step has kept to good coordinates: bounds of what `watch` judges, in one casadi function.

The bounds are on the safe side: where they hold, the watch comes to the same judgement in full; where they do not, it
has to be asked. Most steps of a run are certified, at a tenth of the cost.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.entries import at_hand, evaluate, lowered_entries
from lmoc.numerics.coordinates.place import Place
from lmoc.numerics.coordinates.tableau import Tableau
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


class Certifier:
    """Computes the bounds of one system, for one step after the other.

    Attributes
    ----------
    place : where the next step begins
    """

    def __init__(self, system: System, base: np.ndarray, reads: np.ndarray, function, registers: np.ndarray) -> None:
        own = system.plan.reduced.constraints
        self.system, self.own, self.place = system, own, None
        self._places = _places(own)  # of the matrix's entries that are not always zero
        self._reads, self._registers = reads, registers
        self._shape = own.rows, len(own.variable)
        self._table = len(own.watched), len(own.variable) - own.rows
        self._time, self._known, self._out = np.zeros(1), base[reads].copy(), np.empty(system.n)
        count, entries = len(self._places), self._table[0] * self._table[1]
        lengths = count, entries, len(registers), len(registers), count, count, count, entries, len(own.watched)
        self._given = [np.zeros(n) for n in lengths]
        nothing = np.zeros(0)
        self._call = Buffered(function, (self._time, nothing, self._known, nothing, *self._given))

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
        rows, columns = scales.ranges[self.own.watched], scales.ranges[self.own.rows :]
        self._ratio = rows[:, None] / columns
        scale[:] = np.where(scales.barred[:, None], 0.0, self._ratio).ravel()

    def __call__(self, t: float, x: np.ndarray) -> list[float]:
        """Return the bounds for the step to (t, x), as `certificate` lists them."""
        self._time[0] = t
        evaluate(self.system, t, x, self._out)
        registers = self.system.registers
        self._known[:] = registers[self._reads]
        self._given[3][:] = registers[self._registers]
        self._call()
        return self._call.results[3].tolist()

    def found(self) -> tuple[np.ndarray, Tableau, np.ndarray]:
        """The matrix, the tableau and the coordinates at the end of the step."""
        entries, table, _, bounds = self._call.results
        matrix = np.zeros(self._shape)
        matrix.flat[self._places] = entries
        plain = table.reshape(self._table).copy()
        return matrix, Tableau(plain * self._ratio, float(bounds[1]), plain), self._given[3].copy()

    def go_on(self, place: Place) -> None:
        """Stand at the end of the step."""
        self.place = place
        matrix, table, before, after, _, size, *_ = self._given
        matrix[:], table[:], size[:] = self._call.results[:3]
        before[:] = after

    def sizes(self, size: np.ndarray) -> np.ndarray:
        """Return the (rows, columns) largest entries, from those before the steps that have been certified."""
        size = size.copy()
        size.flat[self._places] = self._given[5]
        return size


def certifier_of(system: System, base: np.ndarray, registers: np.ndarray) -> Certifier | None:
    """Return what certifies steps of a system; None where casadi does not take it, or registers are not kept.

    Parameters
    ----------
    registers : of the coordinates by the columns of the constraints, or none
    """
    plan = system.plan
    own = plan.reduced.constraints
    if system.registers is None or own.rows > MOST_ROWS or not len(own.watched) or own.rows == len(own.variable):
        return None
    if not np.isin(registers, plan.once(at_hand)).all():
        return None
    reads, function = plan.once(_with_coordinates if len(registers) else _without_coordinates)
    if function is None or not np.isin(reads, plan.once(at_hand)).all():
        return None
    return Certifier(system, base, reads, function, registers)


def _with_coordinates(plan: Plan) -> tuple[np.ndarray, casadi.Function | None]:
    return _function(plan, len(plan.reduced.constraints.variable))


def _without_coordinates(plan: Plan) -> tuple[np.ndarray, casadi.Function | None]:
    return _function(plan, 0)


def _function(plan: Plan, coordinates: int) -> tuple[np.ndarray, casadi.Function | None]:
    """The registers read, and ``(…, what is given) -> what is known, sizes, bounds``."""
    import casadi as ca

    _, reads, lowered = lowered_entries(plan, kept=True)
    if lowered is None:
        return reads, None
    given, outputs = certificate(lowered.out, plan.reduced.constraints, coordinates)
    arguments = [lowered.time, lowered.x, lowered.p, lowered.u, *given]
    return reads, ca.Function("certificate", arguments, [ca.densify(o) for o in outputs])


def _places(own: Constraints) -> np.ndarray:
    return np.unique(own.row.astype(int) * len(own.variable) + own.column)


def certificate(entries: casadi.SX, own: Constraints, told: int) -> tuple[list, list]:
    """Return expressions that certify a step, and the further symbols in them.

    Symbols: what was known at its beginning (entries of the matrix, the tableau row by row, coordinates), the
    coordinates at its end; factor, size and bound of each entry, the scale of each entry of the tableau, and the short
    ways of the dependent coordinates.
    Expressions: entries and tableau at its end; the sizes; and in one vector the largest entry of the tableau, the sign
    of the determinant, a lower bound of the smallest singular value, the length by which the scaled matrix has changed
    (Frobenius), the most that velocities leave unexplained of the way of a dependent coordinate beyond what they may,
    and by how much an entry exceeds its bound.

    Parameters
    ----------
    entries : of the constraints, in their order
    told : coordinates that are known: all or none
    """
    import casadi as ca

    places, states = _places(own), len(own.variable) - own.rows
    count, size = len(places), len(own.watched) * states
    lengths = count, size, told, told, count, count, count, size, len(own.watched)
    names = "matrix", "tableau", "before", "after", "factor", "size", "bound", "scale", "short"
    given = [ca.SX.sym(name, length) for name, length in zip(names, lengths, strict=True)]
    matrix, tableau, before, after, factor, sizes, bound, scale, short = given
    sums: list = [ca.SX(0)] * count
    where = np.searchsorted(places, own.row.astype(int) * len(own.variable) + own.column)
    for k, value in zip(where.tolist(), ca.vertsplit(entries), strict=True):
        sums[k] = sums[k] + value
    now = ca.vertcat(*sums)
    table, sign = unrolled(entries, own)
    by_rows = ca.vec(table.T)
    unexplained = ca.SX(0)
    if told:
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
