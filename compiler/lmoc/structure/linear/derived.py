"""Derived parameters: the factors and offsets of eliminated variables, computed once for each parameter set."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np

from lmoc.expression.dag import ONE, Expr, add, div, mul, neg, slot, sub
from lmoc.expression.text import to_text
from lmoc.ir.flat import Assignments
from lmoc.structure.linear.coefficients import renumbered, value_and_size
from lmoc.support.distinct import distinct_rows
from lmoc.support.indices import INDEX, counted

NONE = -1  # no factor (1), no offset (0)
DEEPEST_TEXT = 5  # derived parameters inside of each other that are written out


def derived_values(derived: Sequence[Assignments], values: np.ndarray) -> np.ndarray:
    """Values of all derived parameters for a parameter set.

    Parameters
    ----------
    derived : `Normalized.derived`
    values : (flat.count,) as `FlatDAE.parameter_values` gives them, or (flat.count, runs)
    """
    count = len(values)
    known = np.concatenate([values, np.full((sum(len(a.target) for a in derived), *values.shape[1:]), np.nan)])
    for a in derived:
        known[a.target] = a.values(known)
    return known[count:]


class DerivedParameters:
    """Collects derived parameters while elimination goes on; equal ones made together are made once."""

    def __init__(self, values: np.ndarray):
        self.base = len(values)
        self.count = len(values)
        self.assignments: list[Assignments] = []
        self._firsts: list[int] = []
        self._known = values.copy()
        self._sizes = np.zeros(0)  # of the derived parameters
        self._inverse = np.zeros(0, INDEX)  # of a derived parameter made as 1/c: c
        self._made: dict[tuple[Expr, bytes], np.ndarray] = {}

    @property
    def known(self) -> np.ndarray:
        """Values of all extended variables so far."""
        return self._known[: self.count]

    def sizes(self, known: np.ndarray, table: np.ndarray) -> np.ndarray:
        """Return the magnitudes of the terms that extended variables are made of: what their roundoff is measured by.

        Parameters
        ----------
        known : values of all extended variables, (count,) or (count, runs)
        table : which of them, an array of any shape
        """
        if known.base is self._known:  # the present values: needed in every pass
            return self._sizes_at(self._sizes, known, table)
        made = np.zeros((max(len(known) - self.base, 0), *known.shape[1:]))
        for a in self.assignments if len(made) else ():
            sizes = self._sizes_at(made, known, a.slots)
            _, made[a.target - self.base] = value_and_size(a.shape, known[a.slots], sizes)
        return self._sizes_at(made, known, table)

    def _sizes_at(self, made: np.ndarray, known: np.ndarray, table: np.ndarray) -> np.ndarray:
        sizes = np.abs(known[table])
        derived = table >= self.base
        if derived.any():
            sizes[derived] = made[table[derived] - self.base]
        result: np.ndarray = sizes
        return result

    def define(self, shape: Expr, slots: np.ndarray) -> np.ndarray:
        """Indices of parameters ``shape(slots[i])``, made where they are not there yet.

        A shape that is one parameter gives that parameter itself; rows that agree share one.
        """
        shape, columns = renumbered(shape)
        used = slots[:, list(columns)]
        shape, used = self._without_double_inverse(shape, used)
        if shape.op == "slot":
            return used[:, 0]
        if len(used) <= 16 or not columns:
            return self._define_few(shape, used)
        first, number = distinct_rows(used)
        result: np.ndarray = self._append(shape, used[first])[number]
        return result

    def _define_few(self, shape: Expr, used: np.ndarray) -> np.ndarray:
        keys = [(shape, *row) for row in used.tolist()]
        fresh = [k for k in dict.fromkeys(keys) if k not in self._made]
        if fresh:
            table = np.array([k[1:] for k in fresh], INDEX).reshape(len(fresh), used.shape[1])
            self._made.update(zip(fresh, self._append(shape, table).tolist(), strict=True))
        return np.array([self._made[k] for k in keys], INDEX)

    def _without_double_inverse(self, shape: Expr, used: np.ndarray) -> tuple[Expr, np.ndarray]:
        """``a/b`` as ``a*c`` where b has been made as ``1/c``."""
        if shape.op != "div" or shape.args[1].op != "slot" or self.count == self.base:
            return shape, used
        column = shape.args[1].value[0]
        if (used[:, column] < self.base).any():
            return shape, used
        inner = self._inverse[used[:, column] - self.base]
        if (inner < 0).any():
            return shape, used
        used = used.copy()
        used[:, column] = inner
        shape, columns = renumbered(mul(shape.args[0], slot(column)))
        return shape, used[:, list(columns)]

    def _append(self, shape: Expr, slots: np.ndarray) -> np.ndarray:
        target = counted(self.count, self.count + len(slots))
        made = self.count - self.base
        if target[-1] >= len(self._known):
            more = len(slots) + made // 2 + self.base // 16 + 64
            self._known = np.concatenate([self.known, np.full(more, np.nan)])
            self._sizes = np.concatenate([self._sizes[:made], np.full(more, np.nan)])
            self._inverse = np.concatenate([self._inverse[:made], np.full(more, NONE, INDEX)])
        known, rows = self._known, slice(made, made + len(slots))
        known[target], self._sizes[rows] = value_and_size(shape, known[slots], self.sizes(self.known, slots))
        if shape is _INVERSE:
            self._inverse[rows] = slots[:, 0]
        self.count += len(slots)
        self.assignments.append(Assignments(target, shape, slots))
        self._firsts.append(int(target[0]))
        return target

    def finish(self) -> None:
        """Release what is needed only while parameters are made; guards keep this object as long as the reduction."""
        self._known = self._sizes = np.zeros(0)
        self._inverse = np.zeros(0, INDEX)
        self._made.clear()

    def extended(self, values: np.ndarray) -> np.ndarray:
        """All extended variables for another parameter set; the variables that a switched form adds have no value."""
        values = np.concatenate([values, np.full((self.base - len(values), *values.shape[1:]), np.nan)])
        return np.concatenate([values, derived_values(self.assignments, values)])

    def text(self, index: int, name: Callable[[int], str], depth: int = DEEPEST_TEXT) -> str:
        """An extended variable in the user's names; the ratio of a long train of gears is cut short."""
        if index < self.base:
            return name(index)
        if not depth:
            return "…"
        a = self.assignments[bisect_right(self._firsts, index) - 1]
        row = a.slots[index - int(a.target[0])].tolist()
        text = to_text(a.shape, lambda k, _: self.text(row[k], name, depth - 1))
        return text if a.shape.op == "slot" or not a.shape.args else f"({text})"

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Indices of a·b, with -1 for a factor 1."""
        result = np.where(a < 0, b, a)
        both = (a >= 0) & (b >= 0)
        if both.any():
            result[both] = self.define(_PRODUCT, np.stack([a[both], b[both]], axis=1))
        return result

    def negative(self, a: np.ndarray) -> np.ndarray:
        return self.define(_NEGATIVE, a[:, None])

    def shifted(
        self, sign: np.ndarray, factor: np.ndarray, inner: np.ndarray, outer_sign: np.ndarray, outer: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """``sign·factor·inner + outer_sign·outer`` as (sign, index); inner and outer may be absent, factor 1."""
        new_sign, index = np.where(inner < 0, outer_sign, sign), np.where(inner < 0, outer, inner)
        case = (outer >= 0) * (np.int8(2) + (sign < 0) * np.int8(4) + (outer_sign < 0) * np.int8(8))
        case = (inner >= 0) * ((factor >= 0) + case)
        for c in range(1, 16):
            rows = np.flatnonzero(case == c)
            if not len(rows):
                continue
            table = np.stack([inner[rows], factor[rows], outer[rows]], axis=1)
            shape, flip = _SHIFTS[c]
            index[rows] = self.define(shape, table)
            new_sign[rows] = flip if c & 2 else sign[rows]
        return new_sign, index


_PRODUCT = mul(slot(0), slot(1))
_NEGATIVE = neg(slot(0))
_INVERSE = div(ONE, slot(0))


def _shift(case: int) -> tuple[Expr, int]:
    term = mul(slot(1), slot(0)) if case & 1 else slot(0)
    if not case & 2:
        return term, 1
    negative, outer_negative = bool(case & 4), bool(case & 8)
    if negative and outer_negative:
        return add(slot(2), term), -1
    if negative:
        return sub(slot(2), term), 1
    return (sub(term, slot(2)) if outer_negative else add(slot(2), term)), 1


_SHIFTS = {case: _shift(case) for case in range(1, 16)}
