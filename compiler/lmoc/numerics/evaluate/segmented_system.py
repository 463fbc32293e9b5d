"""Small systems with blocks that casadi does not solve: casadi functions between and inside the blocks."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate.lowered_derivatives import LoweredJacobian
from lmoc.numerics.evaluate.segments import SegmentedProgram
from lmoc.numerics.plan import Plan


class SegmentedSystem(LoweredJacobian):
    """A small program with blocks that casadi does not solve: casadi functions between and inside the blocks."""

    description = "casadi, blocks"

    def __init__(self, plan: Plan) -> None:
        self.segments = SegmentedProgram(plan.program, plan.count)
        super().__init__(plan)

    def _runner(self) -> SegmentedProgram:
        return self.segments

    @property
    def unknowns(self) -> np.ndarray:
        return self.segments.unknowns

    def determinants(self) -> np.ndarray:
        return self.segments.determinants()
