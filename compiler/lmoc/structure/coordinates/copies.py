"""Constraints that are copies of each other: looked at once, whatever they are called and however many there are.

Constraints that depend on each other are one component. Two are copies where they have the same equations in the same
order, the same numbers in them, and the same is given and wished for there. What nothing is said about begins with
generic numbers, of which no two are alike; these tell no copies apart.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.structure.coordinates.assemblies import Wishes
from lmoc.structure.coordinates.constraint_rows import ConstraintRows
from lmoc.structure.index.incidence import pointers, ranges
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Copies:
    """Components that are equal but for their names.

    Attributes
    ----------
    number : (k,) of each among all components
    rows : those of the first
    inside : (k, n) for each the positions of its unknowns among those of all, in order
    """

    number: np.ndarray
    rows: np.ndarray
    inside: np.ndarray

    def each(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the number of each and the positions of its unknowns."""
        yield from zip(self.number.tolist(), self.inside, strict=True)


def copies(
    rows: ConstraintRows, held: np.ndarray, weight: np.ndarray, said: np.ndarray, wishes: Wishes, kind: np.ndarray
) -> list[Copies]:
    """Return the components of constraints while some unknowns are held, those that are copies together.

    Parameters
    ----------
    held, weight : (n,) of the unknowns; how easily each gives way
    said : (n,) mask of those whose first values are not generic
    wishes : what is wished of all unknowns
    kind : (rows.count,) integers by which rows differ beside their equations
    """
    own = [found for found, _ in rows.components(held) if len(found)]
    label = np.empty(rows.count, np.int64)
    label[np.concatenate([np.zeros(0, np.int64), *own])] = np.repeat(np.arange(len(own)), [len(r) for r in own])
    width = len(rows.jets)
    keys = label[rows.row] * width + rows.column
    pairs = distinct(keys)
    component, jet = pairs // width, pairs % width
    first = pointers(component, len(own))
    contents = [
        *_of_rows(rows, label, kind),
        (label[rows.row], np.searchsorted(pairs, keys) - first[label[rows.row]]),
        *((component, bits) for bits in (_bits(weight[jet]), _bits(np.where(said, rows.begin, 0.0)[jet]))),
        *_of_wishes(wishes, component, jet, first),
    ]
    same: dict[bytes, list[int]] = {}
    for number, key in enumerate(_keys(contents, len(own))):
        same.setdefault(key, []).append(number)
    return [
        Copies(np.array(some), own[some[0]], np.array([jet[first[k] : first[k + 1]] for k in some]))
        for some in same.values()
    ]


def _of_rows(rows: ConstraintRows, label: np.ndarray, kind: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """What each component consists of: its rows, their numbers, and where the entries of the Jacobian stand."""
    order = np.argsort(label, kind="stable")
    start = pointers(label[order], int(label.max(initial=-1)) + 1)
    rank = np.empty(len(label), np.int64)
    rank[order] = np.arange(len(label)) - start[label[order]]
    numbers = [(label[row], _bits(value)) for row, value in rows.contents()]
    return [(label, kind), *numbers, (label[rows.row], rank[rows.row])]


def _of_wishes(
    wishes: Wishes, component: np.ndarray, jet: np.ndarray, first: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """What is wished of the unknowns of each component."""
    start = np.searchsorted(wishes.place, np.arange(int(jet.max(initial=-1)) + 2))
    own = ranges(start, jet)
    pair = np.repeat(np.arange(len(jet)), start[jet + 1] - start[jet])
    at = component[pair]
    values = wishes.level, wishes.rank, wishes.target, wishes.factor, wishes.offset
    return [(at, pair - first[at]), *((at, _bits(value[own])) for value in values)]


def _bits(value: np.ndarray) -> np.ndarray:
    return value.astype(float).view(np.int64)


def _keys(contents: list[tuple[np.ndarray, np.ndarray]], count: int) -> list[bytes]:
    """For each component what the lists say of it, and how much each says."""
    owner = np.concatenate([where for where, _ in contents])
    order = np.argsort(owner, kind="stable")
    start = pointers(owner[order], count).tolist()
    said = np.concatenate([what for _, what in contents])[order]
    lengths = np.stack([np.bincount(where, minlength=count) for where, _ in contents], axis=1)
    return [lengths[k].tobytes() + said[start[k] : start[k + 1]].tobytes() for k in range(count)]
