"""Choice of the evaluation of a plan: by the plan alone, so that the same run always has the same digits.

Small explicit programs are casadi functions. Large ones, and those with blocks that are solved at every evaluation, are
compiled C where there is a compiler: a run waits for it, and finds the library in the cache from then on. What neither
takes is run by numpy over groups of rows.
"""

from __future__ import annotations

from collections.abc import Mapping

from lmoc.ir.program import Program, Solve
from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, can_lower
from lmoc.numerics.evaluate.explicit_system import CasadiSystem
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal

COMPILED_ROWS = 2500  # programs with more rows are worth a call of the C compiler


def make_system(plan: Plan, signals: Mapping[int, Signal] | None = None) -> System:
    """Return the way of evaluating that suits the size and the blocks of a plan.

    Parameters
    ----------
    signals : of the inputs; with them a scene with laws may be evaluated by its free scene
    """
    if signals is not None and plan.reduced.free is not None and not can_lower(plan.program):
        from lmoc.numerics.laws.updated import UpdatedSystem, updatable

        update = updatable(plan, signals)
        if update is not None:
            return UpdatedSystem(plan, update)
    small = plan.reduced.switched is not None and plan.row_count <= COMPILED_ROWS and can_lower(plan.program)
    if small:  # of short pieces: what a compiler would take is not won back
        return CasadiSystem(plan)
    if plan.row_count > COMPILED_ROWS or has_varying_blocks(plan.program):
        from lmoc.numerics.evaluate.native.c_code import Unsupported

        try:
            from lmoc.numerics.evaluate.native.system import NativeSystem  # imported late: most scenes need no ctypes

            return NativeSystem(plan)
        except (Unsupported, OSError):  # a block that C does not take, or no compiler: the others give the same values
            pass
    return interpreted(plan)


def interpreted(plan: Plan) -> System:
    """Return the way of evaluating that suits a plan where nothing is compiled."""
    if plan.row_count <= CASADI_ROWS and can_lower(plan.program):
        return CasadiSystem(plan)
    # imported late: most scenes need none of them
    from lmoc.numerics.evaluate.segmented_system import SegmentedSystem
    from lmoc.numerics.evaluate.segments import can_segment
    from lmoc.numerics.evaluate.unrolled import UnrolledSystem, can_unroll
    from lmoc.numerics.evaluate.vector_system import VectorSystem

    if can_unroll(plan.program):
        return UnrolledSystem(plan)
    if plan.row_count <= CASADI_ROWS and can_segment(plan.program):
        return SegmentedSystem(plan)
    return VectorSystem(plan)


def has_varying_blocks(program: Program) -> bool:
    """Return whether something is solved at every evaluation, for which C is faster by much."""
    return any(isinstance(step, Solve) and not step.constant for step in program)
