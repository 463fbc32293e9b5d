"""States of rest in numbers, for scenes that have no short equations in symbols: large ones, and mechanisms with loops.

A linear scene is one linear system. A mechanism is sought from where it starts: with one coordinate by walking along it
both ways, which finds every state of rest on its branch; with several by Newton's method from many places. Where the
coordinates of a loop turn back, or may do so, all of its coordinates are searched (`symbolic.resting_loops`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.numerics.options.formulations import NotFormulatedError
from lmoc.symbolic.equilibria import Equilibria, Equilibrium
from lmoc.symbolic.jumps import NoDerivativeError
from lmoc.symbolic.numeric import NumericSystem, contains_time, linearize_numerically
from lmoc.symbolic.released import Released
from lmoc.symbolic.resting_loops import RestOfLoops, keeps_its_closures, rests_of_loops, rests_on_curve
from lmoc.symbolic.search import Rest, dense_about_zero, fineness, largest_rows, reach_of, rests, scene_size, values_at
from lmoc.symbolic.system import coordinates_of, time_stands_in_it

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.linearize import LinearModel

STARTS = 40  # of Newton's method with several coordinates
_ROUNDED = 1e-3  # as `fineness`: one linear system is solved to more digits than a search finds
_DEPENDENT = 1e-12  # singular values of a linear scene in rows of one size: as small, they are rounding of zero
NO_RATE = 1e-9  # rad/s² or m/s², of a mechanism that nothing moves
MOST_TURN = 0.5  # of the slope of a dependent coordinate between two points of a walk
WALK = 720  # points along one coordinate, each way


def equilibria_numerically(
    prepared: Prepared, inputs: Mapping[str, float], released: Released | None = None
) -> Equilibria:
    """Return the states of rest in numbers, for constant inputs; inputs not given are zero.

    Parameters
    ----------
    released : gives the reduction in all coordinates of closed loops; without it these are not searched

    Raises
    ------
    ModelError
        E0660 where time itself appears in the equations, E0662 a parameter without a value.
    """
    reduced, values = prepared.reduced, prepared.values
    if contains_time(reduced.rhs):
        raise time_stands_in_it()
    system = NumericSystem(reduced, values, ())
    u = np.array([float(inputs.get(name, 0.0)) for name in system.inputs])
    if system.is_linear():
        return _linear(reduced, values, system, u)
    still = _AtRest(system, values, u)
    loads = dict(zip(system.inputs, u.tolist(), strict=True))
    alone = len(still.places) == 1 and system.pose is not None
    found, how, whole = _along(still) if alone else ([], "", False)
    if not whole:
        in_all = _in_all_coordinates(prepared, loads, released)
        if in_all is not None:
            return in_all
        how += "; there may be others beyond"
        if not alone or reduced.invariants is None:  # without loops there are no other branches to stray to
            found = rests(still.rates, still.jacobian, still.turning, STARTS, still.size)
            how = f"Newton's method from {STARTS} starts; there may be others"
    if reduced.left_out:
        found = [rest for rest in found if system.can_start_at(still.state(rest.at), u)]
    return Equilibria((_finished(reduced, values, system, still, u, rest, how) for rest in found), how)


def _in_all_coordinates(
    prepared: Prepared, inputs: Mapping[str, float], released: Released | None
) -> Equilibria | None:
    """Return the states of rest in all coordinates of closed loops; None where there are none, or not all are free."""
    if released is None or prepared.reduced.invariants is None:
        return None
    try:
        reduced = released.everywhere(prepared)
    except NotFormulatedError:
        return None
    on_curve = rests_on_curve(reduced, prepared.reduced, prepared.values, inputs)
    found, how = on_curve or rests_of_loops(reduced, prepared.values, inputs)
    finished = (_of_loops(prepared, one, inputs, released, how) for one in found)
    return Equilibria((e for e in finished if e is not None), how)


def _of_loops(
    prepared: Prepared, one: RestOfLoops, inputs: Mapping[str, float], released: Released, how: str
) -> Equilibrium | None:
    """Return a state of rest with its linear model in coordinates that serve there; None where it is none.

    Constraints that are left out as redundant need not hold, and where closures depend on each other the accelerations
    are not what they seem.
    """
    there = released.at(prepared.flat, prepared.values, one.place)
    redundant = prepared.reduced.left_out or there.left_out
    if redundant and not keeps_its_closures(there, prepared.values, inputs, one.place):
        return None
    point = {name: one.place.get(name, 0.0) for name in there.state_names} | dict(inputs)
    model = linear_model_at(there, prepared.values, point)
    if model is not None and not model.at_rest:
        return None
    free = tuple(x for x, value in one.values.items() if value == x)
    still = dict.fromkeys(_symbols(prepared.reduced.state_names), _floats([0.0])[0])
    given = dict(zip(_symbols(list(inputs)), _floats(list(inputs.values())), strict=True))
    return Equilibrium(still | dict(one.values), free, how=how, model=model, nonlinear=True, inputs=given)


def _linear(reduced: Reduced, values: np.ndarray, system: NumericSystem, u: np.ndarray) -> Equilibria:
    """The one state of rest, or the family, of a linear scene."""
    how = "Newton's method in numbers, one step of a linear system"
    found = system.rest(u)
    if found is None:
        return Equilibria((), how)
    model = linearize_numerically(reduced, values, dict(zip(system.states, found, strict=True)), ())
    rest = Rest(found, *_null_space(model.A))
    symbols = _symbols(system.states)
    member = Rest(found - rest.along @ found[list(rest.free)], rest.free, rest.along)
    at = values_at(member, symbols, _ROUNDED)
    free = tuple(symbols[i] for i in rest.free)
    given = dict(zip(_symbols(system.inputs), _floats(u), strict=True))
    return Equilibria([Equilibrium(at, free, how=how, model=model, inputs=given)], how)


def _null_space(A: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """The states that may have any value, and how the others follow them."""
    if not len(A):
        return (), np.zeros((0, 0))
    size = np.abs(A).max(axis=1, keepdims=True)  # a contact of 1e11 N/m beside a spring of 1 N/m leaves nothing free
    _, singular, right = np.linalg.svd(A / np.where(size > 0, size, 1.0))
    null = right[singular <= _DEPENDENT].T
    free = largest_rows(null)
    along = null @ np.linalg.inv(null[list(free)]) if free else np.zeros((len(A), 0))
    return free, np.round(along, 12) + 0.0


class _AtRest:
    """Rates as functions of the places alone, with velocities zero."""

    def __init__(self, system: NumericSystem, values: np.ndarray, u: np.ndarray):
        pairs = coordinates_of(system.reduced)
        self.system, self.u = system, u
        self.places = np.array([q for q, _ in pairs], int)
        self.targets = np.array([v if v >= 0 else q for q, v in pairs], int)
        flat, registers = system.reduced.flat, system.reduced.registers
        variables = registers.variable[system.reduced.states[self.places]]
        self.turning = np.array([flat.block_at(int(v)).unit in ("rad", "deg") for v in variables], bool)
        self.size = scene_size(flat, values)

    def state(self, y: np.ndarray) -> np.ndarray:
        x = np.zeros(len(self.system.states))
        x[self.places] = y
        return x

    def rates(self, y: np.ndarray) -> np.ndarray:
        return self.system.rates(self.state(y), self.u)[self.targets]

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        return self.system.matrices(self.state(y), self.u)[1][np.ix_(self.targets, self.places)]

    def branch(self) -> np.ndarray:
        """Return the coordinates that the implicit equations gave where the rates were asked for last."""
        return self.system.dependent()

    def start(self) -> float:
        """Go to where the scene starts; the place there."""
        x = self.system.pose.states
        self.system.approach(self.state(x[self.places]), self.u)
        return float(x[self.places][0])


def _along(still: _AtRest) -> tuple[list[Rest], str, bool]:
    """Return the states of rest along the only coordinate, both ways from the start as far as the mechanism goes.

    Also how they were sought, and whether the mechanism goes all the way.
    """
    turning = bool(still.turning[0])
    far, fine = reach_of(still.size), 1.0 if turning else fineness(still.size)
    dense = 12 + np.log(far / (reach_of(1.0) * fine))
    reach = np.linspace(0, 2 * np.pi, WALK) if turning else dense_about_zero(np.linspace(0, 1, WALK), far, dense)
    found: list[float] = []
    largest, whole = 0.0, True
    for way in (1.0, -1.0):
        begin = still.start()
        last, before = begin, still.rates(np.array([begin]))[0]
        branch, slope = still.branch(), None
        for away in reach[1:]:
            y = begin + way * away
            value = still.rates(np.array([y]))[0]
            here = still.branch()
            steeper = (here - branch) / (y - last)
            if not np.isfinite(value) or slope is not None and _turns(slope, steeper):
                whole = False
                break
            if before == 0 or np.signbit(value) != np.signbit(before):
                found += [last] if before == 0 else _refined(still, last, y, before, value)
            last, before, branch, slope = y, value, here, steeper
            largest = max(largest, abs(value))
    if found and largest <= NO_RATE:
        how = f"no acceleration at {WALK} points along the coordinate"
        return [Rest(np.zeros(1), (0,), np.ones((1, 1)))], how, True
    unique: list[float] = []
    for y in sorted(found, key=abs):
        apart = [y - other for other in unique]
        apart = [a - 2 * np.pi * round(a / (2 * np.pi)) if turning else a for a in apart]
        if not any(abs(a) < 1e-6 * fine for a in apart):
            unique.append(y)
    where = "a turn each way" if turning else f"{far:g} m each way"
    how = f"sign changes at {WALK} points along the coordinate, {where} from the start as far as the mechanism goes"
    return [Rest(np.array([y]), (), np.zeros((1, 0))) for y in sorted(unique)], how, whole


def _turns(slope: np.ndarray, steeper: np.ndarray) -> bool:
    """Return whether the dependent coordinates leave their branch: their slope jumps between two steps."""
    size = 1.0 + np.minimum(np.abs(slope), np.abs(steeper)).max(initial=0.0)
    return bool(np.abs(steeper - slope).max(initial=0.0) > MOST_TURN * size)


def _refined(still: _AtRest, low: float, high: float, below: float, above: float) -> list[float]:
    """A zero between two places by bisection; none where the rate has a pole there."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.signbit(still.rates(np.array([middle]))[0]) == np.signbit(below):
            low = middle
        else:
            high = middle
    middle = 0.5 * (low + high)
    least = min(abs(below), abs(above))
    return [middle] if abs(still.rates(np.array([middle]))[0]) <= least else []


def _finished(
    reduced: Reduced, values: np.ndarray, system: NumericSystem, still: _AtRest, u: np.ndarray, rest: Rest, how: str
) -> Equilibrium:
    symbols = _symbols(system.states)
    places = [symbols[i] for i in still.places]
    at = dict.fromkeys(symbols, _floats([0.0])[0]) | values_at(rest, places, fineness(still.size))
    x = still.state(np.where(np.isin(np.arange(len(places)), rest.free), 0.0, rest.at))
    point = dict(zip(system.states, x.tolist(), strict=True)) | dict(zip(system.inputs, u.tolist(), strict=True))
    model = linear_model_at(reduced, values, point)
    given = dict(zip(_symbols(system.inputs), _floats(u), strict=True))
    free = tuple(places[i] for i in rest.free)
    return Equilibrium(at, free, how=how, model=model, nonlinear=True, inputs=given)


def linear_model_at(reduced: Reduced, values: np.ndarray, point: Mapping[str, float]) -> LinearModel | None:
    """Return the linear model about a state of rest; None where something has no derivative there."""
    try:
        return linearize_numerically(reduced, values, point, ())
    except NoDerivativeError:
        return None


def _symbols(names: list[str]) -> list[sympy.Symbol]:
    import sympy as sp

    return [sp.Symbol(name) for name in names]


def _floats(values: np.ndarray | list[float]) -> list[sympy.Expr]:
    import sympy as sp

    return [sp.Integer(0) if v == 0 else sp.Float(float(v)) for v in values]
