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
from lmoc.ir.flat import Kind
from lmoc.ir.program import Program
from lmoc.ir.reduced import Reduced
from lmoc.lower.tape import Tape
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.formulations.closing import Closing, ClosureStage, closing
from lmoc.numerics.formulations.landing import stage_tapes
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.task.sizes import assumed_sizes
from lmoc.structure.laws.degree import dependent
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.numerics.observe.trajectory import Trajectory
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


def in_all_coordinates(dae: CompiledDAE, run: Run) -> Reduced | None:
    """Return the scene in all coordinates of closed loops; None where its minimal coordinates serve all the way.

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
    try:
        found = dae._session.in_all_coordinates(dae._session.prepare()[1])
    except ModelError as error:
        raise refusal(dae.flat, f"{why}, and in all coordinates {error.diagnostics[-1].message}") from error
    if not found.in_all_coordinates:
        raise refusal(dae.flat, why)
    return found


def states_along(run: Trajectory, plan: Plan) -> np.ndarray:
    """Return the states of a plan along a run in whatever coordinates, (times, states)."""
    found = [run.derivative(variable, order) for variable, order in _jets(plan, plan.states)]
    _check(plan, plan.states, [own is not None for own in found])
    return np.stack([own for own in found if own is not None], axis=1)


def values_at_start(run: Trajectory, plan: Plan, registers: np.ndarray) -> np.ndarray:
    """Return what registers of a plan stand for where a run in whatever coordinates starts, before what events do."""
    first = run.segments[0]
    x, base = (first.table[0], first.observer.base) if run.begun is None else run.begun
    there = Observer(first.observer.plan, first.observer.values, base, first.observer.signals)
    own = [there.derivative(variable, order) for variable, order in _jets(plan, registers)]
    _check(plan, registers, [r >= 0 for r in own])
    return np.array([there.register(r, first.time[:1], x[None])[0] for r in own], float)


def _check(plan: Plan, registers: np.ndarray, known: list[bool]) -> None:
    """Refuse a scene some of whose states have no value along its run."""
    for register, own in zip(registers.tolist(), known, strict=True):
        if not own:
            name = plan.reduced.register_name(register)
            raise refusal(plan.reduced.flat, f"its coordinates change along the motion, on which '{name}' is not known")


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
    register, variable, _ = plan.reduced.inputs
    discrete = register[plan.reduced.flat.kind[variable] == Kind.DISCRETE]
    for moved, what in ((inputs, "input"), (discrete, "discrete variable")):
        outside = own.parameters[np.isin(own.parameters, moved)]
        if len(outside):
            name = plan.reduced.register_name(int(outside[0]))
            why = f"its coordinates change along the motion, and its closed loops follow the {what} '{name}'"
            raise refusal(plan.reduced.flat, why)
    _refuse_reinits(plan, own)
    tapes = tuple(
        replace(tape, results=np.concatenate([tape.results, stage.residual]))
        for stage, tape in zip(own.stages, plan.once(stage_tapes), strict=True)
    )
    jets, chosen = _jets(plan, plan.states), _jets(minimal, minimal.states)
    free = np.array([jet in chosen for jet in jets], bool)
    if free.sum() != len(chosen) or len(chosen) == len(jets) or any(v < 0 for v, _ in chosen):
        free[:] = False
    return LoopTables(own.stages, tapes, own.parameters, assumed_sizes(plan, values, start, {}), free)


def _refuse_reinits(plan: Plan, closing: Closing) -> None:
    """Refuse `reinit` in closed loops but of the velocity of one whose other velocities follow from it.

    What else it leaves as it is would depend on the coordinates in which a run happens to be there.
    """
    flat = plan.reduced.flat
    targets = [] if flat.events is None else [v for r in flat.events.reinits for v in r.target.tolist()]
    place = {int(r): k for k, r in enumerate(plan.states.tolist())}
    for variable in targets:
        register = int(plan.reduced.register_of[variable])
        for stage in closing.stages:
            for g in stage.loops:
                one = stage is closing.stages[-1] and g.columns.shape[1] - g.rows.shape[1] == 1
                inside = place.get(register, -1) in g.columns
                moved = dependent(plan.full_program, plan.states[g.columns.ravel()], plan.count)[register]
                if (inside and not one) or (moved and register not in place):
                    name = flat.variable_name(variable)
                    why = f"its coordinates change along the motion, and `reinit` sets '{name}' in a closed loop"
                    raise refusal(flat, f"{why}: it can set one velocity of a loop with one freedom")


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


def _jets(plan: Plan, registers: np.ndarray) -> list[tuple[int, int]]:
    """Return (variable, order) of each register."""
    table = plan.reduced.registers
    return list(zip(table.variable[registers].tolist(), table.order[registers].tolist(), strict=True))


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
