"""The layout of registers: their numbering, names of jets, and the recovery of every variable."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.expression.dag import Expr, add, mul, neg, slot
from lmoc.ir.normalized import Normalized
from lmoc.ir.program import Apply
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import INPUT, UNKNOWN
from lmoc.structure.linear.substitution import partition
from lmoc.support.distinct import distinct_rows
from lmoc.support.indices import INDEX, counted


class RegisterLayout:
    """Registers of roots, inputs and parameters: the jets of one variable stand side by side.

    Attributes
    ----------
    base : (extended,) register of order 0 of each extended variable
    width : (extended,) its number of jets; 0 for eliminated variables
    count : registers so far
    """

    def __init__(self, system: EquationSystem, d: np.ndarray, highest_input: np.ndarray):
        self.system = system
        width = np.ones(len(system.kind), np.int8)
        inputs = np.flatnonzero(highest_input >= 0)
        width[inputs] = highest_input[inputs] + 1
        width[system.kind == UNKNOWN] = 0
        width[system.variable] = d + 1
        self.width = width
        self.base = np.zeros(len(width), INDEX)
        np.cumsum(width[:-1], out=self.base[1:])
        self.count = int(width.sum(dtype=np.int64))

    @cached_property
    def jets(self) -> tuple[np.ndarray, np.ndarray]:
        """Extended variable and order of each register."""
        variable = np.repeat(counted(0, len(self.width)), self.width)
        return variable, counted(0, self.count) - np.repeat(self.base, self.width)

    def known_values(self, values: np.ndarray) -> np.ndarray:
        """Numbers for the registers of parameters, from those of extended variables (…, or …, runs); NaN elsewhere."""
        result = np.full((self.count, *values.shape[1:]), np.nan)
        single = self.system.kind < INPUT
        result[self.base[single]] = values[single]
        return result

    def inputs(self) -> np.ndarray:
        """(3, n): register, flat variable and order of each input jet."""
        variable, order = self.jets
        found = np.flatnonzero(self.system.kind[variable] == INPUT)
        return np.stack([found, variable[found], order[found]])

    def register_behind(self, variables: np.ndarray) -> np.ndarray:
        """Register of the root jet behind each flat variable."""
        n = self.system.normalized
        result: np.ndarray = self.base[n.root[variables]] + n.order[variables]
        return result


def names_of_jets(system: EquationSystem, layout: RegisterLayout) -> tuple[np.ndarray, np.ndarray]:
    """Flat variable and order by which a person knows each register; -1 for derived parameters.

    A derivative that has a name of its own goes by that: first by one of the same part (``mass.v`` for
    ``der(mass.q)``), then by one that is no connector's.
    """
    variable, order = layout.jets
    flat, n = system.flat, system.normalized
    variable, order = np.where(variable < flat.count, variable, -1), order.copy()
    exact = (n.factor == -1) & (n.offset == -1) & (n.order > 0) & (system.column[n.root] >= 0)
    found = np.flatnonzero(exact)
    if len(found):
        part = flat.per_variable(lambda b: b.part, INDEX)
        plain = flat.per_variable(lambda b: 2 * b.connector + b.protected, np.int8)
        register = layout.register_behind(found)
        rank = 4 * (part[found] != part[n.root[found]]) + plain[found]
        # the best name of each register is the least of these numbers that begin with it
        key = np.sort((register.astype(np.int64) << 3 | rank) << 31 | found)
        register = key >> 34
        first = np.ones(len(key), bool)
        first[1:] = register[1:] != register[:-1]
        variable[register[first]], order[register[first]] = key[first] & ((1 << 31) - 1), 0
    return variable, order


def way_back(
    system: EquationSystem, layout: RegisterLayout, helpers: int
) -> tuple[np.ndarray, list[Apply], np.ndarray]:
    """Return the register of each flat variable, and the steps that compute those which are not jets themselves.

    Parameters
    ----------
    helpers : how many registers have been used behind those of the layout

    Returns
    -------
    register_of : (flat.count,)
    steps : ``x = factor·root^(order) + offset``, equal ones once
    variable : the flat variable that names each of the new registers, which follow the helpers
    """
    n = system.normalized
    register_of = layout.base[n.root] + n.order
    moved = np.flatnonzero((n.factor != -1) | (n.offset != -1))
    if not len(moved):
        return register_of, [], moved
    table = np.stack([register_of[moved], n.factor[moved], n.offset[moved]], axis=1)
    first, number = distinct_rows(table)
    new = counted(layout.count + helpers, layout.count + helpers + len(first))
    register_of[moved] = new[number]
    steps = []
    table = table[first]
    pattern = np.stack([np.minimum(table[:, 1], 0), np.minimum(table[:, 2], 0)], axis=1)
    for (factor, offset), rows in partition(pattern):
        rows = np.arange(len(table)) if rows is None else rows
        columns = [table[rows, 0]]
        if factor == 0:
            columns.append(layout.base[table[rows, 1]])
        if offset == 0:
            columns.append(layout.base[table[rows, 2]])
        steps.append(Apply(_affine(factor, offset), np.stack(columns, axis=1), new[rows]))
    return register_of, steps, moved[first]


def _affine(factor: int, offset: int) -> Expr:
    """``factor·jet + offset``; 0 stands for a parameter, -1 for nothing, a factor -2 for -1."""
    value = slot(0) if factor == -1 else neg(slot(0)) if factor == -2 else mul(slot(1), slot(0))
    return value if offset < 0 else add(value, slot(2 if factor == 0 else 1))


def inverse_affine(factor: int, offset: int, value: Expr, columns: int) -> Expr:
    """The jet from the variable's value; factor and offset, where they are parameters, in further columns."""
    if offset == 0:
        value = value - slot(columns + (factor == 0))
    return value if factor == -1 else neg(value) if factor == -2 else value / slot(columns)


def pattern_of(n: Normalized, variables: np.ndarray) -> np.ndarray:
    """(n, 2) pairs as `_affine` wants them."""
    return np.stack([np.minimum(n.factor[variables], 0), np.minimum(n.offset[variables], 0)], axis=1)
