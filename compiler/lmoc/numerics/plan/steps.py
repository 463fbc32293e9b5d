"""Inputs that step or bend although the equations hold derivatives of them."""

from __future__ import annotations

from collections.abc import Mapping

from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Formula, Signal, Table


def stepping_inputs(plan: Plan, signals: Mapping[int, Signal]) -> list[int]:
    """Return the inputs whose derivatives a plan has and whose signals jump or have kinks."""
    differentiated = {v for _, v, order in plan.reduced.inputs.T.tolist() if order >= 1}
    return sorted(v for v in differentiated if v in signals and _steps(signals[v]))


def _steps(signal: Signal) -> bool:
    if isinstance(signal, Table):
        return len(signal.jumps) > 0
    return isinstance(signal, Formula) and signal.kinked
