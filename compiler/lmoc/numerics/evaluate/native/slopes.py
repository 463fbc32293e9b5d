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
from lmoc.numerics.evaluate.native.compiler import Compilation, kept_library, load_library
from lmoc.numerics.evaluate.native.kernel import Data, with_blocks


class Slopes:
    """Entries of ∂w[outputs]/∂w[inputs] from the registers as the program has left them."""

    def __init__(self, program: Program, jacobian: Jacobian, count: int) -> None:
        """Write the text; nothing is compiled yet."""
        literal = program_rows(program) <= LITERAL_ROWS
        writer = Writer(count, literal)
        found = sweep(writer, program, jacobian, values=False)
        found.copy("out", np.arange(len(jacobian.source)), jacobian.source)
        head = "void lmoc_slopes(double time, double *w, const int64_t *m, const void *const *tab, double *out) {"
        body = "\n".join("  " + line for line in writer.lines)
        self._text = with_blocks(f"{head}\n{body}\n  (void)time; (void)m; (void)tab; (void)w; (void)out;\n}}\n")
        self._optimization = "-O1" if literal else "-O2"  # without loops: as fast, and compiled in half the time
        numbers = np.array(writer.numbers, np.int64)
        self._data = Data(CFunction(self._text, numbers, writer.tables, writer.scratch, [], writer.matrices, []))
        self._w, self._count = np.zeros(count + writer.scratch), count
        self._out = np.zeros(len(jacobian.source))
        self._compilation: Compilation | None = None
        self._call: Callable[..., None] | None = None
        self._take(kept_library(self._text, self._optimization))

    def compile(self) -> None:
        """Wait for the compiler.

        Raises
        ------
        OSError
            There is no compiler.
        """
        self._take(load_library(self._text, self._optimization))
        if self._call is None:
            raise OSError("no C compiler")

    def compile_later(self) -> None:
        """Have the text compiled while the run goes on."""
        self._compilation = Compilation(self._text, self._optimization)

    @property
    def ready(self) -> bool:
        """Return whether it can be called: it was in the cache, or is compiled by now."""
        if self._call is None and self._compilation is not None:
            self._take(self._compilation.library)
        return self._call is not None

    def _take(self, library: ctypes.CDLL | None) -> None:
        if library is not None:
            self._call = call = library.lmoc_slopes
            call.argtypes, call.restype = [ctypes.c_double, *[ctypes.c_void_p] * 4], None

    def __call__(self, w: np.ndarray, time: float) -> np.ndarray:
        """Return the entries in the order of the pattern; not finite where a block's matrix is singular."""
        assert self._call is not None
        self._w[: self._count] = w[: self._count]
        data = self._data.numbers.ctypes.data, self._data.pointers.ctypes.data
        self._call(time, self._w.ctypes.data, *data, self._out.ctypes.data)
        return self._out
