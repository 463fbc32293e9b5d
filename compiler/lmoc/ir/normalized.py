"""The result of linear elimination: groups over root jets, and the recovery of every variable."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.ir.flat import Assignments, FlatDAE
from lmoc.ir.reduced import Guard
from lmoc.messages.diagnostics import Diagnostic
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class JetGroup:
    """Equations ``residual(slots[i]) = 0``; a leaf ``slot(k, n)`` is the n-th derivative of the variable in column k.

    `slots` holds extended variable indices: below ``flat.count`` a variable of the flat model (a root, an input, a
    parameter), from there on a derived parameter. Every column holds one kind. A group whose coefficients are zero for
    the present parameter values has been split off with a residual in which those terms no longer stand.

    Attributes
    ----------
    source : (n,) numbers of the flat equations the rows come from (`FlatDAE` groups in order, then the sums)
    """

    residual: Expr
    slots: np.ndarray  # (n, columns)
    source: np.ndarray  # (n,)

    @property
    def rows(self) -> int:
        return len(self.slots)


@dataclass(frozen=True, eq=False)
class LongSums:
    """``Σ coefficient[j]·variable[index[j]] = 0``: the connection sets too long to be worth a shape of their own."""

    start: np.ndarray  # (n+1,)
    index: np.ndarray  # (nnz,) extended variables, all unknown, order 0 of roots
    order: np.ndarray  # (nnz,) derivative order of each
    coefficient: np.ndarray  # (nnz,) numbers
    source: np.ndarray  # (n,) as in JetGroup

    @property
    def rows(self) -> int:
        return len(self.source)


@dataclass(frozen=True, eq=False)
class Normalized:
    """The flat model in root jets.

    Every unknown ``x`` of the flat model is ``factor·root^(order) + offset``. `root` may be an input, a parameter or
    a derived parameter (then x is known; what is constant has such a root alone: order 0, factor and offset -1).
    `factor` and `offset` are extended variables (constants, parameters or derived parameters) or -1 for 1 and 0;
    `factor` -2 is -1.

    Attributes
    ----------
    derived : Assignments whose targets are extended indices ``flat.count, …``; in order of use
    derived_values : values of the derived parameters for the present parameter values
    root, order, factor, offset : (flat.count,)
    groups, sums : what remains to be solved
    undetermined : flat variables on which a redundant loop leaves no unique answer; `groups` sets as many of their
        roots to zero as are needed for the others to follow
    near : roots, orders and values of jets at a place near the start that satisfies all constraints, those too that
        have been dropped because they follow from others; None where there are none
    """

    flat: FlatDAE
    values: np.ndarray
    derived: tuple[Assignments, ...]
    derived_values: np.ndarray
    root: np.ndarray
    order: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    groups: tuple[JetGroup, ...]
    sums: LongSums
    guards: tuple[Guard, ...] = ()
    notes: tuple[Diagnostic, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    undetermined: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    near: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    @cached_property
    def all_values(self) -> np.ndarray:
        """Values of all extended variables (NaN for unknowns and inputs)."""
        return np.concatenate([self.values, self.derived_values])

    @property
    def extended_count(self) -> int:
        return self.flat.count + len(self.derived_values)
