"""Constraints that repeat others, and the reactions that are then not unique.

A loop of ideal transmissions gives one constraint too many among the coordinates; in exchange one combination of the
reactions in the loop appears nowhere (the matrix of the reactions is the transpose of that of the constraints). A
repeated constraint is dropped; one reaction of its loop is set to zero, which leaves the sums that act on the bodies
as they are, and all reactions that could have been otherwise are reported as undetermined. Cf. Wojtyra, "Joint
reactions in rigid body mechanisms with dependent constraints", Mechanism and Machine Theory 44 (2009) 2265.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lmoc.distinct import distinct, numbered
from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ZERO, Expr
from lmoc.expression.evaluate import evaluate
from lmoc.structure.coefficients import UNKNOWN, Kinds, is_constant, leaves_of, linear_form, value_and_size
from lmoc.structure.dependence import Vector, as_vectors, dependencies, peel
from lmoc.structure.derived import DerivedParameters
from lmoc.structure.substitution import Rows
from lmoc.structure.sum_rows import SumRows

CONSISTENT = 1e-10


@dataclass(frozen=True, eq=False)
class Constraints:
    """The core of constraint rows among which some may depend on others.

    Attributes
    ----------
    groups : the constraint groups, all linear with constant coefficients and rests
    kept : rows of the core, numbers over the groups' rows one after another
    """

    groups: tuple[Rows, ...]
    kept: np.ndarray
    source: np.ndarray

    @property
    def depends_on_parameters(self) -> bool:
        for g in self.groups:
            coefficients, rest = linear_form(g.shape, g.kinds)
            if any(not e.is_const for e in (*coefficients.values(), rest)):
                return True
        return False

    def judged(self, known: np.ndarray, derived: DerivedParameters) -> list[tuple[int, list[int], bool]]:
        """For each dependent row: its equation, the equations it repeats, and whether it agrees with them."""
        row, column, value = _entries(self.groups, known)
        rest, size = _rests(self.groups, known, derived)
        rows = as_vectors(row, column, value)
        numbers = self.kept.tolist()
        found = []
        for i, combination in dependencies([rows.get(n, {}) for n in numbers]).items():
            terms = [(self.source[numbers[j]], w, numbers[j]) for j, w in combination.items() if abs(w) > CONSISTENT]
            total = sum(w * rest[n] for _, w, n in terms)
            bound = sum(abs(w) * size[n] for _, w, n in terms)
            others = [int(s) for s, _, n in terms if n != numbers[i]]
            found.append((int(self.source[numbers[i]]), others, not abs(total) > CONSISTENT * bound))
        return found


def constraints(groups: list[Rows], flow_like: np.ndarray, known: np.ndarray) -> Constraints | None:
    """The linear rows among coordinates that are not independent at sight, None where all are.

    Parameters
    ----------
    flow_like : (flat.count+1,) roots that stand for flows of connectors; rows with one of them are not constraints
    """
    chosen = []
    for g in groups:
        parts = linear_form(g.shape, g.kinds)
        if parts is None or not parts[0] or not is_constant(parts[1], g.kinds):
            continue
        flows = np.zeros(len(g.source), bool)
        for leaf in parts[0]:
            flows |= flow_like[g.column(leaf)]
        if not flows.all():
            chosen.append(g if not flows.any() else g.take(np.flatnonzero(~flows)))
    if len(chosen) == 0 or sum(len(g.source) for g in chosen) < 2:
        return None
    row, column, _ = _entries(tuple(chosen), known)
    source = np.concatenate([g.source for g in chosen])
    core = peel(row, numbered(column)[1], len(source), len(column))
    if not core.any():
        return None
    return Constraints(tuple(chosen), distinct(row[core]), source)


def _entries(groups: tuple[Rows, ...], known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns (jets as one number) and values of the coefficients of linear groups, rows numbered through."""
    row, column, value, first = [], [], [], 0
    for g in groups:
        numbers = np.arange(first, first + len(g.source))
        first += len(g.source)
        for leaf, c in linear_form(g.shape, g.kinds)[0].items():
            row.append(numbers)
            column.append(g.column(leaf) + leaf.value[1] * len(known))
            value.append(_value(c, g, known))
    return np.concatenate(row), np.concatenate(column), np.concatenate(value)


def _value(expr: Expr, g: Rows, known: np.ndarray) -> np.ndarray:
    number = evaluate(expr, lambda k, _: known[g.slots[:, k]])
    # without a value a parameter is taken for a number that nothing cancels
    return np.nan_to_num(np.broadcast_to(np.asarray(number, float), len(g.source)), nan=np.sqrt(2.0))


def _rests(groups: tuple[Rows, ...], known: np.ndarray, derived: DerivedParameters) -> tuple[np.ndarray, np.ndarray]:
    sizes = derived.sizes(known)
    pairs = []
    for g in groups:
        rest = linear_form(g.shape, g.kinds)[1]
        pair = value_and_size(rest, known[g.slots], sizes[g.slots])
        pairs.append([np.broadcast_to(np.asarray(x, float), len(g.source)) for x in pair])
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


# ------------------------------------------------------------------- reactions


def free_reactions(
    groups: list[Rows], sums: SumRows, coordinate: np.ndarray, port: np.ndarray, known: np.ndarray
) -> tuple[list[int], np.ndarray]:
    """Reactions of which only combinations are determined.

    Parameters
    ----------
    groups, sums : all equations that remain
    coordinate : (flat.count+1,) roots that are positions of connectors or are differentiated: never a reaction
    port : (flat.count+1,) unknown roots that stand for a variable of a connector

    Returns
    -------
    chosen : the roots whose values may be set at will, so that the rest follows
    undetermined : all roots whose values then depend on that choice
    """
    row, variable, value = _incidence(groups, sums, known)
    rows = sum(len(g.source) for g in groups) + len(sums.source)
    # what is only computed from the rest does not determine it: P = F·v, Σ P
    keep = ~_rows_that_observe(row, variable, rows, port)[row]
    row, variable, value = row[keep], variable[keep], value[keep]
    absent = port & ~coordinate
    absent[variable] = False
    alone = np.flatnonzero(absent)  # in no equation at all: the force in a rod between two walls
    usable = ~coordinate
    usable[variable[np.isnan(value)]] = False
    inside = usable[variable]
    row, variable, value = row[inside], variable[inside], value[inside]
    columns, column = numbered(variable)
    core = peel(column, row, len(columns), rows)  # a reaction that a row has to itself is unique
    vectors: dict[int, Vector] = as_vectors(column[core], row[core], value[core])
    numbers = list(vectors)
    found = dependencies([vectors[n] for n in numbers])
    support = {numbers[j] for combination in found.values() for j, w in combination.items() if abs(w) > CONSISTENT}
    chosen = [*alone.tolist(), *(int(columns[numbers[i]]) for i in found)]
    return chosen, np.concatenate([alone, columns[sorted(support)]])


@cache
def _coefficients(shape: Expr, kinds: Kinds) -> tuple[tuple[Expr, Expr | None], ...]:
    """Pairs (unknown jet, its coefficient or None where that is not constant)."""
    result = []
    for leaf in leaves_of(shape, kinds, UNKNOWN):
        parts = linear_parts(shape, [leaf])
        coefficient = None if parts is None else parts[0].get(leaf, ZERO)
        usable = coefficient is not None and leaf.value[1] == 0 and is_constant(coefficient, kinds)
        result.append((leaf, coefficient if usable else None))
    return tuple(result)


def _incidence(groups: list[Rows], sums: SumRows, known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Entries (row, root, coefficient) of all equations; NaN for a jet that stands there otherwise than linearly."""
    row, variable, value, first = [], [], [], 0
    for g in groups:
        numbers = np.arange(first, first + len(g.source))
        first += len(g.source)
        for leaf, coefficient in _coefficients(g.shape, g.kinds):
            row.append(numbers)
            variable.append(g.column(leaf))
            value.append(np.full(len(numbers), np.nan) if coefficient is None else _value(coefficient, g, known))
    row.append(sums.row + first)
    variable.append(sums.index)
    value.append(sums.sign)
    return np.concatenate(row), np.concatenate(variable), np.concatenate(value)


def _rows_that_observe(row: np.ndarray, variable: np.ndarray, rows: int, port: np.ndarray) -> np.ndarray:
    """Rows with an unknown that stands nowhere else and in no connector, again and again; a mask."""
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
