"""Which jets are states: dummy derivatives (Mattsson & Söderlind, SIAM J. Sci. Comput. 14, 1993) with preferences.

A constraint that must be differentiated c times ties its variables at c orders below the highest. For each order, as
many of the tied jets as there are constraints are computed from the others; these are found greedily, from the
variable least wanted as a state to the most wanted one. Independent columns of a matrix are a matroid, so the greedy
choice is the best one (Edmonds 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmoc.distinct import distinct
from lmoc.expression.calculus import differentiate
from lmoc.expression.evaluate import evaluate
from lmoc.structure.coefficients import is_constant
from lmoc.structure.incidence import Incidence
from lmoc.structure.matching import maximum_matching
from lmoc.structure.system import Sample, System

# An entry of the constraint matrix that changes along the motion must have this share of the largest one in its row to
# be divided by; one that never changes must only be there.
SAFE_SHARE, ROUNDOFF = 0.1, 1e-10

# a time at which nothing special happens
GENERIC_TIME = 0.1234


@dataclass(frozen=True, eq=False)
class Tied:
    """The constraint matrix: derivatives of the equations with c > 0 by the jets of highest order in them.

    Entries (row, column, value); `constant`: the entry depends on parameters only.
    """

    row: np.ndarray
    column: np.ndarray
    value: np.ndarray
    constant: np.ndarray

    def take(self, kept: np.ndarray) -> Tied:
        return Tied(self.row[kept], self.column[kept], self.value[kept], self.constant[kept])


@dataclass(frozen=True, eq=False)
class Choice:
    """What selection gives.

    Attributes
    ----------
    dependent : one array a stage: columns whose jets of order d-1, d-2, … are computed
    match : one array a stage: pairs (row, column), for each constraint the jet that stands for it in the matching
    singular : rows in which no usable entry was left: dependent constraints or a special start
    """

    dependent: tuple[np.ndarray, ...]
    match: tuple[tuple[np.ndarray, np.ndarray], ...]
    singular: np.ndarray


def tied_entries(system: System, c: np.ndarray, d: np.ndarray, sample: Sample, least: int = 1) -> Tied:
    """Entries of the constraint matrix at the sample point: the equations differentiated `least` times or more.

    With ``least=0`` this is the Jacobian of the whole system by its highest derivatives, which must be regular.
    """
    rows, columns, values, constants = [], [], [], []
    for b in system.batches:
        if (c[b.row] < least).all():
            continue
        for leaf in b.unknown:
            k, order = leaf.value
            column = system.column[b.slots[:, k]]
            tight = (c[b.row] >= least) & (d[column] - c[b.row] == order)
            if not tight.any():
                continue
            chosen = b.take(np.flatnonzero(tight))
            partial = differentiate(b.shape, leaf)
            value = evaluate(partial, sample.column(chosen), GENERIC_TIME)
            rows.append(chosen.row)
            columns.append(column[tight])
            values.append(np.broadcast_to(np.asarray(value, float), len(chosen.row)))
            constants.append(np.full(len(chosen.row), is_constant(partial, b.kinds)))
    s = system.sums
    row, column = s.row[s.entry_row], system.column[s.index]
    tight = (c[row] >= least) & (d[column] - c[row] == s.order)
    rows.append(row[tight])
    columns.append(column[tight])
    values.append(s.coefficient[tight].astype(float))
    constants.append(np.ones(int(tight.sum()), bool))
    return Tied(*(np.concatenate(parts) for parts in (rows, columns, values, constants)))


def choose(tied: Tied, c: np.ndarray, d: np.ndarray, rank: np.ndarray, wanted: np.ndarray) -> Choice:
    """Select the dependent jets, stage by stage.

    Parameters
    ----------
    rank : as `preference` gives it
    wanted : columns that may be dependent only if nothing else is left
    """
    dependent, match = [], []
    asked = np.zeros(len(d), bool)
    asked[wanted] = True
    allowed = np.ones(len(d), bool)
    previous = np.zeros(0, np.int64)
    for stage in range(1, int(c.max(initial=0)) + 1):
        rows = np.flatnonzero(c >= stage)
        kept = (c[tied.row] >= stage) & (d[tied.column] >= stage) & allowed[tied.column]
        part = tied.take(kept)
        if stage > 1 and len(rows) == len(previous) == len(distinct(part.column)):
            dependent.append(dependent[-1])
            match.append(match[-1])
            continue
        previous = rows
        chosen, singular = _greedy(part, rows, rank, asked)
        if len(singular):
            return Choice(tuple(dependent), tuple(match), singular)
        dependent.append(np.sort(chosen))
        match.append(_matched(part, rows, dependent[-1]))
        allowed = np.zeros(len(d), bool)
        allowed[chosen] = True
    return Choice(tuple(dependent), tuple(match), np.zeros(0, np.int64))


def _matched(tied: Tied, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used = np.isin(tied.column, columns) & (tied.value != 0)
    r, c = np.searchsorted(rows, tied.row[used]), np.searchsorted(columns, tied.column[used])
    pairs = maximum_matching(Incidence.of(len(rows), len(columns), r, c, np.zeros(len(r), np.int64)))
    return rows, columns[pairs]


def _greedy(tied: Tied, rows: np.ndarray, rank: np.ndarray, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A basis of columns, least wanted first; the rows for which none is left."""
    size = np.zeros(int(rows.max()) + 1)
    np.maximum.at(size, tied.row, np.abs(tied.value))
    share = np.abs(tied.value) / np.where(size[tied.row] > 0, size[tied.row], 1.0)
    reluctance = np.where(share <= ROUNDOFF, 3, np.where(asked[tied.column], 2, 0))
    reluctance = np.where(~tied.constant & (share < SAFE_SHARE) & (reluctance == 0), 1, reluctance)
    count = np.bincount(tied.column, minlength=len(rank))
    shared = np.zeros(len(size), bool)
    shared[tied.row[count[tied.column] > 1]] = True
    alone = ~shared[tied.row]
    # rows that share no column with others: their best entry each
    single = tied.row[alone]
    order = np.lexsort((rank[tied.column[alone]], reluctance[alone], single))
    first = np.ones(len(order), bool)
    first[1:] = single[order][1:] != single[order][:-1]
    best = order[first]
    usable = reluctance[alone][best] < 3
    chosen = [tied.column[alone][best[usable]]]
    done = np.zeros(len(size), bool)
    done[single[best[usable]]] = True
    if shared.any():
        pivots = _eliminate(tied.take(~alone), rank, asked)
        chosen.append(np.array(list(pivots.values()), np.int64))
        done[list(pivots)] = True
    return np.concatenate(chosen), rows[~done[rows]]


def _eliminate(tied: Tied, rank: np.ndarray, asked: np.ndarray) -> dict[int, int]:
    """Gaussian elimination column by column in the order of rank; returns {row: column} of the pivots."""
    rows: dict[int, dict[int, float]] = {}
    column_rows: dict[int, set[int]] = {}
    steady: dict[int, bool] = {}
    entries = zip(tied.row.tolist(), tied.column.tolist(), tied.value.tolist(), tied.constant.tolist(), strict=True)
    for r, c, value, constant in entries:
        if value != 0.0:
            rows.setdefault(r, {})[c] = value
            column_rows.setdefault(c, set()).add(r)
            steady[c] = steady.get(c, True) and constant
    scale = {r: max(map(abs, row.values())) for r, row in rows.items()}
    pivots: dict[int, int] = {}
    columns = sorted(column_rows, key=lambda c: rank[c])
    free = [c for c in columns if not asked[c]]
    taken: set[int] = set()
    for candidates, careful in ((free, True), (free, False), (columns, False)):
        for c in candidates:
            living = [r for r in column_rows[c] if r not in pivots]
            if c in taken or not living:
                continue
            r = max(living, key=lambda i: (abs(rows[i][c]) / scale[i], -len(rows[i])))
            share = SAFE_SHARE if careful and not steady[c] else ROUNDOFF
            if abs(rows[r][c]) > share * scale[r]:
                pivots[r] = c
                taken.add(c)
                _clear(r, c, living, rows, column_rows, scale)
    return pivots


def _clear(r: int, c: int, living: list[int], rows: dict, column_rows: dict, scale: dict) -> None:
    """Subtract row r from the other living rows so that column c vanishes there; roundoff is taken for zero."""
    pivot_row = rows[r]
    for i in living:
        if i == r:
            continue
        target = rows[i]
        factor = target.pop(c) / pivot_row[c]
        column_rows[c].discard(i)
        for k, value in pivot_row.items():
            if k == c:
                continue
            new = target.get(k, 0.0) - factor * value
            if abs(new) <= ROUNDOFF * max(scale[i], abs(factor * value)):
                if k in target:
                    del target[k]
                    column_rows[k].discard(i)
            else:
                target[k] = new
                column_rows[k].add(i)
