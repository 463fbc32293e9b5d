"""Solutions of the nonlinear blocks of a plan's program at many times, such as those of a run's output."""

from __future__ import annotations

import threading

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.engine.library import library
from lmoc.numerics.evaluate.engine_system import has_branches, plan_tape
from lmoc.numerics.plan.plan import Plan


class Observed:
    """A plan's program for many times at once; to be asked for by `Plan.once`.

    Attributes
    ----------
    unknowns : registers of the unknowns of its nonlinear blocks
    """

    def __init__(self, plan: Plan) -> None:
        self._kernel = Kernel(plan.once(plan_tape), not has_branches(plan))
        self._call, self._count = self._kernel.call(plan.states, plan.derivatives), plan.count
        self.unknowns = self._kernel.unknowns
        self._lock = threading.Lock()  # runs may be read from several threads

    def __call__(
        self, base: np.ndarray, times: np.ndarray, states: np.ndarray, guesses: np.ndarray, registers: np.ndarray
    ) -> np.ndarray | None:
        """Return the values (times, registers) of some unknowns; None where a block has no solution near its guess.

        Parameters
        ----------
        base : (plan.count,) registers that do not change
        guesses : (times, unknowns)
        """
        given = [np.ascontiguousarray(a, float) for a in (times, states, guesses)]
        chosen = np.ascontiguousarray(registers, np.int32)
        out, good = np.empty((len(times), len(chosen))), np.empty(len(times), np.uint8)
        addresses = [a.ctypes.data for a in (*given, chosen, out, good)]
        with self._lock:
            self._kernel.w[: self._count] = base
            self._kernel.forget()
            library().lmoc_evaluate_many(self._call.reference, len(times), *addresses[:3], len(chosen), *addresses[3:])
        return out if good.all() else None
