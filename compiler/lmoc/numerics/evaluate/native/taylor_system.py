"""A system whose states come as Taylor series."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.evaluate.native.kernel import Call, Data, Source, source_of
from lmoc.numerics.evaluate.native.series import LENGTH, TAYLOR, constant_registers, generate_series
from lmoc.numerics.evaluate.native.system import NativeSystem, has_branches
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
        self._fill, self._length = library.lmoc_taylor_series, library.lmoc_taylor_length
        self._step, self._values = library.lmoc_taylor_step, library.lmoc_taylor_values
        self._fill.argtypes, self._fill.restype = [pointer, real, pointer, pointer], ctypes.c_int
        self._length.argtypes, self._length.restype = [whole, whole, real, pointer, pointer], real
        self._step.argtypes, self._step.restype = [pointer, real, real, real, real, *[pointer] * 5], ctypes.c_int
        self._values.argtypes, self._values.restype = [whole, whole, whole, *[pointer] * 3], None
        self._reference, self._result = ctypes.byref(self._taylor), np.zeros(2)

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self._data.forget()

    def series(self, t: float, x: np.ndarray, order: int, out: np.ndarray) -> bool:
        """Write the coefficients of the states into `out`, (n, LENGTH); whether all of them are numbers."""
        self.evaluations += 1
        self._taylor.order = order
        return not self._fill(self._reference, t, x.ctypes.data, out.ctypes.data)

    def values(self, order: int, h: np.ndarray, series: np.ndarray) -> np.ndarray:
        """Return the states (k, n) at distances h from where a series begins."""
        h, out = np.ascontiguousarray(h), np.empty((len(h), self.n))
        self._values(self.n, order, len(h), h.ctypes.data, series.ctypes.data, out.ctypes.data)
        return out

    def length(self, order: int, rtol: float, atol: np.ndarray, series: np.ndarray) -> float:
        """Return the step after which the last term of a series is as large as the tolerances."""
        return self._length(self.n, order, rtol, atol.ctypes.data, series.ctypes.data)

    def step(self, t: float, end: float, h: float, rtol: float, arrays: Sequence[np.ndarray]) -> tuple[int, float, int]:
        """Make one step of at most h (``lmoc_taylor_step`` in `native.series`).

        Parameters
        ----------
        arrays : atol, the series, and what is filled: the states and the series at the end

        Returns
        -------
        What C returns, the time reached, and how many steps have been tried.
        """
        addresses = [a.ctypes.data for a in (*arrays, self._result)]
        found = self._step(self._reference, t, end, h, rtol, *addresses)
        reached, tries = self._result.tolist()
        self.evaluations += int(tries)
        return found, reached, int(tries)


def _source(plan: Plan) -> Source:
    own = source_of(plan.program, plan.count, has_branches(plan), blocks=True)
    constant = constant_registers(plan.program, plan.count, plan.states)
    further = generate_series(plan.program, plan.count, constant, plan.count + own.function.scratch)
    return Source(own.text + further.text + TAYLOR, own.optimization, own.function, further)
