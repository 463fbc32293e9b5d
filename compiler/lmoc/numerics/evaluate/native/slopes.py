"""The Jacobian of a system in C, blocks included: what an implicit method asks for again and again."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.ir.program import Program, program_rows
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.evaluate.native.c_code import CFunction, Writer
from lmoc.numerics.evaluate.native.c_derivatives import sweep
from lmoc.numerics.evaluate.native.c_program import LITERAL_ROWS
from lmoc.numerics.evaluate.native.compiler import load_library
from lmoc.numerics.evaluate.native.kernel import Data, with_blocks


class Slopes:
    """Entries of ∂w[outputs]/∂w[inputs] from the registers as the program has left them."""

    def __init__(self, program: Program, jacobian: Jacobian, count: int) -> None:
        """
        Raises
        ------
        OSError
            There is no compiler.
        """
        literal = program_rows(program) <= LITERAL_ROWS
        writer = Writer(count, literal)
        found = sweep(writer, program, jacobian, values=False)
        found.copy("out", np.arange(len(jacobian.source)), jacobian.source)
        head = "void lmoc_slopes(double time, double *w, const int64_t *m, const void *const *tab, double *out) {"
        body = "\n".join("  " + line for line in writer.lines)
        text = with_blocks(f"{head}\n{body}\n  (void)time; (void)m; (void)tab; (void)w; (void)out;\n}}\n")
        library = load_library(text, "-O1" if literal else "-O2")  # without loops: as fast, compiled in half the time
        if library is None:
            raise OSError("no C compiler")
        self._call: Callable[..., None] = library.lmoc_slopes
        self._call.argtypes, self._call.restype = [ctypes.c_double, *[ctypes.c_void_p] * 4], None
        numbers = np.array(writer.numbers, np.int64)
        self._data = Data(CFunction(text, numbers, writer.tables, writer.scratch, [], writer.matrices, []))
        self._w, self._count = np.zeros(count + writer.scratch), count
        self._out = np.zeros(len(jacobian.source))

    def forget(self) -> None:
        """Have pivots reselected: parameters or start are others now."""
        self._data.forget()

    def __call__(self, w: np.ndarray, time: float) -> np.ndarray:
        """Return the entries in the order of the pattern; not finite where a block's matrix is singular."""
        self._w[: self._count] = w[: self._count]
        data = self._data.numbers.ctypes.data, self._data.pointers.ctypes.data
        self._call(time, self._w.ctypes.data, *data, self._out.ctypes.data)
        return self._out
