"""Rest under laws in numbers: which of them can be closed, and between what limits forces and places then lie.

At rest the rates of the states vanish, with the forces λ of the laws among what acts, and each law is one of its
alternatives: a gap closed or open, a friction stuck or slipping (as on a moving belt). In a linear scene each choice of
alternatives is a polyhedron in the states and the forces. They are found by branching on one law after the other and
leaving out, by linear programs, what has no point (A. H. Land and A. G. Doig, Econometrica 28, 1960; for static
complementarity G. Maier, Meccanica 5, 1970): of 2ⁿ choices only those are looked at that lead somewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import LawKind
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.structure.messages.equations import listed
from lmoc.support.records import dataclass
from lmoc.symbolic.laws.modes import Lawful
from lmoc.symbolic.numeric import NumericSystem
from lmoc.symbolic.too_long import no_symbols

Array = NDArray[np.float64]

UNDECIDED, OPEN, CLOSED = -1, 0, 1
MOST_FOUND = 64  # choices; more are not searched
ZERO = 1e-8  # largest gaps and forces below this share of the scene's size are zero
EQUILIBRATIONS = 8
TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}  # the least that HiGHS takes


@dataclass(frozen=True, eq=False)
class LawChoice:
    """An alternative for each law: UNDECIDED, OPEN or CLOSED; and the direction in which open friction slips."""

    closed: NDArray[np.int64]
    direction: NDArray[np.int64]

    def decided(self, law: int, closed: int, direction: int = 0) -> LawChoice:
        ways = self.closed.copy(), self.direction.copy()
        ways[0][law], ways[1][law] = closed, direction
        return LawChoice(*ways)


@dataclass(frozen=True, eq=False)
class AffineRows:
    """Rows ``matrix @ z + constant`` over z = (states, forces of the laws)."""

    matrix: Array
    constant: Array

    def __getitem__(self, k: int) -> tuple[Array, float]:
        return self.matrix[k], float(self.constant[k])


@dataclass(frozen=True, eq=False)
class Statics:
    """The conditions of rest, linear in states and forces, everywhere or about a point.

    Attributes
    ----------
    kinds : of the laws
    normal : (laws,) the law whose force presses contact friction, -1 for others
    states : number of states
    rates : of the states
    motion : gaps, and velocities where a law has one
    slip, stick : limits of friction; of contact friction its coefficient
    """

    kinds: tuple[LawKind, ...]
    normal: NDArray[np.int64]
    states: int
    rates: AffineRows
    motion: AffineRows
    slip: AffineRows
    stick: AffineRows

    @property
    def laws(self) -> int:
        return len(self.kinds)

    def force(self, law: int) -> tuple[Array, float]:
        row = np.zeros(self.states + self.laws)
        row[self.states + law] = 1.0
        return row, 0.0

    def limit(self, law: int, rows: AffineRows) -> tuple[Array, float]:
        """Return the limit of a friction force; one that is constant and negative counts as zero."""
        row, constant = rows[law]
        if self.kinds[law] is LawKind.CONTACT_FRICTION:
            return self.force(int(self.normal[law]))[0] * constant, 0.0
        return row, constant if row.any() else max(constant, 0.0)

    def at_rest(self, law: int) -> bool:
        """Return whether the velocity of a law vanishes wherever the rates of the states do."""
        row, constant = self.motion[law]
        matrix = np.column_stack([self.rates.matrix, self.rates.constant])
        own = np.append(row, constant)
        share = np.linalg.lstsq(matrix.T, own, rcond=None)[0] if len(matrix) else np.zeros(0)
        return bool(np.abs(own - matrix.T @ share).max() <= ZERO * max(np.abs(own).max(), 1e-300))


class StaticSystem:
    """The conditions of rest of a scene about any point.

    Parameters
    ----------
    inputs : values of the top-level inputs

    Raises
    ------
    ModelError
        E0662 a parameter without a value; E0663 a rate without one, about a point.
    """

    def __init__(self, scene: Lawful, inputs: Mapping[str, float]) -> None:
        loose, form = scene.loose()
        self.reduced: Reduced = loose.reduced
        flat, n = loose.flat, form.count
        motion, slip, stick, normal = _columns(scene)
        self.system = NumericSystem(loose.reduced, loose.values, np.concatenate([motion, slip, stick]))
        push = np.searchsorted(self.system.input_variables, form.push)
        self.u = np.array([inputs.get(name, 0.0) for name in self.system.inputs])
        self.kinds, self.normal, self.count = tuple(scene.kinds), normal, n
        jets = self.system.jets
        at = [np.flatnonzero((jets[1] == self.system.input_variables[p]) & (jets[2] == 0)) for p in push]
        states = len(self.system.states)
        self.columns = np.concatenate([np.arange(states), states + np.concatenate(at)]).astype(int)
        known = np.where(flat.kind <= 1, loose.values, np.nan)  # constants and parameters
        self.known = known[np.concatenate([motion, slip, stick])]

    @property
    def states(self) -> list[str]:
        return self.system.states

    def is_linear(self) -> bool:
        """Return whether the conditions are the same about all points."""
        return self.system.is_linear()

    def about(self, x: Array) -> Statics:
        """Return the conditions about a point, for forces of any size."""
        self.system.approach(x, self.u)
        value, slope = self.system.matrices(x, self.u)
        slope, s, n = slope[:, self.columns], len(x), self.count
        value[s:] = np.where(np.isnan(value[s:]), self.known, value[s:])
        self._refuse(~(np.isfinite(value[:s]) & np.isfinite(slope[:s]).all(axis=1)))
        slope = np.nan_to_num(slope)  # of limits that are parameters
        constant = value - slope[:, :s] @ x
        parts = np.split(np.arange(s, s + 3 * n), 3)
        rows = [AffineRows(slope[p], constant[p]) for p in (np.arange(s), *parts)]
        return Statics(self.kinds, self.normal, s, *rows)

    def _refuse(self, lost: NDArray[np.bool_]) -> None:
        """Refuse rates without values, such as of parameters so large that a product of them overflows (E0663)."""
        if lost.any():
            names = [f"'der({name})'" for name, own in zip(self.states, lost.tolist(), strict=True) if own]
            message = f"no conditions of rest: {listed(names)} without a finite value, or derivative, at this point"
            hint = "look at divisions by zero, and at parameters of which a product is too large for a number"
            raise ModelError([Diagnostic("E0663", message, hint=hint)])


def _columns(scene: Lawful) -> tuple[NDArray[np.int64], ...]:
    """Return the variables of motions and limits, and the laws that press contact friction."""
    place = {int(v): k for k, v in enumerate(scene.force)}
    columns: list[list[NDArray[np.int64]]] = [[], [], [], []]
    for g in scene.flat.laws:
        slip = g.slip if g.slip is not None else g.friction if g.friction is not None else g.motion
        stick = g.stick if g.stick is not None else slip
        pressed = [-1] * g.rows if g.normal is None else [place[int(v)] for v in g.normal]
        for column, own in zip(columns, (g.motion, slip, stick, np.array(pressed)), strict=True):
            column.append(own)
    return tuple(np.concatenate(c).astype(int) for c in columns)


class Polyhedra:
    """Linear programs over the states and forces of rest.

    The columns and rows are scaled (D. Ruiz, Rutherford Appleton Laboratory report RAL-TR-2001-034), so that the
    tolerances of the solver are shares of the scene's sizes.
    """

    def __init__(self, statics: Statics) -> None:
        self.statics = statics
        parts = statics.rates, statics.motion, statics.slip, statics.stick
        matrix = np.concatenate([p.matrix for p in parts])
        constant = np.concatenate([p.constant for p in parts])
        self.column = np.ones(matrix.shape[1])
        row = np.ones(len(matrix))
        for _ in range(EQUILIBRATIONS):
            scaled = np.abs(matrix * row[:, None] * self.column)
            row /= np.sqrt(_or_one(scaled.max(axis=1, initial=0.0)))
            self.column /= np.sqrt(_or_one((np.abs(matrix) * row[:, None] * self.column).max(axis=0, initial=0.0)))
        size = float(np.abs(constant * row).max(initial=0.0))
        self.column = self.column * (size if size > 0.0 else 1.0)

    def extreme(self, choice: LawChoice, row: Array, constant: float = 0.0) -> float | None:
        """Return the largest value of a linear function; infinity where there is none, None where there is no point."""
        found = self._solve(choice, -row)
        if found is None:
            return None
        return np.inf if np.isnan(found).any() else float(row @ found + constant)

    def point(self, choice: LawChoice) -> Array | None:
        """Return a point at which stuck friction carries nothing, or else is as far from its limits as possible.

        None where there is no point.
        """
        stuck = [k for k in np.flatnonzero(choice.closed == CLOSED) if self.statics.kinds[k] in FRICTIONS]
        nothing = np.zeros(len(self.column))
        found = self._solve(choice, nothing, [self.statics.force(int(k)) for k in stuck])
        if found is None:
            found = self._solve(choice, nothing, margin=True)
        return None if found is None or np.isnan(found).any() else found

    def has_point(self, choice: LawChoice) -> bool:
        return self._solve(choice, np.zeros(len(self.column))) is not None

    def range(self, choice: LawChoice, row: Array) -> tuple[float, float]:
        """Return the least and the largest value of a linear function without a constant."""
        high, low = self.extreme(choice, row), self.extreme(choice, -row)
        if high is None or low is None:
            raise ValueError("there is no point")
        return -low, high

    def _solve(
        self, choice: LawChoice, objective: Array, more: Sequence[tuple[Array, float]] = (), margin: bool = False
    ) -> Array | None:
        """Return the minimizer; NaN where there is none, None where there is no point.

        Parameters
        ----------
        more : further rows that vanish
        margin : maximize instead what is left of the limits of friction
        """
        from scipy.optimize import linprog

        equal = [self.statics.rates[k] for k in range(self.statics.states)] + list(more)
        least: list[tuple[Array, float]] = []
        slack: list[bool] = []
        for law in range(self.statics.laws):
            own_equal, own_least = conditions(self.statics, choice, law)
            equal += own_equal
            least += own_least
            stuck = choice.closed[law] == CLOSED and self.statics.kinds[law] in FRICTIONS
            slack += [margin and stuck] * len(own_least)
        a_eq, b_eq = self._scaled(equal)
        a_ub, b_ub = self._scaled(least)
        cost = objective * self.column
        cost /= _or_one(np.abs(cost).max(initial=0.0))
        bounds: list[tuple[float | None, float | None]] = [(None, None)] * len(cost)
        if margin:
            a_eq = np.column_stack([a_eq, np.zeros(len(a_eq))])
            a_ub = np.column_stack([-a_ub, np.array(slack, float)])
            cost, bounds = np.append(cost, -1.0), [*bounds, (0.0, 1.0)]
        else:
            a_ub = -a_ub
        if not all(np.isfinite(numbers).all() for numbers in (cost, a_ub, b_ub, a_eq, b_eq)):
            raise no_symbols("the forces at rest are too large for numbers", "look at very large and very small values")
        found = linprog(cost, a_ub, b_ub, a_eq, -b_eq, bounds, method="highs", options=TOLERANCES)
        if found.status == 2:
            return None
        if found.status == 4:  # infeasible or unbounded: without an objective it is one of them
            empty = objective.any() and self._solve(choice, np.zeros(len(objective)), more) is None
            return None if empty else np.full(1, np.nan)
        if found.status != 0:
            return np.full(1, np.nan)
        return found.x[: len(self.column)] * self.column

    def _scaled(self, rows: list[tuple[Array, float]]) -> tuple[Array, Array]:
        n = len(self.column)
        matrix = np.array([r for r, _ in rows]).reshape(-1, n) * self.column
        constant = np.array([c for _, c in rows])
        size = _or_one(np.abs(matrix).max(axis=1, initial=0.0))
        return matrix / size[:, None], constant / size


FRICTIONS = frozenset({LawKind.DRY_FRICTION, LawKind.CONTACT_FRICTION})


def conditions(statics: Statics, choice: LawChoice, law: int) -> tuple[list, list]:
    """Return the rows that vanish and the rows that are not negative, for the alternative of one law."""
    force, motion = statics.force(law), statics.motion[law]
    chosen = choice.closed[law]
    if statics.kinds[law] not in FRICTIONS:
        if chosen == UNDECIDED:
            return [], [force, motion]
        return ([motion], [force]) if chosen == CLOSED else ([force], [motion])
    slip, stick = statics.limit(law, statics.slip), statics.limit(law, statics.stick)
    if chosen == OPEN:
        way = int(choice.direction[law])
        return [_sum(force, slip, way)], [_times(motion, way)]
    limit = _sum(slip, stick, 1) if chosen == UNDECIDED else stick
    return ([motion] if chosen == CLOSED else []), [_sum(limit, force, 1), _sum(limit, force, -1)]


def _sum(a: tuple[Array, float], b: tuple[Array, float], factor: int) -> tuple[Array, float]:
    return a[0] + factor * b[0], a[1] + factor * b[1]


def _times(a: tuple[Array, float], factor: int) -> tuple[Array, float]:
    return factor * a[0], factor * a[1]


def _or_one(values: Array) -> Array:
    return np.where(values > 0.0, values, 1.0)


def choices(polyhedra: Polyhedra) -> Iterator[LawChoice]:
    """Yield the choices with a point, without those that are limits of others: closed laws with no force at all.

    Where gap and force of a law vanish together in all of the points, it counts as closed.
    """
    statics = polyhedra.statics
    still = [kind is LawKind.UNILATERAL or statics.at_rest(k) for k, kind in enumerate(statics.kinds)]
    nothing = LawChoice(np.full(statics.laws, UNDECIDED), np.zeros(statics.laws, int))
    if polyhedra.has_point(nothing):
        yield from _below(polyhedra, nothing, 0, still)


def _below(polyhedra: Polyhedra, choice: LawChoice, law: int, still: list[bool]) -> Iterator[LawChoice]:
    statics = polyhedra.statics
    if law == statics.laws:
        yield choice
        return
    for one in _alternatives(polyhedra, choice, law, still[law]):
        yield from _below(polyhedra, one, law + 1, still)


def _alternatives(polyhedra: Polyhedra, choice: LawChoice, law: int, still: bool) -> list[LawChoice]:
    """Return the alternatives of one law that have a point."""
    statics = polyhedra.statics
    closed = choice.decided(law, CLOSED)
    unilateral = statics.kinds[law] is LawKind.UNILATERAL
    if still and not unilateral:  # a velocity that is zero anyway: the law is closed, whatever its force
        return [closed] if polyhedra.has_point(closed) else []
    force, (motion, constant) = statics.force(law)[0], statics.motion[law]
    small = ZERO * polyhedra.column[statics.states + law]
    ways = (0,) if statics.kinds[law] not in FRICTIONS else (1, -1)
    found = []
    for way in ways:
        opened = choice.decided(law, OPEN, way)
        most = polyhedra.extreme(opened, motion * (way or 1), constant * (way or 1))
        if most is not None and most > ZERO * _size(polyhedra, motion, constant):
            found.append(opened)
    strongest = polyhedra.extreme(closed, force)
    frictional = statics.kinds[law] in FRICTIONS
    if strongest is not None and (strongest > small or frictional or not found):
        found.append(closed)
    return found


def _size(polyhedra: Polyhedra, row: Array, constant: float) -> float:
    """Return the magnitude of a function in the scene."""
    return max(float((np.abs(row) * polyhedra.column).max(initial=0.0)), abs(constant))
