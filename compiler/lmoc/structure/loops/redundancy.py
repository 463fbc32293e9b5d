"""Constraints that repeat others, and the reactions that are then not unique.

A loop of ideal transmissions gives one constraint too many among the coordinates, linear or not; in exchange one
combination of the reactions in the loop appears nowhere (the matrix of the reactions is the transpose of that of the
constraints). A repeated constraint is dropped; one reaction of its loop is set to zero, which leaves the sums that act
on the bodies as they are, and all reactions that could have been otherwise are reported as undetermined. Cf. Wojtyra,
"Joint reactions in rigid body mechanisms with dependent constraints", Mechanism and Machine Theory 44 (2009) 2265.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ZERO, Expr
from lmoc.structure.linear.coefficients import KNOWN, UNKNOWN, Kinds, leaves_of, value_and_size
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.structure.linear.substitution import Rows, with_numbers
from lmoc.structure.linear.sum_rows import SumRows
from lmoc.structure.linear.terms import entries, terms_of, value_at
from lmoc.structure.loops.dependence import Vector, as_vectors, dependencies, peel
from lmoc.support.distinct import numbered
from lmoc.support.records import dataclass

# weights and sums this small beside what they are made of are roundoff
CONSISTENT = 1e-10


@dataclass(frozen=True, eq=False)
class Constraints:
    """Rows without flows, among which some may depend on others.

    Attributes
    ----------
    groups : the rows
    source : their flat equations, the groups one after another
    """

    groups: tuple[Rows, ...]
    source: np.ndarray

    @property
    def depends_on_parameters(self) -> bool:
        return any(leaf for g in self.groups for leaf in leaves_of(g.shape, g.kinds, KNOWN))

    def judged(self, known: np.ndarray, derived: DerivedParameters) -> list[tuple[int, list[int], bool]]:
        """For each dependent row: its equation, the equations it repeats, and whether it agrees with them."""
        rest, size = _rests(self.groups, known, derived)
        rows = as_vectors(*entries(self.groups, known))
        found = []
        for i, combination in dependencies([rows.get(n, {}) for n in range(len(self.source))]).items():
            terms = [(j, w) for j, w in combination.items() if abs(w) > CONSISTENT]
            total = sum(w * rest[j] for j, w in terms)
            bound = sum(abs(w) * size[j] for j, w in terms)
            others = [int(self.source[j]) for j, _ in terms if j != i]
            found.append((int(self.source[i]), others, not abs(total) > CONSISTENT * bound))
        return found


def constraints(groups: list[Rows], flow_like: np.ndarray) -> Constraints | None:
    """The rows among coordinates that are not independent at sight, None where all are.

    A row with a jet that appears in no other is independent of all others, whatever function of it appears there.

    Parameters
    ----------
    flow_like : (flat.count+1,) roots that stand for flows of connectors; rows with one of them are not constraints
    """
    chosen = []
    for g in groups:
        flows = np.zeros(len(g.source), bool)
        for leaf in leaves_of(g.shape, g.kinds, UNKNOWN):
            flows |= flow_like[g.column(leaf)]
        if not flows.all():
            chosen.append(g if not flows.any() else g.take(np.flatnonzero(~flows)))
    row, column = _jets(chosen, len(flow_like))
    if not len(row):
        return None
    rows = sum(len(g.source) for g in chosen)
    core = np.zeros(rows, bool)
    core[row[peel(row, numbered(column)[1], rows, len(column))]] = True
    parts = np.split(core, np.cumsum([len(g.source) for g in chosen])[:-1])
    kept = tuple(g.take(np.flatnonzero(mine)) for g, mine in zip(chosen, parts, strict=True) if mine.any())
    return Constraints(kept, np.concatenate([g.source for g in kept])) if kept else None


def _jets(groups: list[Rows], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows, numbered through, and the unknown jets in them, as one number each."""
    row, column = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for g, numbers in with_numbers(groups):
        for leaf in leaves_of(g.shape, g.kinds, UNKNOWN):
            row.append(numbers)
            column.append(g.column(leaf) + leaf.value[1] * count)
    return np.concatenate(row), np.concatenate(column)


def _rests(groups: tuple[Rows, ...], known: np.ndarray, derived: DerivedParameters) -> tuple[np.ndarray, np.ndarray]:
    """Values of what is no term, and the sizes of what they are made of."""
    pairs = []
    for g in groups:
        rest = terms_of(g.shape, g.kinds)[1]
        pair = value_and_size(rest, known[g.slots], derived.sizes(known, g.slots))
        pairs.append([np.broadcast_to(np.asarray(x, float), len(g.source)) for x in pair])
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


# ------------------------------------------------------------------- reactions


def free_reactions(
    groups: list[Rows],
    sums: SumRows,
    coordinate: np.ndarray,
    port: np.ndarray,
    known: np.ndarray,
    place: np.ndarray | None = None,
) -> tuple[list[int], np.ndarray]:
    """Reactions of which only combinations are determined.

    Parameters
    ----------
    groups, sums : all equations that remain
    coordinate : (flat.count+1,) roots that are positions of connectors or are differentiated: never a reaction
    port : (flat.count+1,) unknown roots that stand for a variable of a connector
    place : (orders, extended) values of the jets where the leverages are looked at; a generic point without it

    Returns
    -------
    chosen : the roots whose values may be set at will, so that the rest follows
    undetermined : all roots whose values then depend on that choice
    """
    row, variable, value, bent = _incidence(groups, sums, coordinate, known, place)
    rows = sum(len(g.source) for g in groups) + len(sums.source)
    # what is only computed from the rest does not determine it: P = F·v, Σ P
    keep = ~_rows_that_observe(row, variable, rows, port)[row]
    row, variable, value, bent = row[keep], variable[keep], value[keep], bent[keep]
    absent = port & ~coordinate
    absent[variable] = False
    alone = np.flatnonzero(absent)  # in no equation at all: the force in a rod between two walls
    usable = ~coordinate
    usable[variable[np.isnan(value)]] = False
    inside = usable[variable] & (value != 0)
    row, variable, value = row[inside], variable[inside], value[inside]
    columns, column = numbered(variable)
    core = peel(column, row, len(columns), rows)  # a reaction that a row has to itself is unique
    vectors: dict[int, Vector] = as_vectors(column[core], row[core], value[core])
    # the last are chosen, so those with leverages that change come last: the torque of a lever is zero at its dead
    # centre whatever the forces are, and to set it to zero would say nothing there; the forces tell the torque
    turning = np.zeros(len(columns), bool)
    turning[column[bent[inside]]] = True
    numbers = sorted(vectors, key=lambda n: bool(turning[n]))
    found = dependencies([vectors[n] for n in numbers])
    support = {numbers[j] for combination in found.values() for j, w in combination.items() if abs(w) > CONSISTENT}
    chosen = [*alone.tolist(), *(int(columns[numbers[i]]) for i in found)]
    return chosen, np.concatenate([alone, columns[sorted(support)]])


@cache
def _coefficients(shape: Expr, kinds: Kinds) -> tuple[tuple[Expr, Expr | None], ...]:
    """Pairs (unknown jet, its coefficient or None where it does not stand there linearly and undifferentiated)."""
    result = []
    for leaf in leaves_of(shape, kinds, UNKNOWN):
        parts = linear_parts(shape, [leaf])
        result.append((leaf, parts[0].get(leaf, ZERO) if parts is not None and leaf.value[1] == 0 else None))
    return tuple(result)


def _incidence(
    groups: list[Rows], sums: SumRows, coordinate: np.ndarray, known: np.ndarray, place: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Entries (row, root, coefficient, whether that changes with the position) of all equations.

    Coefficients are taken at a generic position; NaN for a jet that stands there otherwise than linearly, or with a
    factor that is no matter of positions alone.
    """
    row, variable, value, bent = [], [], [], []
    for g, numbers in with_numbers(groups):
        for leaf, coefficient in _coefficients(g.shape, g.kinds):
            usable = np.full(len(numbers), coefficient is not None)
            factors = leaves_of(coefficient, g.kinds, UNKNOWN) if coefficient is not None else ()
            for factor in factors:
                usable &= coordinate[g.column(factor)]
            row.append(numbers)
            variable.append(g.column(leaf))
            value.append(np.where(usable, value_at(coefficient or ZERO, g, known, place=place), np.nan))
            bent.append(np.full(len(numbers), bool(factors)))
    row.append(sums.row + sum(len(g.source) for g in groups))
    variable.append(sums.index)
    value.append(sums.sign)
    bent.append(np.zeros(len(sums.row), bool))
    return np.concatenate(row), np.concatenate(variable), np.concatenate(value), np.concatenate(bent)


def _rows_that_observe(row: np.ndarray, variable: np.ndarray, rows: int, port: np.ndarray) -> np.ndarray:
    """Rows with an unknown that appears nowhere else and in no connector, again and again; a mask."""
    inner = ~port[variable]
    lonely_row = np.where(inner, row, rows)
    observed = np.zeros(rows + 1, bool)
    alive = np.arange(len(row))
    while len(alive):
        count = np.bincount(variable[alive], minlength=len(port))
        found = lonely_row[alive][count[variable[alive]] == 1]
        found = found[found < rows]
        if not len(found):
            break
        observed[found] = True
        alive = alive[~observed[row[alive]]]
    return observed[:rows]
