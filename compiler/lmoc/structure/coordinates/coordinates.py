"""Selection of states: dummy derivatives (Mattsson & Söderlind, SIAM J. Sci. Comput. 14, 1993) with preferences.

A constraint that must be differentiated c times ties its variables at c orders below the highest. For each order, as
many of the tied jets as there are constraints are computed from the others; these are found greedily, from the
variable least wanted as a state to the most wanted one. Independent columns of a matrix are a matroid, so the greedy
choice is the best one (Edmonds 1971).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from lmoc.structure.coordinates.tied import Tied, largest_in_row
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

# The share of the largest entry in its row that an entry which changes along the motion must have at the start to be
# divided by without care, and to be divided by at all if there is another; one that never changes must only be there.
SAFE_SHARE, VANISHING, ROUNDOFF = 0.1, 1e-6, 1e-10
UNUSABLE = 5
Rows = dict[int, dict[int, float]]  # the entries of each row by their column


class Wish(IntEnum):
    """The user's preference for a variable as a state."""

    NONE = 0
    MARKED = 1  # stateSelect
    ASKED = 2  # states=[...]: it is dependent only where nothing else is left


@dataclass(frozen=True, eq=False)
class Choice:
    """The result of selection.

    Attributes
    ----------
    dependent : one array a stage: columns whose jets of order d-1, d-2, … are computed
    match : one array a stage: pairs (row, column), for each constraint the jet that stands for it in the matching
    singular : rows in which no usable entry was left: dependent constraints or a special start
    """

    dependent: tuple[np.ndarray, ...]
    match: tuple[tuple[np.ndarray, np.ndarray], ...]
    singular: np.ndarray


def choose(tied: Tied, c: np.ndarray, d: np.ndarray, rank: np.ndarray, wish: np.ndarray) -> Choice:
    """Select the dependent jets, stage by stage.

    Parameters
    ----------
    rank : as `preference` gives it
    wish : (columns,) Wish
    """
    dependent: list[np.ndarray] = []
    match: list[tuple[np.ndarray, np.ndarray]] = []
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
        now_or_never = (wish == Wish.ASKED) & (d == stage)  # the others may be states of a later stage
        chosen, singular = _greedy(part, rows, np.where(now_or_never, rank + len(rank), rank), wish)
        if len(singular):
            return Choice(tuple(dependent), tuple(match), singular)
        dependent.append(np.sort(chosen))
        match.append(_matched(part, rows, dependent[-1]))
        allowed = np.zeros(len(d), bool)
        allowed[chosen] = True
    return Choice(tuple(dependent), tuple(match), np.zeros(0, np.int64))


def determined_at_start(tied: Tied, c: np.ndarray, d: np.ndarray, choice: Choice) -> bool:
    """Return whether the dependent jets follow from the others where the scene starts."""
    for stage, columns in enumerate(choice.dependent, 1):
        part = tied.take((c[tied.row] >= stage) & (d[tied.column] >= stage))
        shared = _sharing(part)
        alone = ~shared[part.row]
        lost = alone & np.isin(part.column, columns) & (part.share <= VANISHING)
        if lost.any():
            return False
        rest = part.take(~alone)
        size = largest_in_row(rest.row, np.abs(rest.at_start))
        among = rest.take(np.isin(rest.column, columns))  # the others only tell the sizes: they would fill the rows
        count = np.bincount(among.column, minlength=len(d))[columns]
        sparsest = columns[np.argsort(count, kind="stable")]  # first, which fills least
        if len(_pivots(among, among.at_start, [(sparsest, VANISHING)], size)) < np.count_nonzero(shared):
            return False
    return True


def _sharing(tied: Tied) -> np.ndarray:
    """(rows,) mask of those that share a column with others."""
    shared = np.zeros(int(tied.row.max(initial=-1)) + 1, bool)
    shared[tied.row[np.bincount(tied.column)[tied.column] > 1]] = True
    return shared


def _matched(tied: Tied, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used = np.isin(tied.column, columns) & (tied.value != 0)
    r, c = np.searchsorted(rows, tied.row[used]), np.searchsorted(columns, tied.column[used])
    pairs = maximum_matching(Incidence.of(len(rows), len(columns), r, c, np.zeros(len(r), np.int64)))
    return rows, columns[pairs]


def _greedy(tied: Tied, rows: np.ndarray, rank: np.ndarray, wish: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A basis of columns, least wanted first; the rows for which none is left."""
    shared = _sharing(tied)
    alone = ~shared[tied.row]
    # rows that share no column with others: their best entry each
    reluctance = _reluctance(tied, wish)[alone]
    single = tied.row[alone]
    order = np.lexsort((rank[tied.column[alone]], reluctance, single))
    first = np.ones(len(order), bool)
    first[1:] = single[order][1:] != single[order][:-1]
    best = order[first]
    usable = reluctance[best] < UNUSABLE
    chosen = [tied.column[alone][best[usable]]]
    done = np.zeros(int(rows.max()) + 1, bool)
    done[single[best[usable]]] = True
    if shared.any():
        pivots = _eliminate(tied.take(~alone), rank, wish)
        chosen.append(np.array(list(pivots.values()), np.int64))
        done[list(pivots)] = True
    return np.concatenate(chosen), rows[~done[rows]]


def _reluctance(tied: Tied, wish: np.ndarray) -> np.ndarray:
    """(nnz,) how little each entry is liked for a pivot, from 0; `UNUSABLE` where it vanishes everywhere."""
    size = np.abs(tied.value)
    wish = wish[tied.column]
    cases = [
        size <= ROUNDOFF * largest_in_row(tied.row, size)[tied.row],
        wish == Wish.ASKED,
        tied.share <= VANISHING,
        wish == Wish.MARKED,
        tied.share < SAFE_SHARE,
    ]
    return np.select(cases, [UNUSABLE, 4, 3, 2, 1], 0)


def _eliminate(tied: Tied, rank: np.ndarray, wish: np.ndarray) -> dict[int, int]:
    """Rows and columns of the pivots, in the order of `_reluctance`: as many as can be at the start, then generic ones.

    Columns that are independent at the start are so at the generic point nearby; where a scene starts at a singular
    place, the others are found there.
    """
    columns = distinct(tied.column)
    columns = columns[np.argsort(rank[columns])]
    level = wish[columns]
    free, marked, known = columns[level == Wish.NONE], columns[level == Wish.MARKED], columns[level < Wish.ASKED]
    passes = [(some, share) for some in (free, marked) for share in (SAFE_SHARE, VANISHING)]
    pivots = _pivots(tied, tied.at_start, passes)
    if len(pivots) == len(distinct(tied.row)):
        return pivots
    chosen = np.array(list(pivots.values()), np.int64)
    return _pivots(tied, tied.value, [(chosen, ROUNDOFF), (known, ROUNDOFF), (columns, ROUNDOFF)])


def _pivots(
    tied: Tied, values: np.ndarray, passes: list[tuple[np.ndarray, float]], size: np.ndarray | None = None
) -> dict[int, int]:
    """Gaussian elimination column by column; returns {row: column} of the pivots.

    Parameters
    ----------
    values : (nnz,) numbers of the entries
    passes : columns in the order in which they are tried, with the least share of the row that they must have there
        where they change along the motion
    size : (rows,) the largest entry of each row; of those in `tied` by default
    """
    rows: Rows = {}
    column_rows: dict[int, set[int]] = {}
    steady: dict[int, bool] = {}
    entries = zip(tied.row.tolist(), tied.column.tolist(), values.tolist(), tied.constant.tolist(), strict=True)
    for r, c, value, constant in entries:
        if value != 0.0:
            row = rows.setdefault(r, {})
            row[c] = row.get(c, 0.0) + value
            column_rows.setdefault(c, set()).add(r)
            steady[c] = steady.get(c, True) and constant
    scale = {r: max(map(abs, row.values())) or 1.0 for r, row in rows.items()}
    if size is not None:
        scale = {r: float(size[r]) for r in rows}
    pivots: dict[int, int] = {}
    taken: set[int] = set()
    for columns, share in passes:
        for c in columns.tolist():
            living = [r for r in column_rows.get(c, ()) if r not in pivots]
            if c in taken or not living:
                continue
            r = max(living, key=lambda i: (abs(rows[i][c]) / scale[i], -len(rows[i])))
            if abs(rows[r][c]) > (ROUNDOFF if steady[c] else share) * scale[r]:
                pivots[r] = c
                taken.add(c)
                if not steady[c]:  # what it is subtracted from changes with it
                    steady.update(dict.fromkeys(rows[r], False))
                _clear(r, c, living, rows, column_rows, scale)
    return pivots


def _clear(
    r: int, c: int, living: list[int], rows: Rows, column_rows: dict[int, set[int]], scale: dict[int, float]
) -> None:
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
