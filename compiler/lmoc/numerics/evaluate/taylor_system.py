"""A system whose states come as Taylor series."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import library
from lmoc.lower.recurrences import NoSeries
from lmoc.lower.series import LENGTH, Series, series_of
from lmoc.lower.tape import Tape
from lmoc.numerics.evaluate.engine_system import EngineSystem, has_branches, plan_tape
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal


class _Series(ctypes.Structure):
    """``lmoc_series`` in ``engine/c/series.h``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("w", "start", "code", "source")],
        *[(name, ctypes.c_int64) for name in ("count", "clock")],
        *[(name, ctypes.c_void_p) for name in ("states", "derivatives", "of_register", "s")],
    ]


class WithSeries(ctypes.Structure):
    """``lmoc_taylor`` in ``engine/c/taylor.h``."""

    _fields_ = [("call", ctypes.POINTER(Call)), ("series", ctypes.POINTER(_Series)), ("order", ctypes.c_int64)]


class Walk(ctypes.Structure):
    """A walk of many steps (``lmoc_walk`` in ``engine/c/taylor.h``)."""

    _fields_ = [
        *[(name, ctypes.c_double) for name in ("time", "before", "end", "longest", "length", "rtol")],
        *[(name, ctypes.c_void_p) for name in ("atol", "q", "next", "x", "between")],
        *[(name, ctypes.c_int64) for name in ("steps", "most", "tries")],
        ("times", ctypes.c_void_p),
        ("out", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("outputs", "reached", "room")],
        ("hook", ctypes.c_void_p),
    ]


def plan_series(plan: Plan) -> Series | str:
    """Return the series of a plan, or why there is none; to be asked for by `Plan.once`."""
    if len(plan.sampled):
        return "an input has no formula"
    try:
        return series_of(plan.program, plan.count, plan.once(plan_tape).size, plan.states, plan.derivatives)
    except NoSeries as reason:
        return str(reason)


class TaylorSystem(EngineSystem):
    """The program, and the coefficients of order k of what it computes."""

    def __init__(self, plan: Plan) -> None:
        """
        Raises
        ------
        NoSeries
            The program has functions with kinks, sampled inputs, or blocks that have no series.
        """
        series = plan.once(plan_series)
        if isinstance(series, str):
            raise NoSeries(series)
        self._of = series
        super().__init__(plan)
        self._start = Kernel(series.start, w=self.kernel.w)
        self._coefficients = np.zeros((len(series.source), LENGTH))
        self._tables = tuple(series.of_register[r] for r in (plan.states, plan.derivatives))
        addresses = *self._start.addresses, series.code.ctypes.data, series.source.ctypes.data
        tables = (*self._tables, series.of_register, self._coefficients)
        own = _Series(*addresses, len(series.source), series.clock, *(t.ctypes.data for t in tables))
        self._taylor = WithSeries(ctypes.pointer(self._own), ctypes.pointer(own), 0)
        self._engine, self._reference = library(), ctypes.byref(self._taylor)

    def _kernel(self, tape: Tape) -> Kernel:
        return Kernel(tape, not has_branches(self.plan), np.zeros(self._of.start.size))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self._start.forget()

    def series(self, t: float, x: np.ndarray, order: int, out: int) -> bool:
        """Write the coefficients of the states to an address, (n, LENGTH); whether all of them are numbers."""
        self.evaluations += 1
        self._taylor.order = order
        return not self._engine.lmoc_taylor_series(self._reference, t, x.ctypes.data, out)

    def values(self, order: int, h: np.ndarray, series: int) -> np.ndarray:
        """Return the states (k, n) at distances h from where the series at an address begins."""
        h, out = np.ascontiguousarray(h), np.empty((len(h), self.n))
        self._engine.lmoc_taylor_values(self.n, order, len(h), h.ctypes.data, series, out.ctypes.data)
        return out

    def with_series(self, order: int) -> WithSeries:
        """Return what C needs for series of an order; valid as long as the system lives."""
        self._taylor.order = order
        return self._taylor

    @property
    def start_blocks(self) -> int:
        """Number of blocks behind the coefficients of order zero."""
        return len(self._of.start.blocks)

    @staticmethod
    def new_walk(end: float, longest: float, rtol: float) -> Walk:
        """Return a walk up to a time in steps no longer than that, at which nothing stands yet."""
        return Walk(end=end, longest=longest, rtol=rtol)

    def walk(self, walk: Walk) -> int:
        """Make steps with their output; returns what C does (``lmoc_taylor_walk`` in ``engine/c/taylor.c``)."""
        found = int(self._engine.lmoc_taylor_walk(self._reference, ctypes.byref(walk)))
        self.evaluations += walk.tries
        return found
