"""The start of a scene: the point that satisfies its constraints nearest to its start values.

Constraints that share unknowns are looked at together, and all ways in which they can be satisfied are looked for
(`assemblies`); very many by Newton's method alone, whose steps are the smallest ones, in a weighted norm, that satisfy
the linearized constraints (Ben-Israel, J. Math. Anal. Appl. 15, 1966). Values that the user has given hardly move.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from operator import itemgetter

import numpy as np

from lmoc.ir.flat import Kind, StateSelect
from lmoc.structure.coordinates.assemblies import Assemblies, Loops, Wishes
from lmoc.structure.coordinates.constraint_rows import ConstraintRows
from lmoc.structure.coordinates.copies import copies
from lmoc.structure.coordinates.group_by_group import group_by_group, one_by_one
from lmoc.structure.coordinates.initial_rows import initial_rows
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.elimination import LENGTHS_AND_ANGLES
from lmoc.structure.loops.nearest import nearest
from lmoc.structure.loops.sample import FIXED, GUESSED, Sample, given
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass
from lmoc.support.sizes import DENSE

# steps until it is given up; relative size of the last one
STEPS, CLOSED = 40, 1e-9


@dataclass(frozen=True, eq=False)
class StartPoint:
    """Where a scene starts.

    Attributes
    ----------
    sample : Sample
    closed : whether the constraints hold there
    jets : positions in the flattened sample of what they contain
    nearest : those of them that are nearest to what is wished for, among all places that have been found; very many
        that hang together are near by the steps that have led there, each of which moves what is given a little
    loose : whether some of that may move though what is fixed and given stays
    ways : as in `StartGuess`
    moved : fixed flat variables without which no way was found to close their loops, with values that do
    missed : (ranks,) the squares of what start values of positions are missed by, those that count first first
    """

    sample: Sample
    closed: bool
    jets: np.ndarray
    nearest: np.ndarray
    loose: bool = False
    ways: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    moved: tuple[tuple[int, float], ...] = ()
    missed: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Closed:
    """What constraints lead to, whatever else stands in the sample.

    Attributes
    ----------
    values : (n,) of their jets
    settled : (n,) which of them are nearest, as of `StartPoint`
    loose, closed, ways, moved : as there
    """

    values: np.ndarray
    settled: np.ndarray
    loose: bool
    closed: bool
    ways: tuple[tuple[np.ndarray, np.ndarray], ...]
    moved: tuple[tuple[int, float], ...]


Known = dict[tuple[bytes, ...], Closed | None]  # by all numbers that the search has read
_KNOWN = 8  # searches that are kept


def start_point(
    system: EquationSystem,
    c: np.ndarray,
    highest: int,
    fixed: tuple[np.ndarray, np.ndarray] | None = None,
    at_rest: np.ndarray | None = None,
    known: Known | None = None,
) -> StartPoint:
    """Return a point that satisfies all equations with c > 0 at the start time, nearest to the start values.

    Initial equations hold there, too, unless there is no such point. Where none is found at all, those values
    themselves: no more is known then.

    Parameters
    ----------
    c, highest : how often each equation is differentiated, and the highest derivative of a variable
    fixed : flat variables, and values that are given to them for one run
    at_rest : roots that shall be zero if nothing is said about them
    known : searches of the same equations, kept up to date: masses and stiffnesses do not close a loop otherwise
    """
    known = {} if known is None else known
    sample, ease = given(system, highest, fixed)
    if at_rest is not None:
        unsaid = at_rest[ease[0, at_rest] == 1.0]
        sample.value[0, unsaid], ease[0, unsaid] = 0.0, FIXED
    wishes = _Wanted.of(system, sample, fixed)
    initial = initial_rows(system, highest)
    found = _nearest(system, ConstraintRows.of(system, c, sample, initial), ease, wishes, known)
    if found is None and initial:
        found = _nearest(system, ConstraintRows.of(system, c, sample), ease, wishes, known)
        if found is not None:  # the initial equations may exclude some of the ways, and lead elsewhere
            found = replace(found, ways=(), nearest=np.zeros(0, np.int64))
    if found is None:
        return StartPoint(sample, False, np.zeros(0, np.int64), np.zeros(0, np.int64))
    return replace(found, missed=wishes.missed(found.sample.value))


def _nearest(
    system: EquationSystem, rows: ConstraintRows, ease: np.ndarray, wanted: _Wanted, known: Known
) -> StartPoint | None:
    """The point nearest to a sample that satisfies constraints; None where none is found."""
    key = _read(system, rows, ease, wanted)
    found = known.pop(key) if key in known else _search(system, rows, ease, wanted)
    for oldest in list(known)[: 1 - _KNOWN]:
        known.pop(oldest, None)  # another thread may have been faster
    known[key] = found
    if found is None:
        return None
    value = rows.sample.value.copy()
    value.flat[rows.jets] = found.values
    sample, settled = replace(rows.sample, value=value), rows.jets[found.settled]
    return StartPoint(sample, found.closed, rows.jets, settled, found.loose, found.ways, found.moved)


def _read(system: EquationSystem, rows: ConstraintRows, ease: np.ndarray, wanted: _Wanted) -> tuple[bytes, ...]:
    """Return all numbers that a search reads; initial equations may read anything."""
    numbers = [rows.jets, rows.source, rows.begin, ease, *(number for _, number in rows.contents())]
    numbers += [wanted.variable, wanted.jet, wanted.factor, wanted.offset, wanted.target, wanted.level, wanted.rank]
    numbers += [] if system.normalized.near is None else list(system.normalized.near)
    numbers += [rows.sample.value] if rows.initial else []
    return tuple(np.asarray(n).tobytes() for n in numbers)


def _search(system: EquationSystem, rows: ConstraintRows, ease: np.ndarray, wanted: _Wanted) -> Closed | None:
    """Look for the point nearest to a sample that satisfies constraints; None where none is found."""
    weight = ease.ravel()[rows.jets]
    values, loose, kept = rows.begin.copy(), False, True
    told: list[tuple[int, list[tuple[np.ndarray, np.ndarray]]]] = []
    moved: list[tuple[int, list[tuple[int, float]]]] = []
    settled = np.zeros(len(values), bool)
    held = weight <= FIXED
    geometric = _geometric(system, rows.source)
    said = (weight < 1.0) | np.isin(rows.jets, _near(system, ease.shape))
    for same in copies(rows, held, weight, said, wanted.among(rows.jets), geometric.astype(np.int64)):
        inside, part = same.inside[0], rows.take(same.rows)
        assemblies = _put_together(part, weight[inside], wanted) if geometric[same.rows].all() else None
        found = assemblies.points[0] if assemblies is not None else None
        if found is None and not (part.count <= DENSE and geometric[same.rows].all()):
            found = _alone(part, values[inside], weight[inside])
        if found is None:
            return None
        if assemblies is not None:
            settled[same.inside[:, ~held[inside]]] = True
            loose |= assemblies.loose
            told += [(k, wanted.told_apart(rows.jets[at], assemblies)) for k, at in same.each()]
            away = np.abs(found - part.begin) > 1e-9 * (1.0 + np.abs(part.begin))
            if (away & held[inside]).any():
                kept = False
                moved += [(k, wanted.only(rows.jets[at], held[inside], found)) for k, at in same.each()]
        values[same.inside[:, ~held[inside]]] = found[~held[inside]]
    ways = tuple(one for _, some in sorted(told, key=itemgetter(0)) for one in some)
    given_up = tuple(one for _, some in sorted(moved, key=itemgetter(0)) for one in some)
    return Closed(values, settled, loose, kept, ways if kept else (), given_up)


def _near(system: EquationSystem, shape: tuple[int, ...]) -> np.ndarray:
    """Positions in the flattened sample of jets whose values are known from elsewhere."""
    if system.normalized.near is None:
        return np.zeros(0, np.int64)
    root, order, _ = system.normalized.near
    places: np.ndarray = order.astype(np.int64) * shape[1] + root
    return places[order < shape[0]]


def _put_together(part: ConstraintRows, weight: np.ndarray, wanted: _Wanted) -> Assemblies | None:
    """The ways in which loops close; of many constraints only where they fall into small loops."""
    if part.count <= DENSE:
        return _assemblies(part, weight, wanted)
    return one_by_one(part, _loops(wanted, part, part.begin, weight <= GUESSED), partial(_loops, wanted))


def _assemblies(part: ConstraintRows, weight: np.ndarray, wanted: _Wanted) -> Assemblies | None:
    """The points that satisfy some constraints, the nearest first.

    What is given is kept if it can be, else what of it counts most, then what is fixed; where nothing else helps, that
    gives way, too.
    """
    for ease in (*distinct(weight[weight <= GUESSED])[::-1].tolist(), 0.0):
        held = weight <= ease
        loops = replace(_loops(wanted, part, part.begin, held), guessed=bool((weight[held] > FIXED).any()))
        parts_of = partial(_loops, wanted)
        found = group_by_group(part, loops, parts_of) or loops.found() or one_by_one(part, loops, parts_of)
        if found is not None:
            return found
    return None


def _loops(wanted: _Wanted, part: ConstraintRows, begin: np.ndarray, held: np.ndarray) -> Loops:
    return Loops(part.dense, part.residual, begin, held, wanted.among(part.jets))


def _geometric(system: EquationSystem, source: np.ndarray) -> np.ndarray:
    """Return of which equations (rows,) lengths and angles are the only unknowns, so that they close loops."""
    flat = system.flat
    other = flat.per_variable(lambda b: (b.flow and b.connector) or (b.unit and b.unit not in LENGTHS_AND_ANGLES), bool)
    other &= flat.kind == Kind.UNKNOWN
    sums = np.zeros(flat.sums.rows, bool)
    sums[np.repeat(np.arange(flat.sums.rows), np.diff(flat.sums.start))[other[flat.sums.index]]] = True
    equations = np.concatenate([*(other[g.slots].any(axis=1) for g in flat.groups), sums, [False]])
    result: np.ndarray = ~equations[source]  # -1, initial equations: the last one
    return result


def _alone(part: ConstraintRows, values: np.ndarray, weight: np.ndarray) -> np.ndarray | None:
    """The point that satisfies some constraints, from one first guess or, while they are few, from several."""
    if part.count <= DENSE:
        return nearest(values, weight, part.dense, part.placed)
    return _closed(part, values, weight)


def _closed(rows: ConstraintRows, values: np.ndarray, weight: np.ndarray) -> np.ndarray | None:
    """The values that Newton's method reaches, None where it diverges."""
    for _ in range(STEPS):
        step = rows.step(values, weight)
        if not np.isfinite(step).all():
            return None
        values = values + step
        if np.abs(step).max(initial=0) <= CLOSED * np.abs(values).max(initial=0):
            return values
    return None


@dataclass(frozen=True, eq=False)
class _Wanted:
    """What positions shall be near to: start values; zero for the others.

    Attributes
    ----------
    variable : (w,) flat variables
    jet : (w,) positions in the flattened sample, in order; the variables are ``factor·jet + offset``
    """

    variable: np.ndarray
    jet: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    target: np.ndarray
    level: np.ndarray
    rank: np.ndarray

    @staticmethod
    def of(system: EquationSystem, sample: Sample, fixed: tuple[np.ndarray, np.ndarray] | None) -> _Wanted:
        flat, n = system.flat, system.normalized
        own = np.flatnonzero((flat.kind == Kind.UNKNOWN) & (n.order == 0) & (system.column[n.root] >= 0))
        value = sample.value[0]
        start, rank = np.full(flat.count, np.nan), flat.start_rank.copy()
        for a in flat.starts:
            start[a.target] = a.values(value)
        if fixed is not None:
            start[fixed[0]], rank[fixed[0]] = fixed[1], 0
        factor = np.where(n.factor[own] >= 0, value[n.factor[own]], np.where(n.factor[own] == -2, -1.0, 1.0))
        offset = np.where(n.offset[own] >= 0, value[n.offset[own]], 0.0)
        has = np.isfinite(start[own])
        marked = flat.per_variable(lambda b: b.state_select > StateSelect.default, bool)[own]
        level = np.where(has, 0, np.where(marked, 1, 2))
        target = np.where(has, start[own], 0.0)
        if n.near is not None:  # constraints that follow from these hold there, too
            root, jet_order, numbers = n.near
            there = np.full(len(system.kind), np.nan)
            there[root[jet_order == 0]] = numbers[jet_order == 0]
            there = there[n.root[own]]
            known = np.isfinite(there)
            target, level = np.where(known, factor * there + offset, target), np.where(known, -1, level)
        order = np.argsort(n.root[own], kind="stable")
        order = order[np.isfinite(factor[order]) & (factor[order] != 0) & np.isfinite(offset[order])]
        columns = (factor, offset, target, level, rank[own])
        return _Wanted(own[order], n.root[own][order], *(column[order] for column in columns))

    def among(self, jets: np.ndarray) -> Wishes:
        """Return what is wanted of some jets."""
        own, at = self._places(jets)
        return Wishes(at, self.factor[own], self.offset[own], self.target[own], self.level[own], self.rank[own])

    def missed(self, value: np.ndarray) -> tuple[float, ...]:
        """Return the squares of what start values are missed by, added up by their ranks, at a sample."""
        own, away = self.level == 0, self.factor * value.flat[self.jet] + self.offset - self.target
        return tuple(float((away[own & (self.rank == k)] ** 2).sum()) for k in distinct(self.rank[own]).tolist())

    def told_apart(self, jets: np.ndarray, found: Assemblies) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the variables that tell assemblies apart, best those with a guess or a mark, and their values."""
        if len(found.points) < 2 or not found.isolated:
            return []
        own, at = self._places(jets)
        if (self.level[own] < 0).any():
            return []  # elsewhere some of the constraints that follow from these need not hold
        values = self.factor[own] * found.points[:, at] + self.offset[own]
        differ = np.ptp(values, axis=0) > 1e-6 * (1.0 + np.abs(values).max(axis=0))
        for level in (1, 2):
            chosen = differ & (self.level[own] <= level)
            if chosen.any():
                order = np.argsort(self.variable[own[chosen]])
                return [(self.variable[own[chosen]][order], values[:, chosen][:, order])]
        return []

    def only(self, jets: np.ndarray, fixed: np.ndarray, found: np.ndarray) -> list[tuple[int, float]]:
        """Return the only fixed variable of a loop with the value that has been found for it."""
        own, at = self._places(jets)
        if np.count_nonzero(fixed) != 1:
            return []
        given = np.flatnonzero(fixed[at] & (self.level[own] == 0))[:1]
        value = self.factor[own] * found[at] + self.offset[own]
        return [(int(self.variable[own[k]]), float(value[k])) for k in given.tolist()]

    def _places(self, jets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of what is wanted of some jets, and the positions of those."""
        first, end = (np.searchsorted(self.jet, jets, side) for side in ("left", "right"))
        at = np.repeat(np.arange(len(jets)), end - first)  # work in proportion to these jets, of which there are groups
        own = np.arange(len(at)) + np.repeat(first - np.cumsum(end - first) + (end - first), end - first)
        return own, at
