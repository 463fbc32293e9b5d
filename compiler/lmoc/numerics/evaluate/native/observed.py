"""Solutions of the nonlinear blocks of a compiled program at many times, such as those of a run's output."""

from __future__ import annotations

import ctypes
import threading

import numpy as np

from lmoc.numerics.evaluate.native.kernel import Kernel
from lmoc.numerics.plan import Plan


class Compiled:
    """The compiled program of a plan, once it is there; to be asked for by `Plan.once`.

    Attributes
    ----------
    kernel : that integrates; None as long as nothing has been compiled
    """

    def __init__(self, plan: Plan) -> None:
        self.kernel: Kernel | None = None
        self._plan, self._observed = plan, None

    @property
    def observed(self) -> Observed | None:
        """Return the program on registers of its own; None where it takes more than states and parameters."""
        if self._observed is None and self.kernel is not None:
            if not len(self._plan.sampled) and not self.kernel.has_constant_blocks:
                self._observed = Observed(self._plan, self.kernel)
        return self._observed


class Observed:
    """A compiled program for many times at once.

    Attributes
    ----------
    unknowns : registers of the unknowns of its nonlinear blocks
    """

    def __init__(self, plan: Plan, compiled: Kernel) -> None:
        self._kernel = kernel = compiled.copy()
        self._call, self._count = kernel.call(plan.states, plan.derivatives), plan.count
        self.unknowns = kernel.unknowns
        self._many = kernel.library.lmoc_many
        whole, pointer = ctypes.c_int64, ctypes.c_void_p
        self._many.argtypes, self._many.restype = [pointer, whole, *[pointer] * 3, whole, *[pointer] * 3], None
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
            self._many(self._call.reference, len(times), *addresses[:3], len(chosen), *addresses[3:])
        return out if good.all() else None
