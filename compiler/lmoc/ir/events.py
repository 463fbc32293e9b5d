"""Events of a flat model: relations, discrete equations, whens.

Discrete variables (`Kind.DISCRETE`) are slots that change between two steps only. Everything here is tables of indices
of flat variables, as in `lmoc.ir.flat`; shapes use slots of order 0 only. The meaning is that of the Modelica
specification 3.6, 8.5, 8.6 and appendix B: with the values ``pre(v)`` fixed, all equations are solved for the values v,
and again with ``pre(v) := v`` until nothing changes.
"""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.messages.source import Span
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Relations:
    """``target[i] := zero(slots[i]) > 0``, ``≥ 0``, or ``floor(zero(slots[i]))``, kept from one event to the next.

    Attributes
    ----------
    op : "gt", "ge" or "floor"
    zero : the function whose sign decides (of "floor": that is rounded down)
    slots : (n, columns)
    target : (n,) discrete variables
    text, span : what was written, and the equation
    of_package : it stands in the text of a package that the model only uses: where the run begins it is what it is then
        (Modelica's specification, 8.6); one of a scene may be what it was before, so that a step there is one
    """

    op: str
    zero: Expr
    slots: np.ndarray
    target: np.ndarray
    text: str
    span: Span | None
    of_package: bool = False

    @property
    def rows(self) -> int:
        return len(self.target)


@dataclass(frozen=True, eq=False)
class Assigned:
    """``left(slots[i]) = right(slots[i])``, an equation between discrete variables, solved at events.

    Attributes
    ----------
    fixed : the left side is the variable that it determines: an assignment in a `when`
    """

    left: Expr
    right: Expr
    slots: np.ndarray
    span: Span | None
    part: int
    fixed: bool

    @property
    def rows(self) -> int:
        return len(self.slots)


@dataclass(frozen=True, eq=False)
class Samples:
    """``target[i]`` is true at the instants ``start[i] + k·interval[i]``: variables that do not change.

    They are known before the run, or follow from parameters that the equations of the start determine.
    """

    target: np.ndarray
    start: np.ndarray
    interval: np.ndarray
    span: Span | None


@dataclass(frozen=True, eq=False)
class Reinits:
    """``variable[i] := value(slots[i])`` where ``guard[i]`` is true in an event iteration."""

    guard: np.ndarray
    target: np.ndarray
    value: Expr
    slots: np.ndarray
    span: Span


@dataclass(frozen=True, eq=False)
class Whens:
    """Branches of when-equations; ``active[i]`` is true in the event iteration in which one is carried out."""

    active: np.ndarray
    text: str  # the condition
    part: int
    span: Span


@dataclass(frozen=True, eq=False)
class Terminations:
    """The run ends with a message where ``guard(slots[i])`` is true at an event."""

    guard: Expr
    slots: np.ndarray
    message: str
    span: Span


@dataclass(frozen=True, eq=False)
class Events:
    """The hybrid part of a flat model.

    Attributes
    ----------
    discrete : (k,) discrete variables
    before : (2, m) rows: a variable (also a continuous one), and the discrete one that holds its value before the
        event; set in this order, the value before of ``pre(v)`` ahead of ``pre(v)`` itself
    equations, start : between discrete variables, at all events and at the start only
    written : the groups of the flat model with the relations as they are written, not as discrete variables
    initial, terminal : discrete variables that are true while the start, the end is computed; -1 where not used
    """

    discrete: np.ndarray
    before: np.ndarray
    relations: tuple[Relations, ...]
    equations: tuple[Assigned, ...]
    start: tuple[Assigned, ...]
    samples: tuple[Samples, ...]
    reinits: tuple[Reinits, ...]
    whens: tuple[Whens, ...]
    terminations: tuple[Terminations, ...]
    written: tuple[Any, ...] = field(default=(), repr=False)

    def clocks(self) -> np.ndarray:
        """Return the variables that say when samples are."""
        return np.concatenate([np.zeros(0, int), *(column for s in self.samples for column in (s.start, s.interval))])
    initial: int = -1
    terminal: int = -1

    @property
    def read(self) -> np.ndarray:
        """The variables that discrete equations and relations read, and that `reinit` sets."""
        rows: tuple[Any, ...] = (*self.relations, *self.equations, *self.reinits, *self.terminations)
        tables = [r.slots for r in rows]
        found = [self.before[0], *(t.ravel() for t in tables), *(r.target for r in self.reinits)]
        return np.unique(np.concatenate(found)).astype(int)
