"""The number of differentiations of each equation: the Σ-method (J. D. Pryce, BIT 41, 2001).

A highest-value transversal of the signature matrix (an assignment of equations to unknowns whose derivative orders
have the largest sum) gives the number of degrees of freedom; its smallest dual solution gives the offsets: equation i
is differentiated ``c[i]`` times, unknown j occurs up to order ``d[j]``.
"""

from __future__ import annotations

import numpy as np

from lmoc.structure.index.dulmage_mendelsohn import decompose
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import forced_pairs, maximum_matching
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX, counted


def highest_value_transversal(incidence: Incidence) -> np.ndarray | None:
    """Column of each row in an assignment with the largest sum of orders; None where there is no assignment.

    The Hungarian method with all free rows at once (Kuhn 1955; Hopcroft and Karp 1973 for the matchings): a matching of
    the entries that are tight for dual prices, which rise where it falls short. In a mechanism two or three rises do.
    """
    if incidence.rows != incidence.columns:
        return None
    match, rows, columns = forced_pairs(incidence)
    if len(rows) != len(columns):
        return None
    if len(rows):
        found = _primal_dual(incidence.submatrix(rows, columns))
        if found is None:
            return None
        match[rows] = columns[found]
    return match


def _primal_dual(core: Incidence) -> np.ndarray | None:
    row, column, order = core.row, core.column, core.order
    row_price, column_price = np.zeros(core.rows, np.int64), np.zeros(core.columns, np.int64)
    np.maximum.at(column_price, column.astype(np.int64), order.astype(np.int64))
    while True:
        slack = column_price[column] - row_price[row] - order
        tight = core.restricted(slack == 0)
        match = maximum_matching(tight)
        if (match >= 0).all():
            return match
        short = decompose(tight, match)
        inside, reached = np.zeros(core.rows, bool), np.zeros(core.columns, bool)
        inside[short.over_rows], reached[short.over_columns] = True, True
        leaving = inside[row] & ~reached[column]
        if not leaving.any():
            return None
        rise = slack[leaving].min()
        row_price[inside] += rise
        column_price[reached] += rise


def offsets(incidence: Incidence, match: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest offsets, by Pryce's fixed-point iteration over the rows that still change.

    Parameters
    ----------
    match : a highest-value transversal
    lower : (columns,) orders that are needed whatever the equations say (a velocity that somebody wants to see)

    Returns
    -------
    c : (rows,) times each equation is differentiated
    d : (columns,) highest order of each unknown
    """
    c, d = np.zeros(incidence.rows, np.int64), lower.astype(np.int64)
    np.maximum.at(d, incidence.column.astype(np.int64), incidence.order.astype(np.int64))
    matched = match[incidence.row] == incidence.column
    own = np.zeros(incidence.rows, np.int64)
    own[incidence.row[matched]] = incidence.order[matched]
    row_of = np.empty(incidence.columns, INDEX)
    row_of[match] = counted(0, incidence.rows)
    rows = np.arange(incidence.rows)
    while True:
        new = d[match[rows]] - own[rows]
        changed = new > c[rows]
        rows, new = rows[changed], new[changed]
        if not len(rows):
            return c, d
        c[rows] = new
        entries = incidence.of_rows(rows)
        columns = incidence.column[entries].astype(np.int64)
        needed = incidence.order[entries] + c[incidence.row[entries]]
        raised = needed > d[columns]
        np.maximum.at(d, columns[raised], needed[raised])
        rows = row_of[distinct(columns[raised])]
