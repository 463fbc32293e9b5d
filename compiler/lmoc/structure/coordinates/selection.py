"""From a matching to states: offsets, coordinates, the square system that computes the rest, and quadratures."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from lmoc.structure.blocks.block_equations import SquareSystem
from lmoc.structure.coordinates import preferences
from lmoc.structure.coordinates.closure import Known, StartPoint, start_point
from lmoc.structure.coordinates.coordinates import Choice, choose, determined_at_start
from lmoc.structure.coordinates.tied import Tied, constraint_matrix, tied_entries
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.derived import derived_values
from lmoc.structure.loops.sample import Sample, generic
from lmoc.structure.registers.layout import RegisterLayout
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

_KEPT = 4  # starts: those of a parameter to both sides, as differences ask for them
Starts = dict[tuple[bytes, int], StartPoint]  # by how often equations are differentiated, and the orders of derivatives


@dataclass(frozen=True, eq=False)
class Candidate:
    """Coordinates that have been chosen; where ``choice.singular`` is not empty, there are none.

    Attributes
    ----------
    c, d : offsets of the Σ-method
    start : where the scene starts; None where that makes no difference
    tied, choice : the constraint matrix and what was chosen
    match : a highest-value transversal
    wanted : columns the user requested, best first
    kept : the starts that have been looked for last
    known : the searches for them, as of `start_point`
    """

    system: EquationSystem
    c: np.ndarray
    d: np.ndarray
    sample: Sample
    start: StartPoint | None
    tied: Tied
    choice: Choice
    match: np.ndarray
    wanted: np.ndarray
    kept: dict[tuple[bytes, ...], StartPoint]
    known: Known

    def startable(self, values: np.ndarray) -> bool:
        """Return whether the computed coordinates follow from the states at the start.

        Parameters
        ----------
        values : (flat.count,) parameter values
        """
        system, start = self.with_values(values), self.start_at(values)
        sample = generic(system, len(self.sample.value) - 1)
        tied, _ = constraint_matrix(system, self.c, self.d, sample, start)
        return determined_at_start(tied, self.c, self.d, self.choice)

    def start_at(
        self,
        values: np.ndarray | None,
        fixed: tuple[np.ndarray, np.ndarray] | None = None,
        at_rest: np.ndarray | None = None,
    ) -> StartPoint:
        """Return the point where the scene starts; the last ones are kept.

        Parameters
        ----------
        values : (flat.count,) parameter values; by default those that the reduction is made for
        fixed : flat variables, and the values that are given to them for one run
        at_rest : roots that shall be zero if nothing is said about them
        """
        if fixed is not None and not len(fixed[0]):
            fixed = None
        given = (values, *(fixed or ()), at_rest)
        key = tuple(b"" if a is None else a.tobytes() for a in given)
        found = self.kept.get(key)
        if found is None:
            system = self.system if values is None else self.with_values(values)
            found = start_point(system, self.c, len(self.sample.value) - 1, fixed, at_rest, self.known)
            for oldest in list(self.kept)[: 1 - _KEPT]:
                self.kept.pop(oldest, None)  # another thread may have been faster
            self.kept[key] = found
        return found

    def with_values(self, values: np.ndarray) -> EquationSystem:
        """Return the equations with other parameter values."""
        system, normalized = copy(self.system), self.system.normalized
        derived = derived_values(normalized.derived, values)
        system.normalized = replace(normalized, values=values, derived_values=derived)
        return system

    def jacobian(self) -> Tied:
        """Derivatives of all equations by their highest jets at the sample point."""
        return tied_entries(self.system, self.c, self.d, self.sample, least=0)


@dataclass(frozen=True, eq=False)
class Selection(Candidate):
    """Coordinates with the equations that compute everything else.

    Attributes
    ----------
    is_state : (registers,) jets that are integrated
    quadrature : (registers,) those of them that no equation reads
    """

    layout: RegisterLayout
    square: SquareSystem
    is_state: np.ndarray
    quadrature: np.ndarray

    @property
    def count(self) -> int:
        """Number of states without quadratures."""
        return int(np.count_nonzero(self.is_state & ~self.quadrature))

    def derivatives(self) -> np.ndarray:
        """(registers,) the computed jets that are derivatives of states."""
        mask = np.zeros(self.layout.count, bool)
        mask[np.flatnonzero(self.is_state) + 1] = True
        found: np.ndarray = mask & ~self.is_state
        return found


def select(
    system: EquationSystem, match: np.ndarray, wanted: np.ndarray, starts: Starts | None = None
) -> Selection | Candidate:
    """Choose the states; a mere candidate is singular.

    Between massless points on dampers the distance may be all that matters: it is tried in their place, and taken
    where that leaves fewer states.

    Parameters
    ----------
    match : a highest-value transversal
    wanted : columns the user requested, best first
    starts : where the scene starts, as far as that has been found already
    """
    starts = {} if starts is None else starts
    first = _select(system, match, wanted, np.zeros(0, np.int64), starts)
    if not isinstance(first, Selection):
        return first
    distances = preferences.distances(system, first.c, first.d)
    if not len(distances):
        return first
    second = _select(system, match, wanted, distances, starts)
    return second if isinstance(second, Selection) and second.count < first.count else first


def _select(
    system: EquationSystem, match: np.ndarray, wanted: np.ndarray, liked: np.ndarray, starts: Starts
) -> Selection | Candidate:
    c, d = preferences.offsets_with_room(system, match, wanted, liked)
    sample = generic(system, int(d.max(initial=0)))
    key = c.tobytes(), len(sample.value)
    tied, start = constraint_matrix(system, c, d, sample, starts.get(key))
    if start is not None:
        starts[key] = start
    rank = preferences.preference(system, tied, c, wanted, liked)
    choice = choose(tied, c, d, rank, preferences.wishes(system, c, wanted))
    kept: dict[tuple[bytes, ...], StartPoint] = {}
    if start is not None:
        kept[system.normalized.values.tobytes(), b""] = start
    candidate = Candidate(system, c, d, sample, start, tied, choice, match, wanted, kept, {})
    if len(choice.singular):
        return candidate
    batches, sums = system.differentiated(c)
    layout = RegisterLayout(system, d, system.highest_inputs(batches))
    square = SquareSystem(batches, sums, layout.base, layout.count)
    return finished(candidate, layout, square)


def finished(candidate: Candidate, layout: RegisterLayout, square: SquareSystem) -> Selection:
    """Return the selection: the equations are matched with what they compute, and what is left are states."""
    one, choice = candidate, candidate.choice
    square.finish(_matching(one.system, square, layout, one.match, one.c, one.d, choice))
    is_state = _state_mask(one.system, layout, one.d, choice)
    quadrature = _quadratures(one.system, layout, square, one.c, is_state, one.wanted)
    own = one.system, one.c, one.d, one.sample, one.start, one.tied, choice, one.match, one.wanted, one.kept, one.known
    return Selection(*own, layout, square, is_state, quadrature)


def _matching(
    system: EquationSystem,
    square: SquareSystem,
    layout: RegisterLayout,
    match: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
    choice: Choice,
) -> np.ndarray:
    """The register that each differentiated equation stands for: a perfect matching, stage by stage."""
    numbers = square.equation_numbers(system.rows)
    result = np.full(square.count, -1, INDEX)
    stages = [(np.arange(system.rows), match), *choice.match]
    for stage, (rows, columns) in enumerate(stages):
        times = c[rows] - stage
        for k in distinct(times).tolist():
            mine = times == k
            at = columns[mine]
            result[numbers[k][rows[mine]]] = layout.base[system.variable[at]] + d[at] - stage
    return result


def _state_mask(system: EquationSystem, layout: RegisterLayout, d: np.ndarray, choice: Choice) -> np.ndarray:
    """(registers,) the jets below the highest that no equation computes."""
    base = layout.base[system.variable]
    variable, order = layout.jets
    mask: np.ndarray = (order < layout.width[variable] - 1) & (system.column[variable] >= 0)
    for stage, columns in enumerate(choice.dependent, 1):
        mask[base[columns] + d[columns] - stage] = False
    return mask


def _quadratures(
    system: EquationSystem,
    layout: RegisterLayout,
    square: SquareSystem,
    c: np.ndarray,
    is_state: np.ndarray,
    wanted: np.ndarray,
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
    result: np.ndarray = is_state & ~read & ~of_kept[layout.jets[0]]
    return result
