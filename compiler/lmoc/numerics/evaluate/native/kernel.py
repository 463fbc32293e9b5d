"""A program compiled to C, with its data: called from Python, or by SUNDIALS without Python in between."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.ir.program import Program, Solve, program_rows
from lmoc.numerics.evaluate.native.c_code import generate
from lmoc.numerics.evaluate.native.compiler import load_library
from lmoc.numerics.evaluate.native.prelude import CALLBACK, PRELUDE
from lmoc.numerics.integrate.sundials import sundials

_LONG = 20_000  # rows from which the compiler's time for -O3, twice that for -O2, is soon won back


class _Call(ctypes.Structure):
    _fields_ = [
        ("w", ctypes.c_void_p),
        ("m", ctypes.c_void_p),
        ("tab", ctypes.c_void_p),
        ("n", ctypes.c_int64),
        ("first_state", ctypes.c_int64),
        ("states", ctypes.c_void_p),
        ("derivatives", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
    ]


class Kernel:
    """A compiled program that owns its register vector.

    Attributes
    ----------
    w : (registers + scratch,) float
        Fill the known, input and state registers, then call.
    """

    def __init__(self, program: Program, registers: int) -> None:
        """
        Raises
        ------
        c_code.Unsupported
            Where the program has a block that is not written as C.
        OSError
            Where no compiler is at hand.
        """
        function = generate(program, registers)
        long = program_rows(program) > _LONG
        library = load_library(PRELUDE + function.text + CALLBACK, "-O3" if long else "-O2")
        if library is None:
            raise OSError("no C compiler")
        self.library = library
        self._run = library.lmoc_program
        self._run.restype = None
        self._run.argtypes = [ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
        self.w = np.zeros(registers + function.scratch)
        self._numbers, self._tables, self._factors = function.numbers, list(function.tables), function.factors
        self._pointers = np.array([t.ctypes.data for t in self._tables] or [0], np.uintp)

    def factorize(self, matrix: Callable[[Solve], object]) -> None:
        """Factorize the constant linear blocks for the parameter values that stand in `w`.

        Parameters
        ----------
        matrix : callable
            Gives the sparse matrix ∂residuals/∂unknowns of a Solve step.
        """
        for step, first in self._factors:
            for k, values in enumerate(_factors(matrix(step)), first):
                self._tables[k] = np.ascontiguousarray(values)
                self._pointers[k] = self._tables[k].ctypes.data

    def __call__(self, time: float) -> None:
        """Run the program on `w`."""
        self._run(time, self.w.ctypes.data, self._numbers.ctypes.data, self._pointers.ctypes.data)

    def call(self, states: np.ndarray, derivatives: np.ndarray) -> _Call:
        """What C functions need to evaluate derivatives; valid as long as the kernel lives."""
        tables = [np.ascontiguousarray(r, np.int32) for r in (states, derivatives)]
        contiguous = len(states) > 0 and (np.diff(states) == 1).all()
        call = _Call(
            self.w.ctypes.data,
            self._numbers.ctypes.data,
            self._pointers.ctypes.data,
            len(states),
            int(states[0]) if contiguous else -1,
            *(t.ctypes.data for t in tables),
            None,
        )
        call.tables = tables  # kept alive with it
        return call

    def callback(self, states: np.ndarray, derivatives: np.ndarray):
        """The right-hand side as SUNDIALS calls it, and what to hand it as user data."""
        self._call = self.call(states, derivatives)
        self._call.data = ctypes.cast(sundials.load().N_VGetArrayPointer, ctypes.c_void_p).value
        rhs = sundials.RHS(ctypes.cast(self.library.lmoc_rhs, ctypes.c_void_p).value)
        return rhs, ctypes.byref(self._call)


def _factors(matrix) -> list[np.ndarray]:
    """The eight tables that `lmoc_sparse_solve` reads; of a singular matrix such that the solution is no number."""
    from scipy.sparse.linalg import splu

    try:
        lu = splu(matrix.tocsc())
    except RuntimeError:  # exactly singular: whoever asks for the values reports them with their place
        n = np.arange(matrix.shape[0] + 1, dtype=np.int32)
        return [n, n[:-1], np.ones(len(n) - 1), n, n[:-1], np.full(len(n) - 1, np.nan), n[:-1], n[:-1]]
    tables: list[np.ndarray] = []
    for factor in (lu.L.tocsc(), lu.U.tocsc()):
        factor.sort_indices()  # the diagonal stands first in L and last in U
        tables += [factor.indptr.astype(np.int32), factor.indices.astype(np.int32), factor.data.astype(float)]
    return [*tables, lu.perm_r.astype(np.int32), lu.perm_c.astype(np.int32)]
