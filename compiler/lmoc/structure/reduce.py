"""Reduce: a flat model comes in, the smallest system that describes its motion goes out.

Linear elimination (`normalize`), the Σ-method (`sigma`), choice of states (`selection`), blocks and tearing
(`blocks`, `small_blocks`, `large_blocks`), programs (`assemble`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lmoc.ir.checked import checked
from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import Normalized
from lmoc.ir.program import Program, Solve, split_program, walk
from lmoc.ir.reduced import Guard, Reduced
from lmoc.messages.diagnostics import Report
from lmoc.structure.blocks.solution import Solution
from lmoc.structure.coordinates import preferences
from lmoc.structure.coordinates.constraints import changing_constraints
from lmoc.structure.coordinates.mobility import immobile
from lmoc.structure.coordinates.sample import UNMARKED
from lmoc.structure.coordinates.selection import Selection, select
from lmoc.structure.discrete.order import discrete_steps
from lmoc.structure.index.sigma import highest_value_transversal
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.derived import derived_values
from lmoc.structure.loops.manifold import without_dependent
from lmoc.structure.messages import diagnosis
from lmoc.structure.normalize import normalize
from lmoc.structure.registers.assemble import Solved, assemble
from lmoc.structure.registers.layout import RegisterLayout


def reduce(
    flat: FlatDAE,
    values: np.ndarray | None = None,
    states: Sequence[str] | None = None,
    report: Report | None = None,
) -> Reduced:
    """Reduce a flat model.

    Parameters
    ----------
    flat : FlatDAE
    values : (flat.count,) parameter values for which elimination decides; the model's own by default
    states : names of variables that shall be states, best first
    report : collects what there is to say; a new one by default

    Raises
    ------
    ModelError
        The model is structurally or numerically singular, its constraints contradict each other, or what was asked
        for cannot be a state: codes E04xx.
    """
    report = Report() if report is None else report
    values = flat.parameter_values() if values is None else values
    if flat.laws and flat.closed is None:
        raise ValueError("a flat model with laws is reduced by structure.laws.reduce, or in one of its modes")
    discrete = discrete_steps(flat, report)
    normalized = checked(without_dependent(checked(normalize(flat, values, states, report))))
    return checked(replace(assemble(solve_structure(normalized, states, report)), discrete=discrete))


def solve_structure(normalized: Normalized, states: Sequence[str] | None, report: Report) -> Solved:
    """Choose the states and solve the equations for everything else. Raises as `reduce`."""
    system = EquationSystem(normalized)
    match = highest_value_transversal(system.incidence)
    if match is None:
        diagnosis.structurally_singular(system, report)
        report.check()
    wanted = preferences.asked_for(system, states)
    selection = select(system, match, wanted)
    if len(selection.choice.singular):
        diagnosis.dependent_constraints(system, selection.jacobian(), selection.choice.singular, report)
        report.check()
    layout, square, is_state = selection.layout, selection.square, selection.is_state
    registers = np.flatnonzero(is_state & ~selection.quadrature)
    diagnosis.refused_states(system, states or (), layout, is_state, selection.c, report)
    values = layout.known_values(selection.sample.value[0])
    solution = Solution(square, square.needed_for(registers + 1), selection.derivatives(), values)
    block_program, others = solution.run()
    if solution.singular:
        diagnosis.singular_blocks(system, square, layout, selection.jacobian(), solution.singular, report)
    report.check()
    notes = diagnosis.notes(system, selection.choice, selection.tied)
    notes += diagnosis.immobile(system, *immobile(selection))
    quadratures = np.flatnonzero(selection.quadrature)
    # what is solved together with a derivative is not needed for it where the solution is a formula
    rhs, rest = split_program(block_program, registers + 1, layout.count + solution.helpers)
    guards = *normalized.guards, *_regularity(normalized, layout, solution), *_start(selection)
    return Solved(
        system=system,
        layout=layout,
        rhs=rhs,
        rest=(*rest, *others),
        states=registers,
        quadratures=quadratures,
        helpers=solution.helpers,
        guards=guards,
        notes=(*normalized.notes, *notes),
        nearby=_nearby(selection, registers),
        constraints=partial(changing_constraints, selection),
        block_guess=_block_guess(selection, (*rhs, *rest, *others)),
    )


def _regularity(normalized: Normalized, layout: RegisterLayout, solution: Solution) -> list[Guard]:
    """The assumptions that blocks rest on: regular linear equations, coefficients that can be divided by."""
    by_assumption: dict[str, list[Callable[[np.ndarray], np.ndarray]]] = {}
    for assumption, fails in solution.tests:
        by_assumption.setdefault(assumption, []).append(fails)
    return [Guard(partial(_holds, normalized, layout, tests), text) for text, tests in by_assumption.items()]


def _holds(
    normalized: Normalized, layout: RegisterLayout, tests: list[Callable[[np.ndarray], np.ndarray]], values: np.ndarray
) -> bool:
    known = np.concatenate([values, derived_values(normalized.derived, values)])
    registers = layout.known_values(known)
    return not any(fails(registers).any() for fails in tests)


def _nearby(selection: Selection, states: np.ndarray) -> np.ndarray | None:
    """Return the values of the states where the constraints hold, near the start values."""
    if selection.start is None:
        return None
    variable, order = selection.layout.jets
    return selection.start.value[order[states], variable[states]]


def _block_guess(selection: Selection, program: Program) -> tuple[np.ndarray, np.ndarray]:
    """Return the unknowns of nonlinear blocks that the constraints place near the start, and their values there."""
    unknowns = [s.unknowns.ravel() for s in walk(program) if isinstance(s, Solve) and not s.linear]
    if selection.start is None or not unknowns:
        return np.zeros(0, np.int64), np.zeros(0)
    registers = np.concatenate(unknowns)
    registers = registers[registers < selection.layout.count]
    variable, order = selection.layout.jets
    place = selection.start.value
    registers = registers[order[registers] < len(place)]
    jets = order[registers], variable[registers]
    moved = np.abs(place[jets]) > 2 * UNMARKED  # else nobody has said anything, and zero will do
    return registers[moved], place[jets][moved]


def _start(selection: Selection) -> list[Guard]:
    """The assumption that a motion with these coordinates can start where it is meant to."""
    changing = selection.start is not None and selection.system.flat.starts
    if not changing or not selection.startable(selection.system.normalized.values):
        return []
    return [Guard(selection.startable, "the other coordinates follow from the states at the start")]
