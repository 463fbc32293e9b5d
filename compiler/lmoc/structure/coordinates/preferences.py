"""Preferences for states.

In this order: what the user asks for; ``stateSelect``; what the rest follows from by explicit formulas (``theta`` in
``q = l·sin(theta)``, the joint coordinates of a tree); coordinates of inertias; what is declared first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.ir.flat import Kind, StateSelect
from lmoc.structure.coordinates.coordinates import Wish
from lmoc.structure.coordinates.jumps import jumping
from lmoc.structure.coordinates.tied import Tied
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.linear.coefficients import linear_form
from lmoc.structure.linear.elimination import LENGTHS_AND_ANGLES
from lmoc.structure.linear.explicit import pivot, solved
from lmoc.structure.messages.equations import Equations
from lmoc.support.distinct import distinct


def asked_for(system: EquationSystem, states: Sequence[str] | None) -> np.ndarray:
    """Columns behind the names the user requested, best first, each once."""
    found = [system.flat.find(name) for name in states or ()]
    columns = [int(c) for f in found if f is not None for c in system.column[system.normalized.root[f]]]
    return np.array([c for c in dict.fromkeys(columns) if c >= 0], np.int64)


def preference(system: EquationSystem, tied: Tied, c: np.ndarray, wanted: np.ndarray, liked: np.ndarray) -> np.ndarray:
    """Return the preference of each column as a state: a permutation rank, higher is preferred.

    What others follow from by an explicit formula comes before what follows: in ``q = l·sin(theta)`` the entry of q
    is constant, that of theta is not. Formulas for variables that shall not be states, such as the gap of a law, say
    nothing about the others. Last comes what jumps while others do not.

    Parameters
    ----------
    wanted : (k,) columns the user requested, best first
    liked : further columns to be preferred to what has no mark
    """
    select = system.flat.per_variable(lambda b: b.state_select, np.int64)
    best = np.full(len(system.kind), -1, np.int64)
    worst = np.full(len(system.kind), int(StateSelect.default), np.int64)
    root = system.normalized.root
    np.maximum.at(best, root, select)
    itself, heavy = system.normalized.order == 0, inertial(system, c)
    as_position = worst.copy()
    np.minimum.at(worst, root, select)
    np.minimum.at(as_position, root[itself], select[itself])
    of_a_part = np.full(len(system.kind), -1, np.int64)  # and not the gap of a law alone, where both are avoided
    np.maximum.at(of_a_part, root[itself], select[itself])
    # a rate that is to be avoided, such as that of a friction, says nothing about the coordinate of an inertia
    best, worst = best[system.variable], np.where(heavy, as_position[system.variable], worst[system.variable])
    avoided = np.zeros(system.rows, bool)
    avoided[tied.row[tied.constant & (worst[tied.column] < StateSelect.default)]] = True
    curved = np.zeros(len(system.variable), bool)
    curved[tied.column[~tied.constant & ~avoided[tied.row]]] = True
    level = 2 + 2 * curved + heavy
    level[liked] = 6
    level = np.where(worst < StateSelect.default, worst, level)
    level = np.where(best > StateSelect.default, best + 10, level)
    level[[c for _, columns in system.given_motions() for c in columns.ravel().tolist()]] = -1
    level[wanted] = 100 + np.arange(len(wanted))[::-1]
    level[jumping(system, c)] = -1
    rank = np.empty(len(level), np.int64)
    among = of_a_part[system.variable] >= StateSelect.default
    rank[np.lexsort((-np.arange(len(level)), among, level))] = np.arange(len(level))
    return rank


def wishes(system: EquationSystem, c: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(columns,) Wish: how much the user wants each column for a state; what jumps cannot be one."""
    wish = np.where(_marked(system), Wish.MARKED, Wish.NONE)
    wish[wanted] = Wish.ASKED
    wish[jumping(system, c)] = Wish.NONE
    return wish


def _marked(system: EquationSystem) -> np.ndarray:
    """(columns,) roots behind variables with ``stateSelect`` above the default."""
    mask = np.zeros(len(system.kind), bool)
    select = system.flat.per_variable(lambda b: b.state_select > StateSelect.default, bool)
    mask[system.normalized.root[select]] = True
    result: np.ndarray = mask[system.variable]
    return result


def inertial(system: EquationSystem, c: np.ndarray) -> np.ndarray:
    """(columns,) coordinates of inertias: the second derivative appears in an equation other than a constraint."""
    i = system.incidence
    mask = np.zeros(i.columns, bool)
    mask[i.column[(i.order >= 2) & (c[i.row] == 0)]] = True
    return mask


def offsets_with_room(
    system: EquationSystem, match: np.ndarray, wanted: np.ndarray, more: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets that leave room for the preferred variables to be states.

    Whoever is to be a state instead of another variable in an equation must be differentiated as often as that.

    Parameters
    ----------
    match : a highest-value transversal
    wanted, more : columns that the user requested, and others to be preferred

    Returns
    -------
    c, d : as `sigma.offsets`
    """
    incidence = system.incidence
    c, d = system.offsets(match, system.needed)
    liked = _marked(system) | _implicit(system, match, d)
    liked[wanted] = liked[more] = True
    if not liked.any():
        return c, d
    own = liked[incidence.column] & (incidence.order == 0)
    reach = np.zeros(incidence.rows, np.int64)
    np.maximum.at(reach, incidence.row[~own], d[incidence.column[~own]] - incidence.order[~own])
    lower = system.needed.copy()
    np.maximum.at(lower, incidence.column[own], reach[incidence.row[own]] + incidence.order[own])
    return system.offsets(match, lower)


def distances(system: EquationSystem, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Columns of variables that are computed as differences of massless points, or the like.

    In ``x = b - a`` a and b are integrated, though perhaps only x is read: a spring between two dampers.
    """
    massless = (d == 1) & ~inertial(system, c)
    found = [np.zeros(0, np.int64)]
    for b in system.batches:
        if len(b.unknown) < 3 or any(leaf.value[1] for leaf in b.unknown) or linear_form(b.shape, b.kinds) is None:
            continue
        columns = np.stack([system.column[b.slots[:, leaf.value[0]]] for leaf in b.unknown], axis=1)
        computed = d[columns] == 0
        fits = (c[b.row] == 0) & (computed.sum(axis=1) == 1) & (computed | massless[columns]).all(axis=1)
        found.append(columns[fits][computed[fits]])
    return distinct(np.concatenate(found))


def _implicit(system: EquationSystem, match: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(columns,) positions that would have to be found by iteration though another follows from them by a formula.

    A massless lever on a mass: ``q = l·sin(theta)`` with q integrated wants an arc sine at every evaluation; with
    theta integrated it is a formula.
    """
    mask = np.zeros(len(d), bool)
    for b in system.batches:
        for leaf in b.unknown:
            column = system.column[b.slots[:, leaf.value[0]]]
            mine = (match[b.row] == column) & (leaf.value[1] == 0)
            if mine.any() and solved(b.shape, leaf) is None and _among_positions(system, b, mine):
                others = [x for x in b.unknown if x is not leaf and pivot(b.shape, b.kinds, x) is not None]
                for x in others:
                    other = system.column[b.slots[:, x.value[0]]]
                    mask[column[mine & (d[other] - x.value[1] > d[column])]] = True
    return mask


def _among_positions(system: EquationSystem, batch: EquationBatch, rows: np.ndarray) -> bool:
    """Return whether an equation is geometry: all its unknowns are potentials of connectors, lengths or angles."""
    flat = system.flat
    number = int(system.source[batch.row[rows][0]])
    blocks = [flat.block_at(v) for v in Equations(flat).unknowns(number)]
    return all((b.connector and not b.flow) or b.unit in LENGTHS_AND_ANGLES for b in blocks)


def declared(system: EquationSystem) -> np.ndarray:
    """(columns,) roots behind outputs, marked variables and what events read: states even if no equation reads them."""
    flat = system.flat
    marked = flat.per_variable(
        lambda b: (b.output or b.state_select > StateSelect.default) and b.kind == Kind.UNKNOWN, bool
    )
    if flat.events is not None:
        marked[flat.events.read] = True
        marked &= flat.kind == Kind.UNKNOWN
    column = system.column[system.normalized.root[marked]]
    mask = np.zeros(len(system.variable), bool)
    mask[column[column >= 0]] = True
    return mask
