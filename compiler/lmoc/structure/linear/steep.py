"""Two variables in a ratio far from 1: the larger one is the root of both.

``x = nx·q, y = ny·q`` with a line that is vertical up to the rounding of cos(pi/2): with x as the root, q would be x
divided by 6e-17, all of it rounding. Which rows are so steep depends on parameter values, and is a guard.
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.support.records import dataclass

STEEP = 1e8  # ratio from which on; gears and lengths in other units stay below


@dataclass(frozen=True, eq=False)
class Ratios:
    """The ratios of two variables, ``expr(slots[i])``: whether the same of them are steep with other parameters.

    Attributes
    ----------
    steep : (n,) for the values of the reduction
    """

    expr: Expr
    slots: np.ndarray
    steep: np.ndarray
    derived: DerivedParameters

    def __call__(self, values: np.ndarray) -> bool:
        beyond = self.slots.size > 0 and int(self.slots.max()) >= self.derived.base
        known = self.derived.extended(values) if beyond else values
        return bool((_is_steep(sizes(self.expr, self.slots, known)) == self.steep).all())


def sizes(expr: Expr, table: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the magnitudes (n,) of a ratio; 1 where it is not known.

    Parameters
    ----------
    table : (n, columns) extended variables
    known : values of all extended variables
    """
    with np.errstate(all="ignore"):
        value = np.abs(evaluate(expr, lambda k, _: known[table[:, k]]))
    value = np.broadcast_to(value, len(table))
    return np.where(np.isfinite(value) & (value > 0.0), value, 1.0)


def ratios(expr: Expr, table: np.ndarray, derived: DerivedParameters) -> tuple[np.ndarray, Ratios]:
    """Return the magnitudes (n,) of a ratio for the present parameters, and the guard of which of them are steep."""
    found = sizes(expr, table, derived.known)
    return found, Ratios(expr, table, _is_steep(found), derived)


def largest(
    first: np.ndarray, second: np.ndarray, ratio: np.ndarray, known: np.ndarray, score: np.ndarray
) -> np.ndarray:
    """Return the scores with which the largest variable of each component with a steep row is its root.

    Parameters
    ----------
    first, second, ratio : (n,) rows |first| = ratio·|second|
    known, score : as of `affine_forest.orient`; what the user asks for has a negative score and stays
    """
    steep = np.flatnonzero(_is_steep(ratio))
    if not len(steep):
        return score
    neighbours: dict[int, list[tuple[int, float]]] = {}
    for a, b, size in zip(first.tolist(), second.tolist(), np.log(ratio).tolist(), strict=True):
        neighbours.setdefault(a, []).append((b, -size))
        neighbours.setdefault(b, []).append((a, size))
    score = score.copy()
    seen: set[int] = set()
    for start in first[steep].tolist():
        if start in seen:
            continue
        size, queue = {start: 0.0}, [start]
        for node in queue:
            for other, step in neighbours[node]:
                if other not in size:
                    size[other] = size[node] + step
                    queue.append(other)
        seen |= size.keys()
        if not known[queue].any() and (score[queue] >= 0).all():
            score[max(queue, key=lambda node: (size[node], -score[node], -node))] = 0
    return score


def _is_steep(ratio: np.ndarray) -> np.ndarray:
    return (ratio > STEEP) | (ratio < 1.0 / STEEP)
