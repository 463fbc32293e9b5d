"""The rows of a group in the making, and the columns that its shape's slots stand for.

An equation in an array of parts, or in a `for`, is one group: its rows are the points of a *space*, whose axes are
the dimensions of the part's path and then one axis for each `for` index. A column is an array of positions within
one variable's array. All arrays align at their first axes: one with fewer axes is alike along the missing ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import prod

import numpy as np

from lmoc.expression.dag import Expr, slot
from lmoc.ir.flat import Kind
from lmoc.semantics.nodes.instance import Variable
from lmoc.support.records import dataclass

Index = int | np.ndarray


@lru_cache(maxsize=256)
def positions(dims: tuple[int, ...]) -> np.ndarray:
    """0, 1, 2, … in the given dimensions, row-major; shared, never written to."""
    result = np.arange(prod(dims)).reshape(dims)
    result.flags.writeable = False
    return result


def align(array: Index | float, axes: int):
    """The array with further axes of length 1 behind its own."""
    if not isinstance(array, np.ndarray) or array.ndim >= axes:
        return array
    return array.reshape(array.shape + (1,) * (axes - array.ndim))


@dataclass(frozen=True, eq=False)
class Space:
    """The rows of a group.

    Attributes
    ----------
    shape : lengths of its axes
    coordinates : for each dimension of the part's path, the position along it
    whole : every element of the part once, in order: the coordinates are the axes themselves
    """

    shape: tuple[int, ...]
    coordinates: tuple[Index, ...]
    whole: bool = True

    @property
    def rank(self) -> int:
        return len(self.shape)

    def with_axis(self, length: int) -> Space:
        """With one more axis, of a `for`."""
        return Space((*self.shape, length), self.coordinates, self.whole)

    def selected(self, rows: np.ndarray) -> Space:
        """The rows with these flat positions, as a space of one axis."""
        coordinates = tuple(self.pick(c, rows) for c in self.coordinates)
        return Space((len(rows),), coordinates, False)

    def pick(self, array: Index | float, rows: np.ndarray):
        """An array over this space at the given flat positions."""
        if not isinstance(array, np.ndarray):
            return array
        return np.broadcast_to(align(array, self.rank), self.shape).ravel()[rows]


@lru_cache(maxsize=256)
def whole_space(total: tuple[int, ...]) -> Space:
    """All elements of a part with these dimensions."""
    coordinates = tuple(np.arange(n).reshape((1,) * k + (n,)) for k, n in enumerate(total))
    return Space(total, coordinates)


@dataclass(frozen=True, eq=False, slots=True)
class Leaf:
    """A column: positions within a variable's array, or (where `variable` is None) plain numbers."""

    variable: Variable | None
    index: Index | float | np.ndarray


class Leaves:
    """The columns met so far; the same variable at the same positions is the same column.

    `smooth` is how often what decides without an event is continuously differentiable, as smooth() says, at least.
    """

    def __init__(self):
        self.items: list[Leaf] = []
        self.smooth: int | None = None  # nothing of the kind has been met
        self._number: dict[tuple, int] = {}

    def slot(self, variable: Variable | None, index: Index | float) -> Expr:
        """The slot that stands for these positions of a variable, or for these numbers."""
        key = (id(variable), _key(index))
        column = self._number.get(key)
        if column is None:
            column = self._number[key] = len(self.items)
            self.items.append(Leaf(variable, index))
        return slot(column)

    def __getitem__(self, column: int) -> Leaf:
        return self.items[column]

    def held(self, columns: Iterable[int]) -> list[int]:
        """Those of the columns that do not change between events."""
        variables = {k: self.items[k].variable for k in columns}
        return [k for k, v in variables.items() if v is None or v.known or v.kind == Kind.DISCRETE]


def _key(index):
    if not isinstance(index, np.ndarray):
        return index
    if not index.flags.writeable:  # a shared one: kept alive by its cache or by the leaf
        return id(index)
    return (index.shape, index.dtype.kind, index.tobytes())
