"""States of rest of closed loops, in all of their coordinates.

In minimal coordinates a search stays on one branch, and fails where the coordinates do. In all coordinates the states
of rest are the zeros of the accelerations and of the closures together, more equations than unknowns, but consistent
ones: Newton's method with least squares converges on them from many starts, on every branch. With one degree of freedom
the curve on which the mechanism moves is followed instead, which misses nothing on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.program import needed_steps, read
from lmoc.ir.reduced import Invariants, Reduced
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.evaluate.at_points import AtPoints
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.run.simulate import Simulator
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.support.records import dataclass
from lmoc.symbolic.curve import LoopCurve, walk
from lmoc.symbolic.search import Rest, fineness, rests, scene_size, values_at, within_a_turn
from lmoc.symbolic.system import coordinates_of

if TYPE_CHECKING:
    import sympy

STARTS = 80  # of Newton's method
SAME = 1e-6  # how far apart, in sizes of the mechanism or radians, a place may be from the one that a start gives


class _AtRest:
    """Accelerations and closures as functions of all coordinates, with velocities zero.

    Parameters
    ----------
    reduced : with all coordinates of its loops as states
    values : (flat.count,) parameter values
    inputs : {name: value}; those not given are zero
    """

    def __init__(self, reduced: Reduced, own: Invariants, values: np.ndarray, inputs: Mapping[str, float]) -> None:
        pairs = coordinates_of(reduced)
        self.names = [reduced.state_names[q] for q, _ in pairs]
        flat, registers = reduced.flat, reduced.registers
        self._sources = reduced.states[[q for q, _ in pairs]].astype(int)
        self.variables = registers.variable[self._sources]
        rates = reduced.derivatives[[v if v >= 0 else q for q, v in pairs]]
        closures = own.lower[1][own.lower[1] >= 0]
        self._targets = np.concatenate([rates, closures]).astype(int)
        wanted = np.unique(np.concatenate([np.zeros(0, int), *(read(step) for step in own.program)]))
        program = reduced.rhs + needed_steps(reduced.observe, wanted, registers.count) + own.program
        self._at = AtPoints(program, own.count, self._sources, self._targets)
        w = self._at.w
        w[reduced.known[0]] = values[reduced.known[1]]
        Interpreter(reduced.parameter_program, own.count).run(w, np.nan)
        w[reduced.states] = 0.0
        for register, variable, order in reduced.inputs.T.tolist():
            w[register] = inputs.get(flat.variable_name(variable), 0.0) if order == 0 else 0.0
        self._at.forget()
        units = (flat.block_at(int(v)).unit for v in self.variables)
        self.turning = np.array([unit in ("rad", "deg") for unit in units], bool)

    def values(self, y: np.ndarray) -> np.ndarray:
        self._at.run(y, 0.0)
        return self._at.w[self._targets]

    def slopes(self, y: np.ndarray) -> np.ndarray:
        return self.values_and_slopes(y)[1]

    def values_and_slopes(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.values(y), self._at.derivatives(0.0)

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return accelerations, closures, and the Jacobian of the closures."""
        n = len(self._sources)
        values, slopes = self.values_and_slopes(y)
        return values[:n], values[n:], slopes[n:]

    @property
    def has_one_freedom(self) -> bool:
        return len(self._targets) == 2 * len(self._sources) - 1


@dataclass(frozen=True, eq=False)
class RestOfLoops:
    """A state of rest of closed loops, or a family of them.

    Attributes
    ----------
    values : {coordinate: value}; a free one stands for itself
    place : {coordinate: number}, that of a family with its free coordinates zero
    """

    values: Mapping[sympy.Symbol, sympy.Expr]
    place: Mapping[str, float]


def rests_of_loops(reduced: Reduced, values: np.ndarray, inputs: Mapping[str, float]) -> tuple[list[RestOfLoops], str]:
    """Return the states of rest of a scene with closed loops, on all branches, and how they were sought.

    Parameters
    ----------
    reduced : with all coordinates of the loops as states
    values : (flat.count,) parameter values
    inputs : {name: value}; those not given are zero
    """
    import sympy as sp

    if reduced.invariants is None:
        raise ValueError("the scene has no closed loops")
    still = _AtRest(reduced, reduced.invariants, values, inputs)
    symbols = [sp.Symbol(name) for name in still.names]
    size = scene_size(reduced.flat, values)
    found = rests(still.values, still.slopes, still.turning, STARTS, size)
    how = f"Newton's method from {STARTS} starts in all coordinates; there may be others"
    return [RestOfLoops(values_at(rest, symbols, fineness(size)), _place(rest, still.names)) for rest in found], how


def rests_on_curve(
    reduced: Reduced, minimal: Reduced, values: np.ndarray, inputs: Mapping[str, float]
) -> tuple[list[RestOfLoops], str] | None:
    """Return the states of rest on the curve through the start of a mechanism with one degree of freedom.

    None where it has more, or no start.

    Parameters
    ----------
    reduced, values, inputs : as of `rests_of_loops`
    minimal : in minimal coordinates, for the start
    """
    import sympy as sp

    if reduced.invariants is None:
        raise ValueError("the scene has no closed loops")
    still = _AtRest(reduced, reduced.invariants, values, inputs)
    start = start_of(minimal, values, inputs, still.variables) if still.has_one_freedom else None
    if start is None:
        return None
    size = float(np.abs(start[~still.turning]).max(initial=0.0)) or 1.0
    scale = np.where(still.turning, 1.0, size)
    gone = walk(LoopCurve(still.parts, scale, still.turning, redundant=bool(reduced.left_out)), start)
    alone = [Rest(within_a_turn(y, still.turning), (), np.zeros((len(y), 0))) for y in gone.found]
    alone = sorted((_rounded(rest, scale) for rest in alone), key=lambda rest: tuple(np.round(rest.at, 9)))
    symbols = [sp.Symbol(name) for name in still.names]
    how = f"sign changes {gone.end}; other branches are not searched"
    return [RestOfLoops(values_at(rest, symbols, fineness(size)), _place(rest, still.names)) for rest in alone], how


def _rounded(rest: Rest, scale: np.ndarray) -> Rest:
    """Return a state of rest without what is rounding next to the size of the mechanism."""
    return Rest(np.where(np.abs(rest.at) < 1e-12 * scale, 0.0, rest.at), rest.free, rest.along)


def start_of(
    reduced: Reduced,
    values: np.ndarray,
    inputs: Mapping[str, float],
    variables: np.ndarray,
    initial: Mapping[str, float] | None = None,
) -> np.ndarray | None:
    """Return the values of variables where a run starts; None where it cannot start."""
    options = RunOptions(times=[reduced.flat.experiment.start or 0.0])
    try:
        return np.asarray(Simulator(reduced).run(values, options, inputs, initial).of(variables)[0], float)
    except (ModelError, SimulationError):
        return None


def keeps_its_closures(
    there: Reduced, values: np.ndarray, inputs: Mapping[str, float], place: Mapping[str, float]
) -> bool:
    """Return whether a run can start at a place and is there, with constraints that are left out as redundant.

    Parameters
    ----------
    there : in coordinates that serve at the place
    place : {coordinate: value}
    """
    names = [name for name in place if there.flat.find(name) is not None]
    variables = np.array([int(there.flat.find(name)[0]) for name in names], int)
    found = start_of(there, values, inputs, variables, {n: place.get(n, 0.0) for n in there.state_names})
    if found is None:
        return False
    wanted = np.array([place[name] for name in names])
    turning = np.array([there.flat.block_at(int(v)).unit in ("rad", "deg") for v in variables], bool)
    apart = np.where(turning, np.sin((found - wanted) / 2), found - wanted)
    size = 1.0 if turning.all() else float(np.abs(wanted[~turning]).max()) or 1.0
    return bool((np.abs(apart) <= SAME * np.where(turning, 1.0, size)).all())


def _place(rest: Rest, names: list[str]) -> dict[str, float]:
    return dict(zip(names, rest.at.tolist(), strict=True))
