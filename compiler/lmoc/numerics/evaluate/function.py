"""Places of a tape as a function of time and states, with the inputs and parameters of a run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.engine.library import library
from lmoc.lower.tape import Tape
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal, sample


class TapeFunction:
    """A tape that is called with states.

    Parameters
    ----------
    tape : of registers of a plan, and perhaps of more
    places : where the results stand
    constant : inputs that stay as they are between events
    """

    def __init__(self, tape: Tape, plan: Plan, places: np.ndarray, constant: np.ndarray | None = None) -> None:
        self._kernel, self._plan = Kernel(tape), plan
        varying = np.ones(len(plan.sampled), bool) if constant is None else ~np.isin(plan.sampled, constant)
        self._sampled = plan.sampled[varying]
        self._signals = [plan.samplers[k] for k in np.flatnonzero(varying)]
        self._places = np.ascontiguousarray(places, np.int32)
        self._call = self._kernel.call(plan.states, plan.states, self._sampled)
        self._samplers: list[tuple[Signal, int]] = []

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers that do not change between events, and the inputs."""
        self._kernel.w[: len(base)] = base
        self._kernel.forget()
        self._samplers = [(signals[v], order) for v, order in self._signals]

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the results."""
        w = self._kernel.w
        w[self._plan.states] = x
        for register, (signal, order) in zip(self._sampled.tolist(), self._samplers, strict=True):
            w[register] = signal.value(t, order)
        self._kernel(t)
        return w[self._places]

    def many(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the results at several times, (times, size)."""
        inputs = [sample(signal, order, times)[:, None] for signal, order in self._samplers]
        given = np.ascontiguousarray(np.concatenate([states, *inputs], axis=1) if inputs else states, float)
        times, nothing = np.ascontiguousarray(times, float), np.zeros(0)
        out, good = np.empty((len(times), len(self._places))), np.empty(len(times), np.uint8)
        library().lmoc_many(
            self._call.reference, len(times), times.ctypes.data, given.ctypes.data, nothing.ctypes.data,
            len(self._places), self._places.ctypes.data, out.ctypes.data, good.ctypes.data,
        )  # fmt: skip
        return out
