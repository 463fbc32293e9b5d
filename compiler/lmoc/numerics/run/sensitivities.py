"""Derivatives of a motion by parameters and start values: the variational equations, integrated with the states.

``S' = f_x S + f_p`` (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), I.14), with the
tangents of the program on one tape. What follows from parameters alone, and variables from states, are functions
without time: their derivatives are differences of order four. Between two segments `saltation` leads over the event.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.failures.chatter import jumps
from lmoc.numerics.observe.observer import Observer, find
from lmoc.numerics.observe.solutions import Solutions
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory
from lmoc.numerics.options.options import MOREAU
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.start.bases import bases
from lmoc.support.records import dataclass

STEP = 1e-3  # of a quantity's size, of differences of order four: their error is some 1e-12
_CENTRAL = ((1, 8 / 12), (-1, -8 / 12), (2, -1 / 12), (-2, 1 / 12))
_AHEAD = ((0, -25 / 12), (1, 4.0), (2, -3.0), (3, 4 / 3), (4, -1 / 4))
_ROUNDING = 1e-13  # of the largest number in a motion: what is smaller is none
_DIFFERENT = 1e-6  # share of the largest derivative by which those on both sides of an instant are others
_NEVER = 99  # more often than anything is differentiated
_EXPLICIT = frozenset({"dop853", "taylor", "none"})
Values = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Direction:
    """A quantity by which the motion is differentiated.

    Attributes
    ----------
    name : of a parameter or of a variable at the start
    value : that it has
    size : its size, of which differences take a part
    all_values : from its changes (k,) to the parameter values (flat.count, k)
    is_parameter : else it is a variable at the start
    """

    name: str
    value: float
    size: float
    all_values: Values
    is_parameter: bool

    def values(self, change: float) -> np.ndarray:
        """Return the parameter values (flat.count,) when it is changed."""
        return np.ascontiguousarray(self.all_values(np.array([change]))[:, 0])

    @cached_property
    def around(self) -> np.ndarray:
        """(flat.count, 5) the parameter values in the middle, and at the places of differences to both sides of it."""
        return self.all_values(STEP * self.size * np.array([0, *(place for place, _ in _CENTRAL)]))

    @cached_property
    def rates(self) -> np.ndarray:
        """(flat.count,) the derivatives of the parameter values, 0 for what has none."""
        return slope(lambda values: values, self)

    def parameters(self, change: float) -> dict[str, float]:
        """Return the parameters of a run in which it is changed, by name."""
        return {self.name: self.value + change} if self.is_parameter else {}


@dataclass(frozen=True, eq=False)
class Tangent:
    """A place of a motion, and its derivatives by each direction.

    Attributes
    ----------
    x : (n,) states
    by : (m, n) derivatives of the states
    base : (m, registers) derivatives of what does not change between events
    """

    time: float
    x: np.ndarray
    by: np.ndarray
    base: np.ndarray


def difference(function: Callable[[float], np.ndarray], step: float) -> np.ndarray:
    """Return the derivative of a function at 0, from differences of order four: ahead, where there is nothing behind.

    A parameter may stand at its bound, such as a damping of zero.
    """
    try:
        return sum(weight * function(k * step) for k, weight in _CENTRAL) / step  # type: ignore[return-value]
    except ModelError:
        return sum(weight * function(k * step) for k, weight in _AHEAD) / step  # type: ignore[return-value]


def methods_for(solver: str) -> tuple[str, ...]:
    """Return the methods by which tangents are integrated, the one where the other fails, by those of the run."""
    used = set(solver.split(", "))
    if not used <= _EXPLICIT:
        return ("radau",)
    return ("taylor", "dop853") if "taylor" in used else ("dop853",)


def mode_registers(plan: Plan) -> np.ndarray:
    """Return the registers that say in which mode each law is; none without laws."""
    form = plan.reduced.switched
    if form is None:
        return np.zeros(0, int)
    found = plan.reduced.register_of[form.modes]
    return found[found >= 0]


def refused(reason: str, hint: str = "") -> ModelError:
    """Return the error that says why there are no sensitivities."""
    hint = hint or "differences of two runs are an approximation: simulate with the value a little larger and smaller"
    return ModelError([Diagnostic("E0575", f"sensitivities are not available: {reason}", hint=hint)])


def at_output(name: str, time: float, what: str) -> ModelError:
    """Return the error that says that an output is where something happens that moves."""
    told = f" ({what})" if what else ""
    return refused(
        f"at the output time t = {time:.6g} s something happens{told} that comes earlier or later with '{name}': "
        "the derivatives before and behind it differ",
        "ask for another output time, or another end",
    )


def slope(function: Callable[[np.ndarray], np.ndarray], direction: Direction) -> np.ndarray:
    """Return the derivative (k,) of what follows from parameter values alone; 0 for what has no value.

    Parameters
    ----------
    function : from parameter values (flat.count, runs) to (k, runs)

    Raises
    ------
    ModelError
        E0575: something that has a value has no derivative.
    """
    for rule in (_CENTRAL, _AHEAD):
        places, weights = np.array(rule).T
        step = STEP * direction.size
        values = direction.around if rule is _CENTRAL else direction.all_values(step * np.append(0.0, places))
        found = function(values)
        known = np.isfinite(found[:, 0])
        # differences to the middle: what does not move at all has the derivative zero, not rounding
        own = (found[known, 1:] - found[known, :1]) @ weights / step
        if np.isfinite(own).all():
            result = np.zeros(len(known))
            result[known] = own
            return result
    raise refused(f"what follows from '{direction.name}' alone is not smooth there")


def slopes(function: Callable[[np.ndarray], np.ndarray], directions: Sequence[Direction]) -> np.ndarray:
    """Return the derivatives (m, k) by several directions, as `slope`."""
    places, weights = np.array(_CENTRAL).T
    found = function(np.concatenate([direction.around for direction in directions], axis=1))
    found = found.reshape(len(found), len(directions), 1 + len(places))
    steps = STEP * np.array([direction.size for direction in directions])
    own = np.where(np.isfinite(found[:, :, 0]), (found[:, :, 1:] - found[:, :, :1]) @ weights / steps, 0.0).T
    for k in np.flatnonzero(~np.isfinite(own).all(axis=1)):
        own[k] = slope(function, directions[k])
    return own


def changed_values(
    flat: FlatDAE, held: Mapping[int, float], variable: int, count: int, changes: np.ndarray
) -> np.ndarray:
    """Return parameter values (count, k) with one of those held changed; NaN for variables that a reduction added."""
    numbers = np.repeat(np.array(list(held.values()))[:, None], len(changes), axis=1)
    numbers[list(held).index(variable)] += changes
    found = flat.parameter_values_of_runs(np.array(list(held)), numbers)
    return np.concatenate([found, np.full((count - len(found), len(changes)), np.nan)])


def same_values(values: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return parameter values that a start value does not change, as often."""
    return np.repeat(values[:, None], len(changes), axis=1)


def _has_jumps(plan: Plan) -> bool:
    """Return whether the equations may jump where a condition on the motion changes outside of events.

    What smooth() says to be continuous, up to a derivative, does not, unless it has been differentiated further: then
    there are such derivatives of all its variables.
    """
    reduced, table = plan.reduced, plan.reduced.registers
    highest = np.zeros(reduced.flat.count + 1, int)
    np.maximum.at(highest, table.variable, table.order)  # the last one is that of helpers
    for group, _ in plan.once(jumps):
        if group.smooth < 0:
            return True
        unknown = reduced.flat.kind[group.slots] == Kind.UNKNOWN
        register = reduced.register_of[group.slots]
        root = np.where(register >= 0, table.variable[register], group.slots)
        above = highest[root] - np.where(register >= 0, table.order[register], 0)
        written = np.zeros(group.slots.shape[1], int)
        for leaf in (*slots(group.left), *slots(group.right)):
            written[leaf.value[0]] = max(written[leaf.value[0]], leaf.value[1])
        differentiated = np.where(unknown, np.maximum(above, highest[group.slots]) - written, _NEVER)
        if (differentiated.min(axis=1) > group.smooth).any():
            return True
    return False


def check_motion(trajectory: Trajectory) -> None:
    """See that a motion has derivatives that can be computed.

    Raises
    ------
    ModelError
        E0575: its coordinates change, its equations jump outside of events, and the like.
    """
    first = trajectory.segments[0]
    plan = first.observer.plan
    if plan.reduced.in_all_coordinates:
        raise refused("the loops are integrated in all their coordinates", "formulation='reduced'")
    if trajectory.kept is not None:
        raise refused("only some variables are kept of the run", "leave out keep")
    if plan.once(_has_jumps):
        raise refused("the equations jump where a condition on the motion changes")
    if plan.reduced.switched is not None and MOREAU in str(trajectory.stats["solver"]):
        raise refused("time stepping looks at no event by itself")


def starts_smoothly(trajectory: Trajectory, x: np.ndarray) -> bool:
    """Return whether a motion begins with the states (n,) that its start has found, and nothing happens there.

    Laws may have taken their modes: whole numbers, which parameters do not change.
    """
    segment, begun = trajectory.segments[0], trajectory.begun
    if any(s.begin == segment.begin for s in trajectory.segments[1:]):
        return False
    if any(event.time <= segment.begin for event in trajectory.events):
        return False
    if begun is None:
        return True
    base = segment.observer.base
    taken = base[~((base == begun[1]) | (np.isnan(base) & np.isnan(begun[1])))]
    return np.array_equal(begun[0], x) and np.array_equal(taken, np.round(taken))


@dataclass(frozen=True, eq=False)
class OtherSide:
    """What is on the other side of an instant at which an output is, where something happens then.

    Attributes
    ----------
    output : its index in the segment
    segment, at, sizes : the segment there, the place, and the sizes of its states
    moving : (m,) which quantities move the instant
    said : what happens, in words
    """

    output: int
    segment: SegmentRecord
    at: Tangent
    sizes: np.ndarray
    moving: np.ndarray
    said: str


@dataclass(frozen=True, eq=False)
class Part:
    """A segment of the motion with its derivatives.

    Attributes
    ----------
    tangents : (m, times, n) derivatives of the states at the output times of the segment
    base : as in `Tangent`
    sizes : (n,) of its states
    others : of outputs at instants that move
    """

    segment: SegmentRecord
    tangents: np.ndarray
    base: np.ndarray
    sizes: np.ndarray
    others: tuple[OtherSide, ...] = ()


class Sensitivities:
    """The derivatives of a run.

    Attributes
    ----------
    directions : {name: by which it is differentiated}
    parts : of its segments
    rtol : relative tolerance
    """

    def __init__(self, directions: Sequence[Direction], parts: Sequence[Part], rtol: float) -> None:
        self.directions, self.parts, self.rtol = {d.name: d for d in directions}, tuple(parts), rtol

    def __call__(self, name: str, by: str) -> np.ndarray:
        """Return the derivative (T,) of a variable by a quantity.

        Raises
        ------
        KeyError
            There is no such variable, or it was not asked for derivatives by this quantity.
        ModelError
            E0575: an output is at an instant that moves with it, and the derivatives before and behind differ.
        """
        if by not in self.directions:
            raise KeyError(f"sensitivities were asked for by {', '.join(self.directions)}, not by '{by}'")
        which, variables = list(self.directions).index(by), find(self.parts[0].segment.observer.flat, name)
        direction = self.directions[by]
        every = [self._of(part, direction, which, variables) for part in self.parts]
        found = np.concatenate(every)
        for part, own in zip(self.parts, every, strict=True):
            for other in part.others:
                if other.moving[which]:
                    self._check(part, other, variables, own, np.max(np.abs(found), axis=0), which)
        return found[:, 0] if len(variables) == 1 else found

    def _of(self, part: Part, direction: Direction, which: int, variables: np.ndarray) -> np.ndarray:
        """Return the derivatives (times, variables) in one segment."""
        segment = part.segment
        if not len(segment.time):
            return np.zeros((0, len(variables)))
        own = part.tangents[which], part.base[which], part.sizes
        return _slopes_of(segment, segment.time, segment.table, own, direction, variables)

    def _check(
        self, part: Part, other: OtherSide, variables: np.ndarray, own: np.ndarray, largest: np.ndarray, which: int
    ) -> None:
        """Refuse an output at which variables or their derivatives are others on the other side."""
        direction, at, k = list(self.directions.values())[which], other.at, other.output
        time, x = np.array([at.time]), at.x[None]
        given = at.by[which][None], at.base[which], other.sizes
        found = _slopes_of(other.segment, time, x, given, direction, variables)[0]
        segment = part.segment
        before = segment.observer(variables, segment.time[k : k + 1], segment.table[k : k + 1])[0]
        behind = other.segment.observer(variables, time, x)[0]
        share = max(_DIFFERENT, 1e3 * self.rtol)
        jumps = np.abs(found - own[k]) > share * np.maximum(largest, np.abs(found))
        if (jumps | (np.abs(behind - before) > share * np.maximum(np.abs(behind), np.abs(before)))).any():
            raise at_output(direction.name, float(segment.time[k]), other.said)


def _slopes_of(
    segment: SegmentRecord, times: np.ndarray, states: np.ndarray, tangents: tuple[np.ndarray, np.ndarray, np.ndarray],
    direction: Direction, variables: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the derivatives (times, variables) at places of a segment.

    Parameters
    ----------
    tangents : (times, n), (registers,), (n,) derivatives of the states and of the base, and the sizes of the states
    """
    by, base, sizes = tangents
    moved = np.max((np.abs(by) / sizes)[:, ~segment.observer.plan.ledger], initial=0.0)
    step = STEP * min(direction.size, 1.0 / moved if moved > 0 else np.inf)

    def values(change: float) -> np.ndarray:
        return shifted(segment.observer, direction, change, base)(variables, times, states + change * by)

    return difference(values, step)


def sizes_of(segments: Sequence[SegmentRecord]) -> np.ndarray:
    """Return the sizes (n,) of the states over a motion; 1 where one does not move but for rounding.

    Work and heat have one size: of what hardly flows only rounding is known.
    """
    ledger = segments[0].observer.plan.ledger
    tables = [np.concatenate([p.samples[1], p.table]) for p in segments]
    found = np.max(np.abs(np.concatenate(tables)), axis=0, initial=0.0)
    found[ledger] = np.max(found[ledger], initial=0.0)
    return np.where(found > _ROUNDING * np.max(found, initial=0.0), found, 1.0)


def shifted(observer: Observer, direction: Direction, change: float, base: np.ndarray) -> Observer:
    """Return an observer with other parameter values, nonlinear equations solved near where they were.

    Parameters
    ----------
    base : (registers,) the derivatives of what does not change between events
    """
    return replace(observer, values=direction.values(change), base=observer.base + change * base, solutions=Solutions())


def base_derivatives(observer: Observer, directions: Sequence[Direction]) -> np.ndarray:
    """Return the derivatives (m, registers) of what follows from parameters alone."""

    def base(values: np.ndarray) -> np.ndarray:
        return bases(observer.plan, values, observer.signals, {}).T

    return slopes(base, directions)
