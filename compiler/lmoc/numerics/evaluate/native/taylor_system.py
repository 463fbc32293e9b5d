"""A system whose states come as Taylor series."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.evaluate.native.c_text import c_text
from lmoc.numerics.evaluate.native.kernel import Call, Data, Source, source_of
from lmoc.numerics.evaluate.native.series import LENGTH, generate_series
from lmoc.numerics.evaluate.native.system import NativeSystem, has_branches
from lmoc.numerics.evaluate.recurrences import constant_registers
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


class _Taylor(ctypes.Structure):
    _fields_ = [
        ("call", ctypes.POINTER(Call)),
        ("series", ctypes.c_void_p),
        ("m", ctypes.c_void_p),
        ("tab", ctypes.c_void_p),
        ("registers", ctypes.c_int64),
        ("order", ctypes.c_int64),
    ]


class Way(ctypes.Structure):
    """A way of many steps (``lmoc_way`` in `c/taylor.c`)."""

    _fields_ = [
        *[(name, ctypes.c_double) for name in ("time", "before", "end", "longest", "length", "rtol")],
        *[(name, ctypes.c_void_p) for name in ("atol", "q", "next", "x", "between")],
        *[(name, ctypes.c_int64) for name in ("steps", "most", "tries")],
        ("times", ctypes.c_void_p),
        ("out", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("outputs", "reached", "room")],
        ("hold", ctypes.c_void_p),
    ]


class TaylorSystem(NativeSystem):
    """The program, and the coefficients of order k of all its registers, in C."""

    def __init__(self, plan: Plan) -> None:
        """
        Raises
        ------
        native.c_code.Unsupported
            The program has functions with kinks, sampled inputs, or a block that has no series.
        OSError
            There is no compiler.
        """
        if len(plan.sampled):
            raise Unsupported("an input has no formula")
        source = _source(plan)
        super().__init__(plan, source)
        kernel, call = self.kernel, self.shared_call()
        self._data = Data(source.further)
        self._series = np.zeros((plan.count, LENGTH))
        data = (self._data.numbers.ctypes.data, self._data.pointers.ctypes.data)
        self._own = call
        self._taylor = _Taylor(ctypes.pointer(call), self._series.ctypes.data, *data, plan.count, 0)
        library, real, pointer, whole = kernel.library, ctypes.c_double, ctypes.c_void_p, ctypes.c_int64
        self._fill, self._walk, self._values = (
            library.lmoc_taylor_series, library.lmoc_taylor_walk, library.lmoc_taylor_values
        )  # fmt: skip
        self._fill.argtypes, self._fill.restype = [pointer, real, pointer, pointer], ctypes.c_int
        self._walk.argtypes, self._walk.restype = [pointer, pointer], ctypes.c_int
        self._values.argtypes, self._values.restype = [whole, whole, whole, *[pointer] * 3], None
        self._reference = ctypes.byref(self._taylor)

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self._data.forget()

    def series(self, t: float, x: np.ndarray, order: int, out: int) -> bool:
        """Write the coefficients of the states to an address, (n, LENGTH); whether all of them are numbers."""
        self.evaluations += 1
        self._taylor.order = order
        return not self._fill(self._reference, t, x.ctypes.data, out)

    def values(self, order: int, h: np.ndarray, series: int) -> np.ndarray:
        """Return the states (k, n) at distances h from where the series at an address begins."""
        h, out = np.ascontiguousarray(h), np.empty((len(h), self.n))
        self._values(self.n, order, len(h), h.ctypes.data, series, out.ctypes.data)
        return out

    @staticmethod
    def way(end: float, longest: float, rtol: float) -> Way:
        """Return a way up to a time in steps no longer than that, at which nothing stands yet."""
        return Way(end=end, longest=longest, rtol=rtol)

    def walk(self, way: Way) -> int:
        """Make steps with their output; returns what C does (``lmoc_taylor_walk`` in `c/taylor.c`)."""
        found = self._walk(self._reference, ctypes.byref(way))
        self.evaluations += way.tries
        return found


def _source(plan: Plan) -> Source:
    own = source_of(plan.program, plan.count, has_branches(plan), blocks=True)
    constant = constant_registers(plan.program, plan.count, plan.states)
    further = generate_series(plan.program, plan.count, constant, plan.count + own.function.scratch)
    optimization = "-O3" if own.optimization == "-O3" else "-O2"  # the text is longer, by which -O3 would be too slow
    return Source(own.text + further.text + c_text("taylor"), optimization, own.function, further)
