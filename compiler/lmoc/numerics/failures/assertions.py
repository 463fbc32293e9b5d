"""The model's assertions outside of `when`, watched while it runs.

The relations of a condition are functions of time that are looked at in every accepted step, and inside it, as those of
events are (`engine/c/roots.c`): an assertion that does not hold is noticed on whatever output times, and since when is
known to the last digits. One of level error ends the run there; of the others the first time and the duration are told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import numpy as np

from lmoc.expression.dag import Expr, neg, postorder, rebuild
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Check, FlatDAE
from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.following import Following
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status
from lmoc.support.records import dataclass

_RELATIONS = ("gt", "ge", "lt", "le")
_KINKED = ("abs", "max", "min")
_MOST_BRANCHES = 8

Array = np.ndarray
Values = Callable[[Array, Array], Array]


@dataclass(eq=False)
class _Watched:
    """One assertion with all its rows.

    Attributes
    ----------
    relations : what changes its sign where a relation in the condition changes
    place : (rows, columns) of its variables among all that are watched
    since : (rows,) s, since when it does not hold; NaN where it does
    first, broken : (rows,) s, when it has not held for the first time, NaN; and for how long until `since`
    """

    check: Check
    relations: tuple[Expr, ...]
    place: Array
    since: Array
    first: Array
    broken: Array = field(default_factory=lambda: np.zeros(0))

    def functions(self, values: Array, times: Array) -> list[Array]:
        """Return the root functions, (times, rows) each, for values (times, variables) of what is watched."""
        size = len(times), len(self.place)
        column = self._columns(values)
        return [np.broadcast_to(evaluate(r, column, times[:, None]), size) for r in self.relations]

    def holds(self, values: Array, t: float) -> Array:
        """Return which rows hold, (rows,), for values (1, variables); what has no value is not judged."""
        result = evaluate(self.check.condition, self._columns(values), np.array([[t]]))
        known = np.isfinite(values[0][self.place]).all(axis=1)
        return (np.broadcast_to(result, (1, len(self.place)))[0] != 0) | ~known

    def _columns(self, values: Array) -> Callable[[int, int], Array]:
        return lambda k, _: values[:, self.place[:, k]]

    def look(self, values: Array, t: float) -> bool:
        """Note which rows hold from a time on; return whether one does not any more."""
        holds = self.holds(values, t)
        begins, ends = ~holds & np.isnan(self.since), holds & ~np.isnan(self.since)
        self.broken[ends] += t - self.since[ends]
        self.since[ends] = np.nan
        self.since[begins] = t
        self.first[begins & np.isnan(self.first)] = t
        return bool(begins.any())


class Assertions:
    """The assertions of one run that depend on its motion.

    Attributes
    ----------
    failed : time, assertion and row of one of level error that does not hold; None so far
    """

    def __init__(self, flat: FlatDAE) -> None:
        own = [c for c in flat.checks if not c.at_events and c not in flat.constant_checks and len(c.slots)]
        self.flat = flat
        self.failed: tuple[float, Check, int] | None = None
        tables = [c.slots for c in own]
        self._variables = np.unique(np.concatenate([*(t.ravel() for t in tables), np.zeros(0, int)])).astype(int)
        self._watched = [_watched(c, np.searchsorted(self._variables, c.slots)) for c in own]
        self._values: Values | None = None

    def __bool__(self) -> bool:
        return bool(self._watched)

    @property
    def until(self) -> float:
        return np.inf

    @property
    def longest_step(self) -> float:
        return np.inf

    @property
    def ended(self) -> Status | None:
        """ASSERTION where one of level error does not hold."""
        return None if self.failed is None else Status.ASSERTION

    def watch(self, observer: Observer, t: float, x: Array) -> Roots:
        """Look at the beginning of a segment; return the functions of the relations, which only ask to look again."""
        follow = observer.is_implicit(self._variables)
        self._values = Following(observer, self._variables) if follow else observer.prepare(self._variables)
        self._look(t, x)
        count = sum(len(w.relations) * len(w.place) for w in self._watched)

        def values(times: Array, states: Array) -> Array:
            seen = self._values(times, states)
            return np.concatenate([f for w in self._watched for f in w.functions(seen, times)], axis=1)

        def reached(t: float, x: Array, which: Array, signs: Array) -> bool:
            self._look(t, x)
            return self.failed is not None

        return Roots(values, np.zeros(count), reached)

    def _look(self, t: float, x: Array) -> None:
        values = self._values(np.array([t]), x[None])
        for watched in self._watched:
            if watched.look(values, t) and watched.check.error and self.failed is None:
                self.failed = t, watched.check, int(np.nanargmax(watched.since))

    def reason(self) -> str:
        """Return why an assertion has ended the run."""
        return "" if self.failed is None else broken(self.flat, *self.failed[1:], self.failed[0])

    def tell(self, end: float, report: Report) -> None:
        """Report the assertions of level warning that have not held.

        Parameters
        ----------
        end : s, where the run has ended
        """
        for watched in self._watched:
            if watched.check.error or np.isnan(watched.first).all():
                continue
            row = int(np.nanargmin(watched.first))
            since = watched.since[row]
            length = watched.broken[row] + (0.0 if np.isnan(since) else end - since)
            message = self.flat.message_of(watched.check, row)
            text = f"{message} (from t = {watched.first[row]:.9g} s, for {length:.6g} s)"
            report.warning("W0551", text, watched.check.span)


def broken(flat: FlatDAE, check: Check, row: int, t: float) -> str:
    """Return the message of an assertion that does not hold from a time on."""
    place = f" ({check.span})" if check.span is not None else ""
    return f"an assertion does not hold at t = {t:.9g} s: {flat.message_of(check, row)}{place}"


def relations_of(check: Check) -> tuple[Expr, ...]:
    """Return smooth functions among whose zeros are the places where an assertion begins to hold, or ends."""
    found = [n.args[0] - n.args[1] for n in postorder(check.condition) if n.op in _RELATIONS]
    return tuple(dict.fromkeys(branch for zero in found for branch in smooth_branches(zero)))


def _watched(check: Check, place: Array) -> _Watched:
    rows = len(place)
    return _Watched(check, relations_of(check), place, np.full(rows, np.nan), np.full(rows, np.nan), np.zeros(rows))


def smooth_branches(zero: Expr) -> list[Expr]:
    """Return expressions without kinks among whose zeros are those of an expression: ``u - 1, -u - 1`` of ``|u| - 1``.

    Long steps follow what is smooth by few samples. Where there are too many branches, it is the expression itself.
    """
    found: list[dict[Expr, Expr]] = [{}]
    for node in postorder(zero):
        if node.op not in _KINKED:
            found = [new | {node: _rebuilt(node, new)} for new in found]
            continue
        found = [new | {node: branch} for new in found for branch in _branches(node, new)]
        if len(found) > _MOST_BRANCHES:
            return [zero]
    return [new[zero] for new in found]


def _rebuilt(node: Expr, new: dict[Expr, Expr]) -> Expr:
    return rebuild(node.op, tuple(new[a] for a in node.args)) if node.args else node


def _branches(node: Expr, new: dict[Expr, Expr]) -> tuple[Expr, ...]:
    own = tuple(new[a] for a in node.args)
    return (own[0], neg(own[0])) if node.op == "abs" else own
