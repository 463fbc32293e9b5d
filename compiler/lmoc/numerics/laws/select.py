"""The evaluation of a plan: by the engine, or a scene with laws by its free scene."""

from __future__ import annotations

from collections.abc import Mapping

from lmoc.numerics.evaluate.casadi_system import can_lower
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal


def make_system(plan: Plan, signals: Mapping[int, Signal] | None = None) -> System:
    """Return what evaluates a plan.

    Parameters
    ----------
    signals : of the inputs; with them a scene with laws may be evaluated by its free scene
    """
    if signals is not None and plan.reduced.free is not None and not can_lower(plan.program):
        from lmoc.numerics.laws.delassus_update import DelassusUpdate, updatable

        update = updatable(plan, signals)
        if update is not None:
            return DelassusUpdate(plan, update)
    return EngineSystem(plan)
