"""Derivatives of a smooth motion by parameters and start values: the variational equations, integrated with the states.

``S' = f_x S + f_p`` (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), I.14), with the
tangents of the program. What they begin with, and what variables follow from states, are functions without time:
their derivatives are differences of order four.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.coordinates.change import all_unknowns, with_solutions
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.failures.chatter import jumps
from lmoc.numerics.observe.observer import Observer, find
from lmoc.numerics.observe.solutions import Solutions
from lmoc.numerics.observe.trajectory import SegmentRecord, Trajectory
from lmoc.numerics.plan import kinks
from lmoc.numerics.signals.signals import break_times
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

STEP = 1e-3  # of a quantity's size, of differences of order four: their error is some 1e-12
_CENTRAL = ((1, 8 / 12), (-1, -8 / 12), (2, -1 / 12), (-2, 1 / 12))
_AHEAD = ((0, -25 / 12), (1, 4.0), (2, -3.0), (3, 4 / 3), (4, -1 / 4))
_SHARE = 0.1  # of the run's tolerance
_FINEST = 1e-13
_ABSOLUTE = 1e-2  # of the relative tolerance times the size
_APART = 1e4  # tolerances by which the states may differ from those of the run
EXPLICIT = frozenset({"dop853", "taylor", "none"})
Values = Callable[[float], np.ndarray]


@dataclass(frozen=True, eq=False)
class Direction:
    """A quantity by which the motion is differentiated.

    Attributes
    ----------
    name : of a parameter or of a variable at the start
    size : its size, of which differences take a part
    values : from its change to the parameter values (flat.count,)
    start : (n,) derivatives of the states at the start
    """

    name: str
    size: float
    values: Values
    start: np.ndarray


def difference(function: Callable[[float], np.ndarray], step: float) -> np.ndarray:
    """Return the derivative of a function at 0, from differences of order four: ahead, where there is nothing behind.

    A parameter may stand at its bound, such as a damping of zero.
    """
    try:
        return sum(weight * function(k * step) for k, weight in _CENTRAL) / step  # type: ignore[return-value]
    except ModelError:
        return sum(weight * function(k * step) for k, weight in _AHEAD) / step  # type: ignore[return-value]


def refused(reason: str, hint: str = "") -> ModelError:
    """Return the error that says why there are no sensitivities."""
    hint = hint or "differences of two runs are an approximation: simulate with the value a little larger and smaller"
    return ModelError([Diagnostic("E0575", f"sensitivities are not available: {reason}", hint=hint)])


def changed_values(
    flat: FlatDAE, held: Mapping[int, float], variable: int, value: float, count: int, change: float
) -> np.ndarray:
    """Return parameter values (count,) with one of them changed; those of variables that a reduction added are NaN."""
    found = flat.parameter_values({**held, variable: value + change})
    return np.concatenate([found, np.full(count - len(found), np.nan)])


def smooth_segment(trajectory: Trajectory) -> SegmentRecord:
    """Return the only segment of a motion without events.

    Raises
    ------
    ModelError
        E0575: the motion is not of that kind.
    """
    segment, flat = trajectory.segments[0], trajectory.flat
    plan = segment.observer.plan
    if flat.laws or flat.events is not None or trajectory.events:
        raise refused("the scene has laws or events, behind which derivatives jump")
    if len(trajectory.segments) > 1:
        raise refused("the coordinates change on the way")
    if plan.reduced.in_all_coordinates:
        raise refused("the loops are integrated in all their coordinates", "formulation='reduced'")
    if trajectory.kept is not None:
        raise refused("only some variables are kept of the run", "leave out keep")
    if plan.once(jumps):
        raise refused("the equations jump where a condition on the motion changes")
    return segment


class Sensitivities:
    """The derivatives of a run.

    Attributes
    ----------
    directions : by which it is differentiated
    tangents : (directions, times, states)
    """

    def __init__(
        self, segment: SegmentRecord, first: np.ndarray, directions: Sequence[Direction], rtol: float, explicit: bool
    ) -> None:
        """
        Parameters
        ----------
        first : (n,) the states at the start
        rtol, explicit : of the run: its tolerance, and whether its method was explicit

        Raises
        ------
        ModelError
            E0575: instants at which the equations have kinks depend on what is asked for, or the integration failed.
        """
        self.segment, self.directions = segment, {d.name: d for d in directions}
        self._sizes = np.max(np.abs(segment.samples[1]), axis=0, initial=0.0)
        self._sizes = np.maximum(self._sizes, np.max(np.abs(segment.table), axis=0, initial=0.0))
        self._sizes = np.where(self._sizes > 0, self._sizes, 1.0)
        self.tangents = _Sweep(segment, directions, self._sizes, rtol, explicit).go(first)

    def __call__(self, name: str, by: str) -> np.ndarray:
        """Return the derivative (T,) of a variable by a quantity.

        Raises
        ------
        KeyError
            There is no such variable, or it was not asked for derivatives by this quantity.
        """
        if by not in self.directions:
            raise KeyError(f"sensitivities were asked for by {', '.join(self.directions)}, not by '{by}'")
        direction, tangent = self.directions[by], self.tangents[list(self.directions).index(by)]
        observer, segment = self.segment.observer, self.segment
        variables = find(observer.flat, name)
        moved = np.max(np.abs(tangent) / self._sizes, initial=0.0)
        step = STEP * min(direction.size, 1.0 / moved if moved > 0 else np.inf)

        def values(change: float) -> np.ndarray:
            own = shifted(observer, direction, change)
            return own(variables, segment.time, segment.table + change * tangent)

        found = difference(values, step)
        return found[:, 0] if len(variables) == 1 else found


def shifted(observer: Observer, direction: Direction, change: float) -> Observer:
    """Return an observer with other parameter values, nonlinear equations solved near where they were."""
    values = direction.values(change)
    unknowns = all_unknowns(observer.plan)
    base = with_solutions(observer.plan.base(values, observer.signals), unknowns, observer.base[unknowns])
    return replace(observer, values=values, base=base, solutions=Solutions())


class _Sweep:
    """States and tangents, integrated together."""

    def __init__(
        self, segment: SegmentRecord, directions: Sequence[Direction], sizes: np.ndarray, rtol: float, explicit: bool
    ) -> None:
        observer = self.observer = segment.observer
        self.segment, self.directions, self.explicit = segment, directions, explicit
        self.plan, self.n, self.m = observer.plan, len(observer.plan.states), len(directions)
        self.rtol, self.sizes = max(_SHARE * rtol, _FINEST), sizes
        self.scale = np.array([d.size for d in directions])
        changes = [difference(lambda c, d=d: self._base(d, c), STEP * d.size) for d in directions]
        moving = np.stack([np.nan_to_num(change) for change in changes])
        own = np.isin(np.arange(self.plan.count), self.plan.parameters)
        self.registers = np.flatnonzero(own & (moving != 0).any(axis=0))
        self.moving = moving[:, self.registers].T * self.scale  # (registers, m)
        # parameters beside the states, as what stays: so their columns are beside those of the states
        inputs = np.concatenate([self.plan.states, self.registers])
        outputs = np.concatenate([self.plan.derivatives, self.registers])
        self.system = EngineSystem(self.plan, self.plan.program, inputs, outputs)
        self.system.prepare(observer.base, observer.signals)
        self._held = observer.base[self.registers]
        starts, self._rows = self.system.pattern()
        self._columns = np.repeat(np.arange(self.system.n), np.diff(starts))
        self._entries = np.zeros(len(self._rows))

    def _base(self, direction: Direction, change: float) -> np.ndarray:
        return self.plan.base(direction.values(change), self.observer.signals)

    def _breaks(self, begin: float, end: float) -> np.ndarray:
        """Return where the equations have kinks in time.

        Raises
        ------
        ModelError
            E0575: these instants depend on what the motion is differentiated by.
        """
        own = kinks.break_times(self.plan, self.observer.base, begin, end)
        for direction in self.directions:
            for sign in (-1, 1):
                base = self._base(direction, sign * STEP * direction.size)
                other = kinks.break_times(self.plan, base, begin, end)
                if len(other) != len(own) or np.any(np.abs(other - own) > 1e-12 * max(abs(begin), abs(end))):
                    raise refused(f"'{direction.name}' moves the instants at which the equations jump or have kinks")
        return distinct(np.concatenate([own, break_times(self.observer.signals, begin, end, kinks.MOST)]))

    def _jacobian(self, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rates (n,), and their derivatives (n, n + registers)."""
        system = self.system
        system.jacobian_values(t, np.concatenate([x, self._held]), self._entries)
        found = np.zeros((system.n, system.n))
        found[self._rows, self._columns] = self._entries
        return system.registers[self.plan.derivatives], found[: self.n]

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the rates of states and tangents, (n·(1 + m),)."""
        parts = y.reshape(1 + self.m, self.n)
        rates, found = self._jacobian(t, parts[0])
        forced = (found[:, self.n :] @ self.moving).T if len(self.registers) else 0.0
        return np.concatenate([rates, (parts[1:] @ found[:, : self.n].T + forced).ravel()])

    def matrix(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the derivatives of the rates without those of the tangents' own matrix: for Newton's method."""
        return np.kron(np.eye(1 + self.m), self._jacobian(t, y[: self.n])[1][:, : self.n])

    def go(self, first: np.ndarray) -> np.ndarray:
        """Return the tangents (m, times, n) at the output times, from the states at the start (n,)."""
        from scipy.integrate import solve_ivp

        segment, times = self.segment, self.segment.time
        begin, end = segment.begin, float(times[-1])
        starts = np.stack([d.start for d in self.directions]) * self.scale[:, None]
        y = np.concatenate([first, starts.ravel()])
        found = np.full((len(times), len(y)), np.nan)
        found[times <= begin] = y
        edges = [begin, *(b for b in self._breaks(begin, end) if begin < b < end), end]
        atol = _ABSOLUTE * self.rtol * np.tile(self.sizes, 1 + self.m)
        method = {"method": "DOP853"} if self.explicit else {"method": "Radau", "jac": self.matrix}
        for a, b in zip(edges, edges[1:], strict=False):
            if not b > a:
                continue
            inside = (times > a) & (times <= b)
            margin = 4e-15 * max(abs(a), abs(b))  # on this side of the kinks
            asked = np.clip(times[inside], a + margin, b - margin)
            grid = np.unique(np.append(asked, b - margin))
            result = solve_ivp(self.rhs, (a + margin, b - margin), y, t_eval=grid, rtol=self.rtol, atol=atol, **method)
            if not result.success or not np.isfinite(result.y).all():
                raise refused(f"their integration failed behind t = {a:g} s: {result.message}")
            found[inside], y = result.y.T[np.searchsorted(grid, asked)], result.y[:, -1]
        self._agree(found[:, : self.n])
        tangents = found[:, self.n :].reshape(len(times), self.m, self.n)
        return np.moveaxis(tangents, 1, 0) / self.scale[:, None, None]

    def _agree(self, states: np.ndarray) -> None:
        """Refuse tangents along another motion than that of the run."""
        apart = np.abs(states - self.segment.table) / self.sizes
        if not np.max(apart, initial=0.0) <= _APART * max(10 * self.rtol, 1e-12):
            raise refused("the motion depends on its values so much that it cannot be repeated within its tolerance")
