"""Where the numerical start of a scene with nonlinear constraints is looked for."""

from __future__ import annotations

import numpy as np

from lmoc.ir.normalized import Normalized
from lmoc.ir.program import Program, Solve, walk
from lmoc.ir.reduced import StartGuess
from lmoc.messages.diagnostics import Diagnostic, Subject
from lmoc.structure.coordinates.closure import StartPoint
from lmoc.structure.coordinates.selection import Selection
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.loops.reach import out_of_reach
from lmoc.structure.loops.sample import UNMARKED

_NEARER = 1e-6  # radians, lengths, squared: by less no start value is missed by more

Given = tuple[np.ndarray, np.ndarray]  # flat variables, and values that are fixed at the start


def block_unknowns(program: Program) -> np.ndarray:
    """Return the registers of the unknowns of nonlinear blocks."""
    unknowns = [s.unknowns.ravel() for s in walk(program) if isinstance(s, Solve) and not s.linear]
    return np.concatenate([np.zeros(0, np.int64), *unknowns])


def guess_of(selection: Selection, start: StartPoint, states: np.ndarray, unknowns: np.ndarray) -> StartGuess:
    """Return the guess with the values that the reduction was made for, and the model's start values.

    Parameters
    ----------
    start : the point at which the coordinates have been chosen
    states, unknowns : registers of the states, and of unknowns of nonlinear blocks
    """
    return _guess(selection, selection.system, _settled(selection, start, states, None, None), states, unknowns)


def guess_at(
    selection: Selection, states: np.ndarray, unknowns: np.ndarray, values: np.ndarray, fixed: Given
) -> StartGuess:
    """Return the guess with other parameter values (flat.count,) and values that are fixed for one run."""
    start = selection.start_at(values, fixed)
    system = selection.with_values(values)
    return _guess(selection, system, _settled(selection, start, states, values, fixed), states, unknowns)


def _settled(
    selection: Selection, start: StartPoint, states: np.ndarray, values: np.ndarray | None, fixed: Given | None
) -> StartPoint:
    """Return the start with states at zero that nobody has said anything about, where these are free to be there."""
    if not (start.loose and start.closed):
        return start
    variable, order = selection.layout.jets
    at_rest = variable[states[order[states] == 0]]
    settled = selection.start_at(values, fixed, at_rest)
    # several states can be free one by one, and not all of them at once: then a start value would have to give way
    kept = settled.closed and all(a <= b + _NEARER for a, b in zip(settled.missed, start.missed, strict=True))
    return settled if kept else start


def _guess(
    selection: Selection, system: EquationSystem, start: StartPoint, states: np.ndarray, unknowns: np.ndarray
) -> StartGuess:
    variable, order = selection.layout.jets
    place = start.sample.value
    width = place.shape[1]
    at = order[states], variable[states]
    tied = start.closed & np.isin(at[0] * width + at[1], start.jets)
    # what no constraint contains begins at zero, unless the model says otherwise: that is for the run to look up
    guess = np.where(tied | (not start.closed), place[at], 0.0)
    registers = unknowns[unknowns < selection.layout.count]
    registers = registers[order[registers] < len(place)]
    jets = order[registers], variable[registers]
    tied = start.closed & np.isin(jets[0] * width + jets[1], start.jets)
    moved = tied | (np.abs(place[jets]) > 2 * UNMARKED)  # else nobody has said anything, and zero will do
    n = selection.system.normalized
    tied_variables = np.flatnonzero((n.order == 0) & np.isin(n.root, start.jets[start.jets < width]))
    nearest = _values_of(tied_variables, n, place)
    nearest[~np.isin(n.root[tied_variables], start.nearest)] = np.nan
    if n.near is not None:  # they stand where redundant constraints were found to hold, not nearest to their guesses
        nearest[np.isin(n.root[tied_variables], n.near[0])] = np.nan
    reason = None if start.closed else out_of_reach(system.normalized)
    failures = () if reason is None else (reason,)
    doubts = tuple(_not_closed(selection, variable, value) for variable, value in start.moved)
    return StartGuess(
        guess, registers[moved], place[jets][moved], start.closed, tied_variables, nearest, start.ways, failures, doubts
    )


def _values_of(variables: np.ndarray, n: Normalized, place: np.ndarray) -> np.ndarray:
    """The values of flat variables at a place (orders, extended) of their roots."""
    factor = np.where(n.factor[variables] >= 0, place[0, n.factor[variables]], 1.0)
    factor[n.factor[variables] == -2] = -1.0
    offset = np.where(n.offset[variables] >= 0, place[0, n.offset[variables]], 0.0)
    result: np.ndarray = factor * place[0, n.root[variables]] + offset
    return result


def _not_closed(selection: Selection, variable: int, value: float) -> Diagnostic:
    flat = selection.system.flat
    name, parameters = flat.variable_name(variable), selection.system.normalized.all_values
    given = [a for a in flat.starts if (a.target == variable).any()]
    wanted = float(given[-1].values(parameters)[np.flatnonzero(given[-1].target == variable)[0]]) if given else 0.0
    return Diagnostic(
        "E0532",
        f"no way was found to close the loop of {name.rsplit('.', 1)[0]} with {name} = {wanted:g}",
        given[-1].span if given else flat.declared_at(variable),
        found=f"it closes with {name} = {value:.6g}, for example",
        hint="start elsewhere, or change the lengths of the bars",
        subject=Subject.NO_START,
    )
