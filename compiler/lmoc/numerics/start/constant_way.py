"""Whether the way from a simplified model to the actual one stays where it begins (`homotopy`, 3.7.4.4)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.expression.dag import Expr, slots
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import Group, Kind, Simplified
from lmoc.numerics.coordinates.change import RunState, values_at
from lmoc.numerics.observe.slices import signal_values

_SAME = 1e-9  # of the larger side of an equation: much below what a start is looked for with


def stays(simplified: Simplified, near: RunState, time: float) -> bool:
    """Return whether all equations hold with any weight where they hold with the simplified expressions.

    Most limiters do not limit at the start, and their simplified expressions say just that. The equations then hold at
    this place all along the way, which need not be walked.
    """
    flat, weight = simplified.flat, simplified.weight
    if flat.events is not None and any((table == weight).any() for table in _discrete(simplified)):
        return False
    groups = [g for g in (*flat.groups, *flat.initial_groups) if (g.slots == weight).any()]
    return all(_holds(g, weight, near, time) for g in groups)


def _discrete(simplified: Simplified) -> Iterator[np.ndarray]:
    """The variables that relations, and equations at events, read."""
    events = simplified.flat.events
    for tables in (events.relations, events.equations, events.start, events.reinits, events.terminations):
        yield from (table.slots for table in tables)


def _holds(group: Group, weight: int, near: RunState, time: float) -> bool:
    """Return whether both sides of the rows that read the weight are the same with any of it."""
    rows = group.slots[(group.slots == weight).any(axis=1)]
    leaves = {node.value for side in (group.left, group.right) for node in slots(side)}
    known = {(k, order): _values(near, rows[:, k], order, time) for k, order in leaves}

    def side(root: Expr, w: float) -> np.ndarray:
        def column(k: int, order: int) -> np.ndarray:
            return np.where(rows[:, k] == weight, w, known[k, order])

        return np.broadcast_to(np.asarray(evaluate(root, column, time), float), len(rows))

    first = np.stack([side(group.left, 0.0), side(group.right, 0.0)])
    size = np.abs(first).max(axis=0)
    for w in (0.5, 1.0):
        then = np.stack([side(group.left, w), side(group.right, w)])
        if not (np.abs(then - first) <= _SAME * size).all():  # what is not known is NaN, and not the same
            return False
    return True


def _values(near: RunState, variables: np.ndarray, order: int, time: float) -> np.ndarray:
    """Return what a column of variables is where the start is looked for; NaN where that is not known."""
    observer = near.observer
    found = values_at(observer, near.w, variables, np.full(len(variables), order))
    for k, variable in enumerate(variables.tolist()):
        kind, signal = observer.flat.kind[variable], observer.signals.get(variable)
        if kind in (Kind.PARAMETER, Kind.CONSTANT):
            found[k] = observer.values[variable] if order == 0 else 0.0
        elif kind == Kind.INPUT and signal is not None and order == 0:
            found[k] = signal_values(signal, np.array([time]), observer.values)[0]
    return found
