"""States and their tangents as one system: ``x' = f(x, p)`` with ``S' = f_x S + f_p D``, on one tape.

Let the program begin with ``x + S z`` and ``p + D z`` for z = 0: its derivatives by z are the rates of the tangents, as
many columns as there are directions, and no matrix f_x is made on the way (Griewank & Walther, Evaluating Derivatives,
2008, chapter 3). Implicit equations are solved once, and their derivatives have the same matrix.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.engine.accelerator import TapeAccelerator, cost
from lmoc.engine.series_text import cost_of_series
from lmoc.expression.dag import Expr, slot
from lmoc.ir.program import Apply, Program, needed_steps
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.chain_rule import ChainRule
from lmoc.lower.forward import Forward
from lmoc.lower.recurrences import NoSeries
from lmoc.lower.series import series_of
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.evaluate.taylor_system import TaylorSystem, Written
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.structure.linear.substitution import partition
from lmoc.support.records import dataclass

_STAGES = 12  # of a step of DOP853
# As many of its steps as one along a series pays for at least. Of tangents by three parameters, at 1e-6: quarter car
# 6.7 (a step costs 2.7 times as much), double pendulum 1.7 (4.9), four-bar 1.7 (5.1).
_LONGER = 3.0
_KEPT = 8  # sets of directions whose tapes a plan keeps


@dataclass(frozen=True, eq=False)
class Tangents:
    """What is integrated of a plan with tangents in some directions; registers of its own follow those of the plan.

    Attributes
    ----------
    program : that of the plan behind the step that adds the tangents
    inputs : (n·(1 + m),) registers of the states, then of the tangents, one direction after the other
    outputs : places of their rates, (n·(1 + m),), or of what else is wanted, (k·(1 + m),)
    held, directions : (k,), (k, m) registers of the parameters that move, and of how
    along : (m,) registers of z
    accelerator : of the tape
    """

    program: Program
    inputs: np.ndarray
    outputs: np.ndarray
    held: np.ndarray
    directions: np.ndarray
    along: np.ndarray
    accelerator: TapeAccelerator


def _kept(plan: Plan) -> dict[tuple[bytes, bytes, int, bytes], Tangents]:
    return {}


def _kept_series(plan: Plan) -> dict[tuple[bytes, bytes, int], TangentSeries | str]:
    return {}


def tangent_system(plan: Plan, registers: np.ndarray, directions: np.ndarray) -> TangentSystem:
    """Return the tangents of a plan as a system, made once for the same parameters; `prepare` is to follow."""
    kept, moves = plan.once(_kept_systems), directions != 0
    key = registers.tobytes(), moves.tobytes(), moves.shape[1]
    if key not in kept:
        for oldest in list(kept)[: 1 - _KEPT]:
            kept.pop(oldest, None)
        kept[key] = TangentSystem(plan, registers, directions)
    kept[key].directions = directions
    return kept[key]


def _kept_systems(plan: Plan) -> dict[tuple[bytes, bytes, int], TangentSystem]:
    return {}


def tangents_of(plan: Plan, registers: np.ndarray, moves: np.ndarray, wanted: np.ndarray | None = None) -> Tangents:
    """Return the tangents of a plan, made once for the same parameters.

    Parameters
    ----------
    registers : (k,) parameters that move
    moves : (k, m) in which directions they do
    wanted : registers in place of the rates of the states
    """
    kept, own = plan.once(_kept), b"" if wanted is None else wanted.tobytes()
    key = registers.tobytes(), moves.tobytes(), moves.shape[1], own
    if key not in kept:
        for oldest in list(kept)[: 1 - _KEPT]:
            kept.pop(oldest, None)
        program = plan.program if wanted is None else needed_steps(plan.full_program, wanted, plan.count)
        kept[key] = _made(plan, registers, moves, program, plan.derivatives if wanted is None else wanted)
    return kept[key]


def _made(plan: Plan, registers: np.ndarray, moves: np.ndarray, steps: Program, wanted: np.ndarray) -> Tangents:
    n, (k, m) = len(plan.states), moves.shape
    inputs, held, directions, z = np.split(
        plan.count + np.arange(n * (1 + m) + k * (1 + m) + m), np.cumsum([n * (1 + m), k, k * m])
    )
    directions = directions.reshape(k, m)
    columns = inputs.reshape(1 + m, n).T
    program = (
        *_moved(plan.states, columns[:, 0], columns[:, 1:], np.ones((n, m), bool), z),
        *_moved(registers, held, directions, moves, z),
        *steps,
    )
    count = plan.count + n * (1 + m) + k * (1 + m) + m
    rule = ChainRule(program, z, wanted, count)
    tape = derivatives_tape(program, rule, count, values=True)
    rates = np.full((len(wanted), m), z[0])  # zero, where nothing moves
    rates[rule.rows, rule.columns] = tape.results
    outputs = np.concatenate([wanted, rates.T.ravel()])
    return Tangents(program, inputs, outputs, held, directions, z, TapeAccelerator(tape))


def _moved(out: np.ndarray, held: np.ndarray, by: np.ndarray, moves: np.ndarray, z: np.ndarray) -> list[Apply]:
    """Return steps for ``held + Σ by·z`` over the directions in which a row moves."""
    steps = []
    for own, rows in partition(moves.astype(int)) if len(moves) else []:
        chosen, which = (slice(None) if rows is None else rows), np.flatnonzero(own)
        shape: Expr = slot(0)
        for j in range(len(which)):
            shape = shape + slot(1 + j) * slot(1 + len(which) + j)
        at = held[chosen]
        slots = np.concatenate([at[:, None], by[chosen][:, which], np.tile(z[which], (len(at), 1))], axis=1)
        steps.append(Apply(shape, slots, out[chosen]))
    return steps


class TangentSeries(TaylorSystem):
    """States and tangents with their Taylor series, from the derivatives of the program as a program.

    Attributes
    ----------
    directions : as of `TangentSystem`
    pays : whether its steps are not dearer than they are longer
    """

    directions: np.ndarray

    def __init__(self, plan: Plan, registers: np.ndarray, moves: np.ndarray, cost_of_step: float) -> None:
        """
        Parameters
        ----------
        registers, moves : as of `tangents_of`
        cost_of_step : of DOP853

        Raises
        ------
        NoSeries
        """
        n, (k, m) = len(plan.states), moves.shape
        self._registers = registers
        self._at = plan.count + n * m + np.arange(k * m).reshape(k, m)
        moving = np.full((plan.count + (n + k) * m + 1, m), -1)
        moving[plan.states] = tangents = plan.count + np.arange(n * m).reshape(m, n).T
        moving[registers] = np.where(moves, self._at, -1)
        found = Forward(plan.program, moving, len(moving))
        rates = found.moving[plan.derivatives]
        rates[rates < 0] = len(moving) - 1  # zero, where nothing moves
        inputs = np.concatenate([plan.states, tangents.T.ravel()])
        outputs = np.concatenate([plan.derivatives, rates.T.ravel()])
        tape = values_tape(found.steps, found.count)
        if len(plan.sampled):
            raise NoSeries("an input has no formula")
        series = series_of(found.steps, found.count, tape.size, inputs, outputs)
        super().__init__(plan, Written(found.steps, inputs, outputs, TapeAccelerator(tape), series))
        self.pays = cost_of_series(series.code) <= _LONGER * cost_of_step

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        self.w[self.plan.count :] = 0.0
        self.w[self._at] = self.directions
        super().prepare(base, signals)


class TangentSystem(EngineSystem):
    """The tangents of a plan, for one set of directions.

    Attributes
    ----------
    directions : as given; others of the same pattern may take their place before `prepare`

    Its Jacobian is that of the states for each of the tangents: how these rates depend on the states themselves is
    left out, which Newton's method can do without.
    """

    def __init__(
        self, plan: Plan, registers: np.ndarray, directions: np.ndarray, wanted: np.ndarray | None = None
    ) -> None:
        """
        Parameters
        ----------
        registers : (k,) parameters that move
        directions : (k, m) how
        wanted : registers in place of the rates of the states, for `values`
        """
        own = tangents_of(plan, registers, directions != 0, wanted)
        outputs = own.outputs if wanted is None else own.inputs
        super().__init__(plan, own.program, own.inputs, outputs, own.accelerator)
        self._places, self._along = own.outputs, own.along
        self._own_registers, self._moving, self.directions = own, registers, directions
        self._copies = 1 + directions.shape[1]
        self._states: EngineSystem | None = None

    def with_series(self, of_plan: object) -> TangentSeries:  # type: ignore[override]
        kept, moves = self.plan.once(_kept_series), self.directions != 0
        key = self._moving.tobytes(), moves.tobytes(), moves.shape[1]
        if key not in kept:
            for oldest in list(kept)[: 1 - _KEPT]:
                kept.pop(oldest, None)
            try:
                kept[key] = TangentSeries(self.plan, self._moving, moves, _STAGES * cost(self.kernel.tape))
            except NoSeries as reason:
                kept[key] = str(reason)
        found = kept[key]
        if isinstance(found, str):
            raise NoSeries(found)
        found.directions = self.directions
        return found

    @property
    def suits_series(self) -> bool:
        """Whether it has a Taylor series whose steps are not dearer than they are longer than those of DOP853."""
        try:
            return self.with_series(None).pays
        except NoSeries:
            return False

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        own = self._own_registers
        self.w[self.plan.count :] = 0.0
        self.w[own.held], self.w[own.directions] = base[self._moving], self.directions
        super().prepare(base, signals)
        self._states = None

    def aside(self, t: float, x: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return the rates (n·(1 + m),) at a place moved along the tangents by these shares (m,) of them."""
        found = np.empty(self.n)
        self.w[self._along] = along
        self.rhs(t, x, found)
        self.w[self._along] = 0.0
        return found

    def values(self, t: float, x: np.ndarray, near: EngineSystem) -> np.ndarray:
        """Return what is wanted, and its tangents, (1 + m, k); NaN where there is none.

        Parameters
        ----------
        x : (n·(1 + m),) the states and tangents
        near : a system of this plan that stands there
        """
        unknowns = near.kernel.unknowns
        self.rhs_near(t, x, unknowns, near.registers[unknowns], np.empty(self.n))
        found = self.kernel.w[self._places].reshape(self._copies, -1)
        return found if np.isfinite(self.kernel.w[self.inputs]).all() else np.full(found.shape, np.nan)

    def _of_states(self) -> EngineSystem:
        if self._states is None:
            self._states = EngineSystem(self.plan)
            self._states.prepare(*self.given)
        return self._states

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        start, rows = self._of_states().pattern()
        n, each = len(start) - 1, len(rows)
        starts = [start[:-1] + k * each for k in range(self._copies)]
        every = np.concatenate([rows + k * n for k in range(self._copies)])
        return np.append(np.concatenate(starts), self._copies * each).astype(np.int32), every.astype(np.int32)

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        states = self._of_states()
        values = np.empty(len(out) // self._copies)
        states.jacobian_values(t, x[: states.n], values)
        out[:] = np.tile(values, self._copies)
