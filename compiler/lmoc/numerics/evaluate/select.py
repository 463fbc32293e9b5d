"""Which evaluation suits a plan.

Small explicit programs are casadi functions, large ones are compiled C where there is a compiler, and what neither
takes is run by numpy over groups of rows.
"""

from __future__ import annotations

from lmoc.numerics.evaluate.casadi_system import CASADI_ROWS, can_lower
from lmoc.numerics.evaluate.explicit_system import CasadiSystem
from lmoc.numerics.evaluate.segmented_system import SegmentedSystem
from lmoc.numerics.evaluate.segments import can_segment
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.evaluate.vector_system import VectorSystem
from lmoc.numerics.plan import Plan

COMPILED_ROWS = 2500  # programs with more rows are worth a call of the C compiler


def make_system(plan: Plan) -> System:
    """The way of evaluating that suits the size and the blocks of a plan."""
    if plan.row_count <= COMPILED_ROWS and not can_lower(plan.program) and can_segment(plan.program):
        return _small_implicit(plan)
    if plan.row_count > COMPILED_ROWS or (plan.has_large_blocks and not can_lower(plan.program)):
        from lmoc.numerics.evaluate.native.c_code import Unsupported
        from lmoc.numerics.evaluate.native.system import NativeSystem  # imported late: small scenes need no ctypes

        try:
            return NativeSystem(plan)
        except (Unsupported, OSError):  # a block that C does not take, or no compiler: the others give the same values
            pass
    if plan.row_count <= CASADI_ROWS and can_lower(plan.program):
        return CasadiSystem(plan)
    if plan.row_count <= CASADI_ROWS and can_segment(plan.program):
        return SegmentedSystem(plan)
    return VectorSystem(plan)


def _small_implicit(plan: Plan) -> System:
    from lmoc.numerics.evaluate.native.c_code import Unsupported
    from lmoc.numerics.evaluate.native.compiled_later import compiled_or

    try:
        return compiled_or(plan, SegmentedSystem)
    except (Unsupported, OSError):
        return SegmentedSystem(plan)
