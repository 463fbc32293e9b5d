"""Small systems with blocks that casadi does not solve: casadi functions between and inside the blocks."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate.segments import SegmentedProgram
from lmoc.numerics.evaluate.vector_system import VectorSystem
from lmoc.numerics.plan import Plan


class SegmentedSystem(VectorSystem):
    """A small program with blocks that casadi does not solve: casadi functions between and inside the blocks."""

    description = "casadi, blocks"

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.segments = SegmentedProgram(plan.program, plan.count)
        self._follow(self.segments)

    def restart(self) -> None:
        """Forget the solutions of blocks: the next evaluation is at the start again."""
        self.prepare(*self._given)

    @property
    def unknowns(self) -> np.ndarray:
        """One register of each instance of a nonlinear block."""
        return self.segments.unknowns

    def determinants(self) -> np.ndarray:
        """Of the Jacobians of the nonlinear blocks' instances, at the evaluation made last."""
        return self.segments.determinants()
