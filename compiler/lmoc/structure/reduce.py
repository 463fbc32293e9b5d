"""Reduce: a flat model comes in, the smallest system that describes its motion goes out.

Linear elimination (`normalize`), the Σ-method (`sigma`), choice of states (`selection`), blocks and tearing
(`blocks`, `small_blocks`, `large_blocks`), programs (`assemble`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from lmoc.expression.dag import ZERO
from lmoc.ir.checked import checked
from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import Normalized
from lmoc.ir.program import Apply, split_program
from lmoc.ir.reduced import Guard, Reduced
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.structure import diagnosis
from lmoc.structure.blocks.solution import Solution
from lmoc.structure.coordinates import preferences
from lmoc.structure.coordinates.closures import closures, released
from lmoc.structure.coordinates.constraints import changing_constraints
from lmoc.structure.coordinates.coordinates import determined_at_start
from lmoc.structure.coordinates.invariants import invariants
from lmoc.structure.coordinates.mobility import immobile
from lmoc.structure.coordinates.selection import Selection, Starts, select
from lmoc.structure.coordinates.shared import Shared
from lmoc.structure.coordinates.start_guess import block_unknowns, guess_at, guess_of
from lmoc.structure.discrete.order import discrete_steps, start_steps
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.derived import derived_values
from lmoc.structure.loops.manifold import without_dependent
from lmoc.structure.normalize import normalize
from lmoc.structure.registers.assemble import Solved, assemble
from lmoc.structure.registers.layout import RegisterLayout
from lmoc.support.records import dataclass


def reduce(
    flat: FlatDAE,
    values: np.ndarray | None = None,
    states: Sequence[str] | None = None,
    report: Report | None = None,
    loops: bool = False,
    shared: Shared | None = None,
) -> Reduced:
    """Reduce a flat model.

    Parameters
    ----------
    flat : FlatDAE
    values : (flat.count,) parameter values for which elimination decides; the model's own by default
    states : names of variables that shall be states, best first
    report : collects what there is to say; a new one by default
    loops : make all coordinates of closed loops states, and keep their closures as invariants
    shared : what earlier reductions of this model have found

    Raises
    ------
    ModelError
        The model is structurally or numerically singular, its constraints contradict each other, or what was asked
        for cannot be a state: codes E04xx.
    NotReleasedError
        Not all coordinates of its loops can be states.
    """
    report = Report() if report is None else report
    values = flat.parameter_values() if values is None else values
    if flat.laws and flat.closed is None:
        raise ValueError("a flat model with laws is reduced by structure.laws.reduce, or in one of its modes")
    discrete, started, shared = discrete_steps(flat, report), start_steps(flat, report), shared or Shared()
    normalized, starts = shared.completed(checked(normalize(flat, values, states, report)), without_dependent)
    solved = solve_structure(checked(normalized), states, report, loops, starts)
    return checked(replace(assemble(solved), discrete=discrete, started=started))


def solve_structure(
    normalized: Normalized,
    states: Sequence[str] | None,
    report: Report,
    loops: bool = False,
    starts: Starts | None = None,
) -> Solved:
    """Choose the states and solve the equations for everything else. Parameters and errors as of `reduce`."""
    system = EquationSystem(normalized)
    match = system.transversal()
    if match is None:
        diagnosis.structurally_singular(system, report)
        raise ModelError(report.diagnostics)
    wanted = preferences.asked_for(system, states)
    selection = select(system, match, wanted, starts)
    if not isinstance(selection, Selection):
        diagnosis.dependent_constraints(system, selection.jacobian(), selection.choice.singular, report)
        raise ModelError(report.diagnostics)
    diagnosis.refused_states(system, states or (), selection.layout, selection.is_state, selection.c, report)
    diagnosis.given_rates(system, selection.layout, selection.is_state, selection.c, report)
    minimal, found, rate = selection, closures(selection), np.zeros(0, np.int64)
    if loops and found is not None:
        selection, rate = released(selection, found)
    layout, square, is_state = selection.layout, selection.square, selection.is_state
    registers = np.flatnonzero(is_state & ~selection.quadrature)
    values = layout.known_values(selection.sample.value[0])
    favourite = np.pad(selection.derivatives(), (0, len(rate)))
    values = np.pad(values, (0, len(rate)), constant_values=np.nan)
    solution = Solution(square, square.needed_for(registers + 1), favourite, values)
    block_program, others = solution.run()
    if solution.singular:
        diagnosis.singular_blocks(system, square, layout, selection.jacobian(), solution.singular, report)
    report.check()
    whole = minimal is selection
    notes = diagnosis.notes(system, minimal.choice, minimal.tied) if whole else ()
    notes += diagnosis.immobile(system, *immobile(minimal))
    notes += diagnosis.differentiated_jumps(system, minimal.c)
    quadratures = np.flatnonzero(selection.quadrature)
    # what is solved together with a derivative is not needed for it where the solution is a formula
    helpers = solution.helpers + len(rate)
    rhs, rest = split_program(block_program, registers + 1, layout.count + helpers)
    at_rest = (Apply(ZERO, np.zeros((len(rate), 0), np.int64), rate),) if len(rate) else ()
    guards = *normalized.guards, *_regularity(normalized, layout, solution), *(_start(minimal) if whole else ())
    unknowns = block_unknowns((*rhs, *rest, *others))
    guess = None if selection.start is None else guess_of(selection, selection.start, registers, unknowns)
    return Solved(
        system=system,
        layout=layout,
        rhs=(*at_rest, *rhs),
        rest=(*rest, *others),
        states=registers,
        quadratures=quadratures,
        helpers=helpers,
        guards=guards,
        notes=(*normalized.notes, *notes),
        guess=guess,
        guess_at=None if guess is None else partial(guess_at, selection, registers, unknowns),
        constraints=partial(changing_constraints, selection) if whole else None,
        invariants=None if found is None else partial(invariants, minimal, found, registers, rate),
    )


def _regularity(normalized: Normalized, layout: RegisterLayout, solution: Solution) -> list[Guard]:
    """The assumptions that blocks rest on: regular linear equations, coefficients that can be divided by."""
    by_assumption: dict[str, list[Callable[[np.ndarray], np.ndarray]]] = {}
    for assumption, fails in solution.tests:
        by_assumption.setdefault(assumption, []).append(fails)
    return [Guard(_Regular(normalized, layout, tests), text) for text, tests in by_assumption.items()]


@dataclass(frozen=True, eq=False)
class _Regular:
    """Whether no test of blocks fails."""

    normalized: Normalized
    layout: RegisterLayout
    tests: list[Callable[[np.ndarray], np.ndarray]]

    def __call__(self, values: np.ndarray) -> bool:
        return bool(self.of_runs(values))

    def of_runs(self, values: np.ndarray) -> np.ndarray:
        """Return the same (runs,) for values (variables, runs)."""
        known = np.concatenate([values, derived_values(self.normalized.derived, values)])
        registers = self.layout.known_values(known)
        failed = [fails(registers).any(axis=0) for fails in self.tests]
        regular: np.ndarray = ~np.any(failed, axis=0)
        return regular


def _start(selection: Selection) -> list[Guard]:
    """The assumption that a motion with these coordinates can start where it is meant to."""
    changing = selection.start is not None and selection.system.flat.starts
    if not changing or not determined_at_start(selection.tied, selection.c, selection.d, selection.choice):
        return []
    text = "the other coordinates follow from the states at the start"
    return [Guard(_Startable(selection).holds, text, open=True)]


class _Startable:
    """Whether the other coordinates follow from the states where a run starts.

    Where what is divided by never changes along a motion, as in a tree of joints, they follow from them at all places,
    and nobody has to look for the start: the other guards say for which parameters.
    """

    def __init__(self, selection: Selection) -> None:
        self.selection = selection

    @cached_property
    def follow_everywhere(self) -> bool:
        return changing_constraints(self.selection, 0) is None

    def holds(self, values: np.ndarray) -> bool:
        return self.follow_everywhere or self.selection.startable(values)
