"""A program at points anywhere, for searches: where it rests, its derivatives there, the way from one to the next."""

from __future__ import annotations

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.ir.program import Program, written
from lmoc.lower.blocks import values_tape
from lmoc.numerics.evaluate.engine_system import Slopes, slopes
from lmoc.numerics.solve.interpreter import Interpreter


class AtPoints:
    """Runs a program by the engine, its nonlinear blocks near their last solution; by numpy where C finds none.

    Parameters
    ----------
    program, count : and the number of its registers
    sources, targets : registers that are given, and those whose derivatives are asked for
    patient : as of `Kernel`

    Attributes
    ----------
    w : (count,) registers; fill what is known, then `forget`
    """

    def __init__(
        self, program: Program, count: int, sources: np.ndarray, targets: np.ndarray, patient: bool = True
    ) -> None:
        self.program, self.sources, self.targets = program, sources, targets
        self._interpreter = Interpreter(program, count)
        self._kernel = Kernel(values_tape(program, count), patient)
        self._call = self._kernel.call(sources, targets)
        self._filled = np.concatenate([np.zeros(0, int), *(written(step) for step in program)])
        self._solution: np.ndarray | None = None  # of the nonlinear blocks, where they have been solved last
        self._slopes: tuple[Slopes, Kernel] | None = None
        self.w = self._kernel.w[:count]
        self.w[:] = np.nan

    def forget(self) -> None:
        """Let nonlinear blocks be solved from their first guess again, not from a point that is not meant."""
        self._interpreter.reset()
        self.w[self._filled] = np.nan
        self._kernel.forget()
        self._solution = None

    def run(self, given: np.ndarray, time: float) -> None:
        """Fill the registers for values (sources,); what cannot be computed becomes NaN."""
        w, unknowns = self.w, self._kernel.unknowns
        begin = w[unknowns] if self._solution is None else self._solution
        w[unknowns] = begin
        if not self._kernel.evaluate(self._call, time, given):
            w[self.sources], w[unknowns] = given, begin
            if self._solution is not None:
                self._interpreter.follower.begin_at(w)
            self._interpreter.run(w, time)
            if not np.isfinite(w[unknowns]).all():
                return
            self._call.solved = 0  # C goes on from what stands in the registers
        self._solution = w[unknowns]

    def derivatives(self, time: float) -> np.ndarray:
        """Return the derivatives (targets, sources) where it has run last."""
        if self._slopes is None:
            made = slopes(self.program, self.sources, self.targets, len(self.w))
            self._slopes = made, Kernel(made.tape)
        own, kernel = self._slopes
        kernel.w[: len(self.w)] = self.w
        kernel(time)
        found = kernel.results()
        if own.tape.blocks and not np.isfinite(found).all():
            found = own.jacobian.values(self.w, time)  # of a singular block: which unknowns it still determines
        dense = np.zeros((len(self.targets), len(self.sources)))
        dense[own.jacobian.rows, own.jacobian.columns] = found
        return dense
