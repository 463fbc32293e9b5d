"""Residuals of the equations between positions along a run, which may drift in some formulations."""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import Expr, slots
from lmoc.expression.evaluate import evaluate
from lmoc.run import Run
from lmoc.support.distinct import distinct

_TIMES = 25  # at which the equations are looked at
_VALUES = 2_000_000  # values looked at, where that allows fewer times


def constraint_residual(run: Run) -> float:
    """Return the largest |left - right| of the flat model's equations without derivatives, over the run.

    Each is relative to the largest sum of the magnitudes of its terms. Equations with values that are not known (forces
    that are not determined) are left out, and so are those that switch laws.
    """
    flat, switched = run.flat, run.reduced.switched
    groups = [g for g in flat.groups if not any(leaf.value[1] for e in (g.left, g.right) for leaf in slots(e))]
    if switched is not None:  # which the reduction has added to, to tell closed laws from open ones
        groups = [g for g in groups if not np.isin(g.slots, switched.closed).any()]
    if not groups or not len(run.time):
        return 0.0
    used = distinct(np.concatenate([g.slots.ravel() for g in groups]))
    count = max(2, min(_TIMES, _VALUES // max(1, len(used))))
    rows = np.unique(np.linspace(0, len(run.time) - 1, count).round().astype(int))
    values, times = run.values(used)[rows], run.time[rows, None]
    worst = 0.0
    for group in groups:
        columns = np.searchsorted(used, group.slots)

        def value(expression: Expr, columns: np.ndarray = columns) -> np.ndarray:
            found = evaluate(expression, lambda k, _: values[:, columns[:, k]], times)
            return np.broadcast_to(found, (len(rows), len(columns)))

        with np.errstate(all="ignore"):
            size = sum(np.abs(value(term)) for side in (group.left, group.right) for term in _terms(side))
            apart = np.abs(value(group.left) - value(group.right)).max(axis=0) / size.max(axis=0)
        worst = max(worst, float(np.nan_to_num(apart, nan=0.0, posinf=0.0).max(initial=0.0)))
    return worst


def _terms(expression: Expr) -> list[Expr]:
    """The additive terms of an expression."""
    if expression.op in ("add", "sub"):
        return _terms(expression.args[0]) + _terms(expression.args[1])
    return _terms(expression.args[0]) if expression.op == "neg" else [expression]
