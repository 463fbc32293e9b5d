"""Legs of many runs of one scene in C: each with its own parameters, start, tolerances and steps (``c/lanes.c``)."""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.engine.kernel import Call
from lmoc.engine.library import library
from lmoc.numerics.evaluate.engine_stepper import EngineStepper, Steps
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.evaluate.taylor_system import SeriesInLanes, TapeInLanes, WithSeries
from lmoc.numerics.problem.status import Status

LEG = np.dtype(
    [
        *((name, float) for name in ("time", "rtol", "step", "shortest")),
        *((name, np.int64) for name in ("most", "overrun", "reached", "steps", "rejected", "found")),
    ]
)
FOUND = {
    0: Status.OK, 1: Status.COLLAPSED, 2: Status.NOT_FINITE, 4: Status.STIFF, 5: Status.TOO_MANY_STEPS,
    6: Status.CRAWLING,
}  # fmt: skip
_SEEN = 9_000  # steps of a leg up to which nobody looks whether they get on (`steps/loop.py`)


class _Lanes(ctypes.Structure):
    """``lanes`` in ``engine/c/lanes.c``."""

    _fields_ = [
        ("call", ctypes.POINTER(Call)),
        *[(name, ctypes.c_int64) for name in ("registers", "blocks", "start_blocks")],
        *[(name, ctypes.c_void_p) for name in ("base", "x", "atol", "legs")],
        *[(name, ctypes.c_double) for name in ("end", "longest", "patience")],
        *[(name, ctypes.c_int64) for name in ("goes_on", "seen")],
        ("times", ctypes.c_void_p),
        ("outputs", ctypes.c_int64),
        ("out", ctypes.c_void_p),
        ("apart", ctypes.c_int64),
        ("steps", ctypes.POINTER(Steps)),
        ("taylor", ctypes.POINTER(WithSeries)),
        ("memory", ctypes.c_void_p),
    ]


class Legs:
    """Runs of one scene under walk.

    Attributes
    ----------
    base : (runs, registers) what does not change during a run
    x : (runs, n) where each stands
    atol : (runs, n) absolute tolerances
    state : (runs,) of `LEG`: where each stands, what its next leg may take, and how the last one has ended
    out : (runs, times, n) states at the output times, for others to read
    """

    base: np.ndarray
    x: np.ndarray
    atol: np.ndarray
    state: np.ndarray
    times: np.ndarray
    out: np.ndarray

    def __init__(
        self, system: EngineSystem, base: np.ndarray, x: np.ndarray, begin: float, end: float, times: np.ndarray,
        out: np.ndarray, longest: float, patience: float, order: int | None = None, among: Legs | None = None,
    ) -> None:  # fmt: skip
        """
        Parameters
        ----------
        times : s, those of output behind the beginning
        order : of a Taylor series; None for DOP853
        among : legs of the same runs with another method: what is known of the runs is in one place
        """
        if among is None:
            self._stand_at_the_beginning(base, x, begin, times)
        else:
            self.base, self.x, self.times = among.base, among.x, among.times
            self.atol, self.state = among.atol, among.state
        self.out = out
        self._engine = library()
        arrays = [a.ctypes.data for a in (self.base, self.x, self.atol, self.state)]
        registers = base.shape[1], len(system.kernel.tape.blocks)
        span = end, longest, patience, 0, _SEEN, self.times.ctypes.data, len(times), out.ctypes.data
        span = *span, out.strides[0] // 8
        self._series: SeriesInLanes | None = None
        self._order = order or 0
        if order is None:
            self._stepper = EngineStepper(system)
            steps = self._stepper.steps()
            steps.x, steps.x_new = self._stepper.addresses
            self._tape = system.plan.once(TapeInLanes)
            rest = *registers, 0, *arrays, *span, ctypes.pointer(steps), None, self._tape.memory.ctypes.data
            self._lanes = _Lanes(ctypes.pointer(system.shared_call()), *rest)
            if self._tape.many is not None:
                self._at_once = _Lanes(ctypes.pointer(self._tape.call), *rest)
        else:
            own = system.plan.once(SeriesInLanes)
            blocks = base.shape[1], *own.blocks
            self._series, memory = own, own.memory.ctypes.data
            self._lanes = _Lanes(own.in_c.call, *blocks, *arrays, *span, None, ctypes.pointer(own.in_c), memory)

    def _stand_at_the_beginning(self, base: np.ndarray, x: np.ndarray, begin: float, times: np.ndarray) -> None:
        runs, n = x.shape
        self.base, self.x, self.times = np.ascontiguousarray(base), np.array(x), np.ascontiguousarray(times)
        self.atol, self.state = np.empty((runs, n)), np.zeros(runs, LEG)
        self.state["time"], self.state["step"] = begin, np.inf

    def walk(self, which: np.ndarray, goes_on: bool = False) -> None:
        """Make the next legs of some runs, each to where it ends.

        Parameters
        ----------
        goes_on : whether it is the run of the last call, whose blocks keep to their order of pivots
        """
        chosen = np.ascontiguousarray(which, np.int64)
        many, lanes = self._tape.many if self._series is None else self._series.many, self._lanes
        if many and self._series is None:
            lanes = self._at_once
        lanes.goes_on = goes_on
        if self._series is not None:  # which legs of other orders share
            self._series.in_c.order = self._order
        walk = many.walk if many else self._engine.lmoc_lanes_walk
        walk(ctypes.byref(lanes), len(chosen), chosen.ctypes.data)
        if self._series is not None:
            self._series.note_work(int(self.state["steps"][chosen].sum() + self.state["rejected"][chosen].sum()))

    def differences(self, which: np.ndarray, shift: np.ndarray, goes_on: bool = False) -> np.ndarray:
        """Return the Jacobians (k, n, n) where k of the runs stand, from states shifted by that (k, n).

        Parameters
        ----------
        goes_on : as in `walk`
        """
        chosen, shift = np.ascontiguousarray(which, np.int64), np.ascontiguousarray(shift)
        self._lanes.goes_on = goes_on
        found = np.empty((len(chosen), self.x.shape[1], self.x.shape[1]))
        self._engine.lmoc_lanes_differences(
            ctypes.byref(self._lanes), len(chosen), chosen.ctypes.data, shift.ctypes.data, found.ctypes.data
        )
        return found
