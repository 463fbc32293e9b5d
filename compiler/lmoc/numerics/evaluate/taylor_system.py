"""A system whose states come as Taylor series."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from lmoc.engine.accelerator import TapeAccelerator
from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import Many, address, at_once, library
from lmoc.engine.pieces import Passing
from lmoc.engine.series_text import SeriesAccelerator
from lmoc.ir.program import Program
from lmoc.lower.recurrences import NoSeries
from lmoc.lower.series import LENGTH, Series, series_of
from lmoc.lower.tape import Tape
from lmoc.numerics.evaluate.engine_system import EngineSystem, has_branches, plan_tape
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import Programs, System
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

STEP = 27  # numbers of a step of DOP853 for each state (``engine/c/lanes.c``)
_LARGEST = 20_000  # numbers of a run, of which there are as many as lanes in the cache


class _Series(ctypes.Structure):
    """``lmoc_series`` in ``engine/c/series.h``."""

    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("order", "open", "solve", "w", "start", "code", "source")],
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
        *[(name, ctypes.c_int64) for name in ("found", "begins")],
        *[(name, ctypes.c_double) for name in ("ahead", "begun", "shortest")],
        ("made", ctypes.c_int64),
    ]


@dataclass(frozen=True, eq=False)
class Written:
    """A program with its tape and its series, or why there is none.

    Attributes
    ----------
    inputs, outputs : registers of the states, and of their derivatives
    """

    program: Program
    inputs: np.ndarray
    outputs: np.ndarray
    accelerator: TapeAccelerator
    series: Series | str


def plan_series(plan: Plan) -> Series | str:
    """Return the series of a plan, or why there is none; to be asked for by `Plan.once`.

    Those of inputs by tables are given; one that Python gives has none (`has_series`).
    """
    given = np.concatenate([plan.states, plan.sampled])
    try:
        return series_of(plan.program, plan.count, plan.once(plan_tape).size, given, plan.derivatives)
    except NoSeries as reason:
        return str(reason)


def has_series(system: System) -> bool:
    """Return whether a system as it is prepared has a Taylor series."""
    return not system.python_inputs and isinstance(system.plan.once(plan_series), Series)


def _with_series(
    states: np.ndarray, derivatives: np.ndarray, series: Series, call: Call, start: Kernel, coefficients: np.ndarray,
    many: Many | None = None,
) -> WithSeries:  # fmt: skip
    """Return what C needs for a series, whose coefficients have that memory; of order 0 as yet.

    Parameters
    ----------
    states, derivatives : registers
    many : what takes several runs at a time
    """
    tables = [series.of_register[r] for r in (states, derivatives)]
    tables += [series.of_register, coefficients]
    addresses = *start.addresses, series.code.ctypes.data, series.source.ctypes.data
    functions = [getattr(many, k) if many else address(f"lmoc_series_{k}") for k in ("order", "open", "solve")]
    own = _Series(*functions, *addresses, len(series.source), series.clock, *(t.ctypes.data for t in tables))
    found = WithSeries(ctypes.pointer(call), ctypes.pointer(own), 0)
    found.kept = tables, start
    return found


class TapeInLanes:
    """The program of a plan for as many runs at a time as the engine has lanes.

    One at a time where a block is sparse, whose order of pivots is that of one run, or where a run fills the cache.

    Attributes
    ----------
    many : what takes them; None for one at a time
    call : what C needs where there are several
    memory : for the steps of that many runs with DOP853
    """

    def __init__(self, plan: Plan) -> None:
        tape, n = plan.once(plan_tape), len(plan.states)
        self.many = many = None if _goes_alone(tape.size, tape) else at_once()
        lanes = many.lanes if many else 1
        self.memory = _aligned(STEP * n * lanes)
        if many is not None:
            self._kept = Kernel(tape, w=_aligned(tape.size * lanes), many=many)
            self.call = self._kept.call(plan.states, plan.derivatives)


class SeriesInLanes:
    """The series of as many runs of a plan at a time as the engine has lanes, as of `TapeInLanes`.

    Attributes
    ----------
    many : what takes them; None for one at a time
    in_c : what C needs; its order is to be set
    memory : for the steps of that many runs
    blocks : behind the program, and behind the coefficients of order zero
    """

    def __init__(self, plan: Plan) -> None:
        series = plan.once(plan_series)
        assert isinstance(series, Series)
        tapes = plan.once(plan_tape), series.start
        self.many = many = None if _goes_alone(series.start.size, *tapes) else at_once()
        lanes, length = (many.lanes, many.length) if many else (1, LENGTH)
        w = _aligned(series.start.size * lanes)
        kernel, start = (Kernel(tape, w=w, many=many) for tape in tapes)
        call = kernel.call(plan.states, plan.derivatives)
        memory = _aligned(len(series.source) * length * lanes)
        self.in_c = _with_series(plan.states, plan.derivatives, series, call, start, memory, many)
        self.memory = _aligned((2 * length + 3) * len(plan.states) * lanes)
        self.blocks = len(kernel.tape.blocks), len(start.tape.blocks)
        self._kept = kernel
        self._lanes, self._accelerated = lanes, many is None
        self._accelerator = SeriesAccelerator(series.code, lanes, series.passing)

    def note_work(self, tried: int) -> None:
        """Take note of steps that have been tried, and go on with compiled code if it is there by now."""
        if self._accelerated:
            return
        self._accelerator.note(-(-tried // self._lanes))
        compiled = self._accelerator.library
        if compiled is not None:
            self.in_c.series.contents.order = ctypes.cast(compiled.lmoc_order, ctypes.c_void_p).value
            self._accelerated = True


def _goes_alone(size: int, *tapes: Tape) -> bool:
    return size > _LARGEST or any(b.pattern is not None for tape in tapes for b in tape.blocks)


def _aligned(count: int) -> np.ndarray:
    """Return zeros that begin where a line of the cache does."""
    found = np.zeros(count + 8)
    first = -found.ctypes.data // 8 % 8
    return found[first : first + count]


class TaylorSystem(EngineSystem):
    """The program, and the coefficients of order k of what it computes."""

    def __init__(self, plan: Plan, other: Written | None = None) -> None:
        """
        Parameters
        ----------
        other : a program in place of that of the plan

        Raises
        ------
        NoSeries
            The program has functions with kinks, or blocks that have no series.
        """
        series = plan.once(plan_series) if other is None else other.series
        if isinstance(series, str):
            raise NoSeries(series)
        self._of = series
        if other is None:
            super().__init__(plan)
        else:
            super().__init__(plan, other.program, other.inputs, other.outputs, other.accelerator)
        self._start = Kernel(series.start, w=self.kernel.w)
        memory = np.zeros((len(series.source), LENGTH))
        self._taylor = _with_series(self.inputs, self.outputs, series, self._own, self._start, memory)
        self._engine, self._reference = library(), ctypes.byref(self._taylor)

    def _kernel(self, tape: Tape) -> Kernel:
        return Kernel(tape, not has_branches(self.plan), np.zeros(self._of.start.size))

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self._start.forget()

    def programs(self) -> Programs:
        return *super().programs(), (self._start, None)

    def _follow_tables(self) -> None:
        super()._follow_tables()
        self._taylor.call = ctypes.pointer(self._own)

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

    @staticmethod
    def new_walk(end: float, longest: float, rtol: float) -> Walk:
        """Return a walk up to a time in steps no longer than that, at which nothing stands yet."""
        return Walk(end=end, longest=longest, rtol=rtol)

    def pass_kinks(self, walk: Walk, own: Passing) -> None:
        """Go on over kinks along a walk that stands at the end of a piece."""
        self._engine.lmoc_taylor_pass(self._reference, ctypes.byref(walk), ctypes.byref(own))
        self.evaluations += own.evaluations

    def walk(self, walk: Walk) -> int:
        """Make steps with their output; returns what C does (``lmoc_taylor_walk`` in ``engine/c/taylor.c``)."""
        found = int(self._engine.lmoc_taylor_walk(self._reference, ctypes.byref(walk)))
        self.evaluations += walk.tries
        return found
