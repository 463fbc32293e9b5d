"""States of rest of closed loops, in all of their coordinates.

In minimal coordinates a search stays on one branch, and fails where the coordinates do. In all coordinates the states
of rest are the zeros of the accelerations and of the closures together, more equations than unknowns, but consistent
ones: Newton's method with least squares converges on them from many starts, on every branch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.program import needed_steps, read
from lmoc.ir.reduced import Invariants, Reduced
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.support.records import dataclass
from lmoc.symbolic.search import Rest, rests, values_at
from lmoc.symbolic.system import coordinates_of

if TYPE_CHECKING:
    import sympy

STARTS = 80  # of Newton's method


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
        rates = reduced.derivatives[[v if v >= 0 else q for q, v in pairs]]
        closures = own.lower[1][own.lower[1] >= 0]
        self._targets = np.concatenate([rates, closures]).astype(int)
        wanted = np.unique(np.concatenate([np.zeros(0, int), *(read(step) for step in own.program)]))
        program = reduced.rhs + needed_steps(reduced.observe, wanted, registers.count) + own.program
        self._interpreter = Interpreter(program, own.count)
        self._jacobian = Jacobian(program, self._sources, self._targets, own.count)
        self._w = np.full(own.count, np.nan)
        self._w[reduced.known[0]] = values[reduced.known[1]]
        Interpreter(reduced.parameter_program, own.count).run(self._w, np.nan)
        self._w[reduced.states] = 0.0
        for register, variable, order in reduced.inputs.T.tolist():
            self._w[register] = inputs.get(flat.variable_name(variable), 0.0) if order == 0 else 0.0
        units = (flat.block_at(int(v)).unit for v in registers.variable[self._sources])
        self.turning = np.array([unit in ("rad", "deg") for unit in units], bool)

    def values(self, y: np.ndarray) -> np.ndarray:
        self._w[self._sources] = y
        self._interpreter.run(self._w, 0.0)
        return self._w[self._targets].copy()

    def slopes(self, y: np.ndarray) -> np.ndarray:
        self.values(y)
        dense = np.zeros((len(self._targets), len(self._sources)))
        dense[self._jacobian.rows, self._jacobian.columns] = self._jacobian.values(self._w, 0.0)
        return dense


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
    found = rests(still.values, still.slopes, still.turning, STARTS)
    how = f"Newton's method from {STARTS} starts in all coordinates; there may be others"
    return [RestOfLoops(values_at(rest, symbols), _place(rest, still.names)) for rest in found], how


def _place(rest: Rest, names: list[str]) -> dict[str, float]:
    return {name: 0.0 if i in rest.free else float(rest.at[i]) for i, name in enumerate(names)}
