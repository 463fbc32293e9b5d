"""Residuals of the closures of loops along a run, in any formulation."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import needed_steps
from lmoc.ir.reduced import Invariants
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.observe.slices import Slice
from lmoc.numerics.plan.plan import Plan


def residuals(observer: Observer, times: np.ndarray, states: np.ndarray) -> tuple[float, float] | None:
    """Return the largest residuals of positions and of velocities; None where a scene has no closed loops.

    Parameters
    ----------
    times, states : (k,) s and (k, n)
    """
    own = observer.plan.reduced.invariants
    if own is None:
        return None
    part = observer.plan.once(_residuals)
    base = np.concatenate([observer.base, np.full(max(0, own.count - len(observer.base)), np.nan)])
    values = np.abs(observer.followed(part, base)(times, states))
    return tuple(float(values[:, own.stage == k].max(initial=0.0)) for k in (2, 1))  # type: ignore[return-value]


def _residuals(plan: Plan) -> Slice:
    own: Invariants = plan.reduced.invariants
    count = max(own.count, plan.count)
    return Slice(plan, own.residual, needed_steps(plan.full_program + own.program, own.residual, count), count)
