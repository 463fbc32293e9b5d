"""The ways in which a linkage of several loops closes, group by group.

Where as many coordinates are free as there are constraints, these fall into groups, each of which is solved for its own
coordinates once those before it are known: Assur's groups of a linkage (Assur 1913), strongly connected components of
its equations. A group of two bars closes in two ways, one of four in up to six. A way of the whole is a way of each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.structure.blocks.blocks import blocks_of
from lmoc.structure.coordinates.assemblies import Assemblies, Loops
from lmoc.structure.coordinates.constraint_rows import ConstraintRows
from lmoc.structure.coordinates.turns import TURN
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.matching import maximum_matching

MOST = 64  # ways that are followed at once, the nearest ones
# constraints of a loop that is looked for by itself, in 10 to 20 ms; what hangs together in a lift of twenty stages
# takes 9 s, and is found by Newton's method from where it begins
SMALL = 12


def group_by_group(
    part: ConstraintRows, loops: Loops, parts_of: Callable[[ConstraintRows, np.ndarray, np.ndarray], Loops]
) -> Assemblies | None:
    """Return the ways in which constraints are met, found group by group; None where that is not possible.

    Parameters
    ----------
    loops : the constraints of `part`, with what is held and wished for
    parts_of : the same for some of them, from a first guess (n,) and with other unknowns held: a mask (n,)
    """
    groups = _groups(part, loops.held)
    if groups is None:
        return None
    points, known = loops.aims[None].copy(), loops.held.copy()
    for rows, columns in groups:
        own = part.take(rows)
        inside = np.searchsorted(part.jets, own.jets)
        free = np.isin(inside, columns)
        known[columns] = True
        more = []
        for x in points:
            ways = _one(own, x[inside], free) if len(columns) == 1 else None
            if ways is None:
                found = parts_of(own, x[inside], ~free).found()
                ways = np.zeros((0, len(inside))) if found is None else found.points
            for way in ways:
                more.append(x.copy())
                more[-1][inside[free]] = way[free]
        if not more:
            return None
        points = _nearest(loops, np.array(more), known)
    return loops.sorted(points)


def one_by_one(
    part: ConstraintRows, loops: Loops, parts_of: Callable[[ConstraintRows, np.ndarray, np.ndarray], Loops]
) -> Assemblies | None:
    """Return the ways in which small loops close that share nothing free; None where there are others, or none does.

    Where all pins of a lattice are given, each bar is a loop by itself. From one place a few of many bars would always
    miss their angles, and nothing be found of all. Parameters as of `group_by_group`.
    """
    groups = [(rows, columns) for rows, columns in part.components(loops.held) if len(rows) and len(columns)]
    if len(groups) < 2 or max(len(rows) for rows, _ in groups) > SMALL:
        return None
    points, known = loops.aims[None].copy(), loops.held.copy()
    for rows, columns in groups:
        own = part.take(rows)
        inside = np.searchsorted(part.jets, own.jets)
        free = np.isin(inside, columns)
        found = parts_of(own, points[0, inside], ~free).found()
        if found is None:
            return None
        known[columns] = True
        ways = found.points[:, free] if found.isolated else found.points[:1, free]
        count, points = len(points), np.repeat(points, len(ways), axis=0)
        points[:, inside[free]] = np.tile(ways, (count, 1))
        points = _nearest(loops, points, known)
    return loops.sorted(points)


def _groups(part: ConstraintRows, held: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Rows and free unknowns that are solved together, in an order in which each needs those before it alone."""
    columns = np.flatnonzero(~held)
    if len(columns) != part.count:
        return None
    place = np.full(len(held), -1)
    place[columns] = np.arange(len(columns))
    free = place[part.column] >= 0
    row, column = part.row[free], place[part.column[free]]
    match = maximum_matching(Incidence.of(part.count, len(columns), row, column, np.zeros(len(row), np.int64)))
    if (match < 0).any():
        return None
    owner = np.full(len(columns), -1)
    owner[match] = np.arange(part.count)
    blocks = blocks_of(row, owner[column], part.count)
    order = np.argsort(blocks.level, kind="stable").tolist()
    rows = [np.flatnonzero(blocks.block == b) for b in order]
    return [(own, columns[match[own]]) for own in rows]


def _one(own: ConstraintRows, x: np.ndarray, free: np.ndarray) -> np.ndarray | None:
    """The only way (1, n) to meet one constraint that is linear in its unknown; None where it is not."""
    residual, jacobian = own.dense(np.stack([x, x + free]))
    first, second = jacobian[:, 0, free][:, 0]
    if not (np.isfinite(residual).all() and first != 0.0 and abs(second - first) <= 1e-12 * abs(first)):
        return None
    result: np.ndarray = (x - free * residual[0, 0] / first)[None]
    return result


def _nearest(loops: Loops, points: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The points nearest to what is wished as far as they are known, whole turns apart; as many as are followed."""
    if len(points) <= MOST:
        return points
    w = loops.wishes
    missed, angle = w.missed(points), loops.turns.angle[w.place] & known[w.place]
    missed = np.where(angle, (missed + np.pi) % TURN - np.pi, 0.0)
    given, rest = ((missed[:, own] ** 2).sum(axis=1) for own in (w.level <= 0, w.level > 0))
    return points[np.lexsort((rest, np.round(given, 6)))[:MOST]]
