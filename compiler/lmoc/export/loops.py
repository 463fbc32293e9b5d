"""Closed loops in an FMU: those whose minimal coordinates change along the motion have all coordinates as states.

That is the formulation `projected`: one state vector serves everywhere, as Model Exchange asks for, and the closures
are those of `numerics/formulations`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.export.refusals import refusal
from lmoc.export.variables import Place, Variable
from lmoc.ir.program import Program
from lmoc.ir.reduced import Reduced
from lmoc.lower.tape import Tape
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.formulations.closing import ClosureStage, closing
from lmoc.numerics.formulations.landing import stage_tapes
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.task.sizes import assumed_sizes
from lmoc.structure.laws.degree import dependent
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.run import Run


@dataclass(frozen=True, eq=False)
class LoopTables:
    """Closures as an FMU holds them (``fmu_loops`` in ``export/c/fmu.h``).

    Attributes
    ----------
    stages : positions, then velocities
    tapes : one for each; results are the entries of its Jacobian, then its residuals
    given : registers that they read and that parameters fill
    scale : (states,) sizes
    free : (states,) whether a state is given at the start; the others follow
    """

    stages: tuple[ClosureStage, ...]
    tapes: tuple[Tape, ...]
    given: np.ndarray
    scale: np.ndarray
    free: np.ndarray


def in_all_coordinates(dae: CompiledDAE, run: Run, inputs: dict[str, float]) -> Run | None:
    """Return the run in all coordinates of closed loops; None where its minimal coordinates serve all the way.

    Raises
    ------
    ModelError
        E0669: they do not, and not all coordinates can be states.
    """
    segments, chosen = run.trajectory.segments, dae.reduced.states
    other = [s for s in segments if not np.array_equal(s.observer.plan.reduced.states, chosen)]
    if not other and not dae.reduced.in_all_coordinates:
        return None
    begin = other[0].begin if other else segments[0].begin
    why = f"its coordinates change along the motion, at t = {begin:.6g} s"
    if dae.flat.events is not None or dae.flat.laws:
        raise refusal(dae.flat, f"{why}, and it has laws or events")
    try:
        found = dae.simulate(energy=False, inputs=inputs, formulation="projected")
    except ModelError as error:
        raise refusal(dae.flat, f"{why}, and in all coordinates {error.diagnostics[-1].message}") from error
    if not found.trajectory.segments[0].observer.plan.reduced.in_all_coordinates:
        raise refusal(dae.flat, why)
    return found


def loop_tables(plan: Plan, values: np.ndarray, start: np.ndarray, inputs: np.ndarray, minimal: Plan) -> LoopTables:
    """Return the closures of a plan in all coordinates.

    Parameters
    ----------
    start : (states,)
    inputs : registers that are set from outside
    minimal : of the run in minimal coordinates, whose states are given at the start where they are among these

    Raises
    ------
    ModelError
        E0669: the closures follow something that is set from outside.
    """
    own = plan.once(closing)
    outside = own.parameters[np.isin(own.parameters, inputs)]
    if len(outside):
        name = plan.reduced.register_name(int(outside[0]))
        why = f"its coordinates change along the motion, and its closed loops follow the input '{name}'"
        raise refusal(plan.reduced.flat, why)
    tapes = tuple(
        replace(tape, results=np.concatenate([tape.results, stage.residual]))
        for stage, tape in zip(own.stages, plan.once(stage_tapes), strict=True)
    )
    jets, chosen = _jets(plan), _jets(minimal)
    free = np.array([jet in chosen for jet in jets], bool)
    if free.sum() != len(chosen) or len(chosen) == len(jets) or any(v < 0 for v, _ in chosen):
        free[:] = False
    return LoopTables(own.stages, tapes, own.parameters, assumed_sizes(plan, values, start, {}), free)


_EIGHTH = {"rad": np.pi / 4, "deg": 45.0}  # the two ways to close four bars are further apart but near a singular place


@dataclass(frozen=True, eq=False)
class Tied:
    """Variables of closed loops that are not given at the start.

    Attributes
    ----------
    registers, values : (n,) where they are observed, and what they are at the start of the scene
    reach : (n,) how far from there an instance may start without a word
    """

    registers: np.ndarray
    values: np.ndarray
    reach: np.ndarray


def tied_ones(plan: Plan, minimal: Reduced, run: Run, loops: LoopTables | None) -> Tied:
    """Return the variables of closed loops that tell whether an instance begins near the start of the scene: within an
    eighth of a turn, and for lengths within the largest of them.

    Parameters
    ----------
    minimal : the scene in the coordinates with which it begins
    run : of the scene, in the coordinates of `plan`
    """
    flat, guess = plan.reduced.flat, minimal.guess
    given = plan.states if loops is None else plan.states[loops.free]
    variables = np.zeros(0, int) if guess is None or not guess.closed else np.asarray(guess.tied, int)
    registers = plan.reduced.register_of[variables]
    registers, first = np.unique(registers, return_index=True)
    kept = (registers >= 0) & ~np.isin(registers, given)
    variables, registers = variables[first[kept]], registers[kept]
    values = np.array([run[flat.variable_name(int(v))][0] for v in variables], float)
    units = np.array([flat.block_at(int(v)).unit for v in variables], object)
    reach = np.array([_EIGHTH.get(u, np.abs(values[units == u]).max() or np.inf) for u in units.tolist()], float)
    return Tied(registers, values, reach)


def _jets(plan: Plan) -> list[tuple[int, int]]:
    """Return (variable, order) of each state."""
    table = plan.reduced.registers
    return list(zip(table.variable[plan.states].tolist(), table.order[plan.states].tolist(), strict=True))


def closing_parameters(loops: LoopTables | None, program: Program, parameters: np.ndarray, count: int) -> np.ndarray:
    """Return (parameters,) whether closures depend on a parameter.

    Parameters
    ----------
    program : fills what follows from parameters
    parameters : registers
    count : registers
    """
    if loops is None:
        return np.zeros(len(parameters), bool)
    moved = [dependent(program, np.array([p]), count)[loops.given].any() for p in parameters.tolist()]
    return np.array(moved, bool)


def as_given(variables: tuple[Variable, ...], loops: LoopTables, closing: np.ndarray) -> tuple[Variable, ...]:
    """Return variables of which those that follow are calculated, and parameters of closures keep their values."""

    def changed(v: Variable) -> Variable:
        if v.place == Place.STATE and not loops.free[v.index]:
            return replace(v, initial="calculated")
        if v.place == Place.PARAMETER and closing[v.index]:
            return replace(v, variability="fixed")
        return v

    return tuple(map(changed, variables))
