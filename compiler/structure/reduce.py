"""Reduce: a flat model comes in, the smallest system that describes its motion goes out.

Linear elimination (`normalize`), the Σ-method (`sigma`), choice of states (`coordinates`), blocks and tearing
(`blocks`, `small_blocks`, `large_blocks`), programs (`assemble`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.diagnostics import Report
from lmoc.distinct import distinct
from lmoc.semantics.flat import FlatDAE
from lmoc.structure import coordinates, diagnosis, preferences
from lmoc.structure.assemble import assemble
from lmoc.structure.block_equations import SquareSystem
from lmoc.structure.coordinates import Choice
from lmoc.structure.layout import Layout
from lmoc.structure.normalize import normalize
from lmoc.structure.normalized import Normalized
from lmoc.structure.reduced import Reduced
from lmoc.structure.sigma import highest_value_transversal
from lmoc.structure.solution import Solution
from lmoc.structure.system import Sample, System


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
    normalized = normalize(flat, values, states, report)
    return solve_structure(normalized, states, report)


def solve_structure(normalized: Normalized, states: Sequence[str] | None, report: Report) -> Reduced:
    """The second half of reduction: from root jets to programs. Raises as `reduce`."""
    system = System(normalized)
    match = highest_value_transversal(system.incidence)
    if match is None:
        diagnosis.structurally_singular(system, report)
        report.check()
    wanted = preferences.asked_for(system, states)
    c, d = preferences.offsets_with_room(system, match, wanted)
    sample = Sample(system, int(d.max(initial=0)))
    tied = coordinates.tied_entries(system, c, d, sample)
    rank = preferences.preference(system, tied, c, wanted)
    choice = coordinates.choose(tied, c, d, rank, wanted)
    if len(choice.singular):
        jacobian = coordinates.tied_entries(system, c, d, sample, least=0)
        diagnosis.dependent_constraints(system, jacobian, choice.singular, report)
        report.check()
    batches, sums = system.differentiated(c)
    layout = Layout(system, d, system.highest_inputs(batches))
    square = SquareSystem(batches, sums, layout.base, layout.count)
    square.finish(_matching(system, square, layout, match, c, d, choice))
    is_state = _state_mask(system, layout, d, choice)
    quadrature = _quadratures(system, layout, square, c, is_state, wanted)
    state_registers = np.flatnonzero(is_state & ~quadrature)
    diagnosis.refused_states(system, states or (), layout, is_state, c, report)
    solution = Solution(
        square,
        square.needed_for(state_registers + 1),
        _derivatives(layout, is_state),
        layout.known_values(sample.value[0]),
    )
    programs = solution.run()
    if solution.singular:
        jacobian = coordinates.tied_entries(system, c, d, sample, least=0)
        diagnosis.singular_blocks(system, square, layout, jacobian, solution.singular, report)
    report.check()
    notes = diagnosis.notes(system, choice, tied, layout, is_state)
    return assemble(
        system, layout, programs, state_registers, np.flatnonzero(quadrature), solution.helpers, notes
    )


def _matching(
    system: System,
    square: SquareSystem,
    layout: Layout,
    match: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
    choice: Choice,
) -> np.ndarray:
    """The register that each differentiated equation stands for: a perfect matching, stage by stage."""
    numbers = square.equation_numbers(system.rows)
    result = np.full(square.count, -1, np.int64)
    stages = [(np.arange(system.rows), match), *choice.match]
    for stage, (rows, columns) in enumerate(stages):
        times = c[rows] - stage
        for k in distinct(times).tolist():
            mine = times == k
            at = columns[mine]
            result[numbers[k][rows[mine]]] = layout.base[system.variable[at]] + d[at] - stage
    return result


def _state_mask(system: System, layout: Layout, d: np.ndarray, choice: Choice) -> np.ndarray:
    """(registers,) the jets below the highest that no equation computes."""
    base = layout.base[system.variable]
    variable, order = layout.jets()
    mask = (order < layout.width[variable] - 1) & (system.column[variable] >= 0)
    for stage, columns in enumerate(choice.dependent, 1):
        mask[base[columns] + d[columns] - stage] = False
    return mask


def _derivatives(layout: Layout, is_state: np.ndarray) -> np.ndarray:
    """(registers,) the computed jets that are derivatives of states."""
    mask = np.zeros(layout.count, bool)
    mask[np.flatnonzero(is_state) + 1] = True
    return mask & ~is_state


def _quadratures(
    system: System, layout: Layout, square: SquareSystem, c: np.ndarray, is_state: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(registers,) states that no equation reads and nobody has declared to be interested in."""
    registers = np.flatnonzero(is_state)
    read = np.zeros(layout.count, bool)
    read[square.states_read(square.needed_for(registers + 1))] = True
    read[(registers + 1)[is_state[registers + 1]]] = True
    kept = preferences.inertial(system, c) | preferences.declared(system)
    kept[wanted] = True
    of_kept = np.zeros(len(system.kind), bool)
    of_kept[system.variable[kept]] = True
    return is_state & ~read & ~of_kept[layout.jets()[0]]
