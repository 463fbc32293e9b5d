"""Over- and under-determined parts: the coarse decomposition of Dulmage and Mendelsohn.

A. L. Dulmage, N. S. Mendelsohn, "Coverings of bipartite graphs", Canad. J. Math. 10 (1958); computed as in A. Pothen,
C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM TOMS 16 (1990).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lmoc.structure.index.incidence import Incidence, ranges
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Decomposition:
    """The parts of a system that has no perfect matching.

    Attributes
    ----------
    over_rows, over_columns : more equations than unknowns
    under_rows, under_columns : fewer equations than unknowns
    """

    over_rows: np.ndarray
    over_columns: np.ndarray
    under_rows: np.ndarray
    under_columns: np.ndarray


def decompose(incidence: Incidence, match: np.ndarray) -> Decomposition:
    """Follow alternating paths from what a maximum matching has left out.

    Parameters
    ----------
    match : (rows,) column of each row, -1 where there is none
    """
    row_of = np.full(incidence.columns, -1, np.int64)
    matched = np.flatnonzero(match >= 0)
    row_of[match[matched]] = matched
    free_rows, free_columns = np.flatnonzero(match < 0), np.flatnonzero(row_of < 0)
    over_rows, over_columns = _reach(incidence.start, incidence.column, row_of, free_rows)
    by_column = incidence.row[incidence.by_column]
    under_columns, under_rows = _reach(incidence.column_start, by_column, match, free_columns)
    return Decomposition(over_rows, over_columns, under_rows, under_columns)


def _reach(
    start: np.ndarray, neighbours: np.ndarray, partner: np.ndarray, seeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Everything on alternating paths from `seeds`: on their own side, and on the other side."""
    own = np.zeros(len(start) - 1, bool)
    other = np.zeros(len(partner), bool)
    new = seeds
    while len(new):
        own[new] = True
        touched = distinct(neighbours[ranges(start, new)])
        touched = touched[~other[touched]]
        other[touched] = True
        new = partner[touched]
        new = new[new >= 0]
        new = new[~own[new]]
    return np.flatnonzero(own), np.flatnonzero(other)


def components(incidence: Incidence, rows: np.ndarray, columns: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """A part in connected pieces: pairs (rows, columns)."""
    part = incidence.submatrix(rows, columns)
    count = part.rows + part.columns
    label = least_connected(part.row, part.rows + part.column, count)
    seeds = np.flatnonzero(label == np.arange(count)).tolist()
    order = np.argsort(label, kind="stable")
    limits = np.searchsorted(label[order], [*seeds, count])
    members = [order[a:b] for a, b in pairwise(limits.tolist())]
    return [(rows[m[m < part.rows]], columns[m[m >= part.rows] - part.rows]) for m in members]


def least_connected(a: np.ndarray, b: np.ndarray, count: int) -> np.ndarray:
    """(count,) the smallest number of those that pairs (a, b) connect with each.

    Each root is hooked to the smallest one beside it, and paths are halved until all is flat (Shiloach and Vishkin,
    J. Algorithms 3, 1982): a few passes over all pairs, however many pieces there are.
    """
    least = np.arange(count)
    while True:
        one, other = least[a], least[b]
        apart = one != other
        if not apart.any():
            return least
        one, other = one[apart], other[apart]
        np.minimum.at(least, np.maximum(one, other), np.minimum(one, other))
        while (least[least] != least).any():
            least = least[least]
