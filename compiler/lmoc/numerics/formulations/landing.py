"""The way back onto the closures of loops in C, and the watch over their rank: between many steps without Python.

The same projection as in `manifold`, and a sharper condition of the way from one place to the next: matrices change by
less than the smallest singular values at both ends, so that none between them loses its rank (Weyl), and closures do
not turn round. What does not satisfy it is left to Python, which looks at it closely.
"""

from __future__ import annotations

import ctypes
from functools import partial

import numpy as np

from lmoc.ir.program import program_rows
from lmoc.numerics.evaluate.native.c_code import CFunction, Unsupported, Writer
from lmoc.numerics.evaluate.native.c_derivatives import sweep
from lmoc.numerics.evaluate.native.c_program import LITERAL_ROWS
from lmoc.numerics.evaluate.native.c_text import c_text
from lmoc.numerics.evaluate.native.compiler import load_library
from lmoc.numerics.evaluate.native.kernel import Data, Hold
from lmoc.numerics.formulations.closing import Closing, Loops, Stage, closing
from lmoc.numerics.plan import Plan

_PIECES = 16  # into which the way of a Taylor step may be divided, where its ends alone do not tell enough


class _Loops(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("loops", "m", "n", "entries")],
        *[(name, ctypes.c_void_p) for name in ("rows", "columns", "source", "place")],
        *[(name, ctypes.c_void_p) for name in ("sizes", "kept", "last", "now", "margins", "work")],
    ]


class _Stage(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("residuals", "entries", "groups")],
        ("group", ctypes.POINTER(_Loops)),
        ("out", ctypes.c_void_p),
    ]


class _Closures(ctypes.Structure):
    _fields_ = [
        *[(name, ctypes.c_void_p) for name in ("w", "m", "tab")],
        ("n", ctypes.c_int64),
        ("stages", ctypes.c_int64),
        ("states", ctypes.c_void_p),
        ("scale", ctypes.c_void_p),
        ("stage", ctypes.POINTER(_Stage)),
        ("found", ctypes.c_double * 2),
        ("largest", ctypes.c_double * 2),
    ]


def landing(plan: Plan, base: np.ndarray, scale: np.ndarray) -> Landing | None:
    """Return the closures of a plan in C; None where they cannot be compiled.

    Parameters
    ----------
    base : registers that do not change during a run, with room for those of the residuals
    scale : (n,) sizes of the states
    """
    compiled = plan.once(_compiled)
    return None if compiled is None else Landing(plan, compiled, base, scale)


class Landing:
    """The closures of one run.

    Attributes
    ----------
    address : of what steps in C call (``lmoc_hold`` in `native/c/hold.c`)
    """

    def __init__(self, plan: Plan, compiled: _Compiled, base: np.ndarray, scale: np.ndarray) -> None:
        self._kept: list[object] = [compiled]  # what C points to
        own, library = plan.once(closing), compiled.library
        w = np.concatenate([base, np.zeros(compiled.scratch)])
        stages = (_Stage * len(own.stages))(*(self._stage(s) for s in own.stages))
        self._kept.append(stages)
        self._closures = _Closures(
            self._at(w), self._at(compiled.data.numbers), self._at(compiled.data.pointers),
            len(plan.states), len(stages), self._at(np.ascontiguousarray(plan.states, np.int32)),
            self._at(np.ascontiguousarray(scale, float)), stages,
        )  # fmt: skip
        reference = ctypes.cast(ctypes.pointer(self._closures), ctypes.c_void_p)
        functions = (library.lmoc_look, library.lmoc_land, library.lmoc_keep)
        self._hold = Hold(reference, *(ctypes.cast(f, ctypes.c_void_p) for f in functions), _PIECES)
        self._look, self._many, self._keep = (
            partial(f, reference) for f in (library.lmoc_look, library.lmoc_land_many, library.lmoc_keep)
        )
        self.address = ctypes.addressof(self._hold)

    @property
    def residuals(self) -> tuple[float, float]:
        """Return the largest residuals of positions and of velocities at the ends of steps."""
        first, second = self._closures.largest
        return (first, second) if self._closures.stages > 1 else (0.0, first)

    def begin(self, t: float, x: np.ndarray) -> bool:
        """Take a place for the end of a step; whether the closures are far from depending on each other there."""
        if self._look(t, x.ctypes.data, -1):
            return False
        self._keep()
        return True

    def follows(self, t: float, x: np.ndarray) -> bool:
        """Return whether the closures keep their rank from the end of the last step to another place."""
        if self._look(t, x.ctypes.data, 1):
            return False
        self._keep()
        return True

    def land(self, times: np.ndarray, states: np.ndarray) -> bool:
        """Move states (k, n) onto the closures; whether that is a short way for each of them."""
        times = np.ascontiguousarray(times, float)
        return not self._many(len(times), times.ctypes.data, states.ctypes.data)

    def _stage(self, stage: Stage) -> _Stage:
        groups = (_Loops * len(stage.loops))(*map(self._loops, stage.loops))
        residuals, entries = len(stage.residual), len(stage.jacobian.source)
        self._kept.append(groups)
        return _Stage(residuals, entries, len(groups), groups, self._at(np.zeros(entries + residuals)))

    def _loops(self, own: Loops) -> _Loops:
        (loops, m), n = own.rows.shape, own.columns.shape[1]
        loop, i, j = own.place
        tables = own.rows, own.columns, own.entry, (loop * m + i) * n + j
        size = loops * m * n
        rooms = np.full(loops * m, 1e-300), *np.zeros((3, size)), np.zeros(3 * loops), np.zeros(m * m + 2 * m)
        return _Loops(
            loops, m, n, len(own.entry),
            *(self._at(np.ascontiguousarray(t, np.int32)) for t in tables),
            *(self._at(np.ascontiguousarray(r)) for r in rooms),
        )  # fmt: skip

    def _at(self, values: np.ndarray) -> int:
        self._kept.append(values)
        return values.ctypes.data


class _Compiled:
    """The compiled closures of a plan, and their data."""

    def __init__(self, plan: Plan) -> None:
        """
        Raises
        ------
        Unsupported
            A closure needs a block, or an input without a formula.
        OSError
            There is no compiler.
        """
        own: Closing = plan.once(closing)
        if len(plan.sampled):
            raise Unsupported("an input has no formula")
        writer = Writer(own.count, program_rows(own.program) <= LITERAL_ROWS)
        text = c_text("prelude") + "".join(_function(writer, k, stage) for k, stage in enumerate(own.stages))
        calls = "".join(f"  if (k == {k}) lmoc_closing_{k}(time, w, m, tab, out);\n" for k in range(len(own.stages)))
        text += f"static void lmoc_closing(int64_t k, {_ARGUMENTS}) {{\n{calls}}}\n" + c_text("landing")
        library = load_library(text)
        if library is None:
            raise OSError("no C compiler")
        self.library, self.scratch = library, writer.scratch
        numbers = np.array(writer.numbers, np.int64)
        self.data = Data(CFunction(text, numbers, writer.tables, writer.scratch, [], writer.matrices, []))
        pointer, real, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
        library.lmoc_look.argtypes, library.lmoc_look.restype = [pointer, real, pointer, whole], whole
        library.lmoc_land_many.argtypes = [pointer, ctypes.c_int64, pointer, pointer]
        library.lmoc_land_many.restype = whole
        library.lmoc_keep.argtypes, library.lmoc_keep.restype = [pointer], None


_ARGUMENTS = "double time, double *w, const int64_t *m, const void *const *tab, double *out"


def _compiled(plan: Plan) -> _Compiled | None:
    try:
        return _Compiled(plan)
    except (Unsupported, OSError):
        return None


def _function(writer: Writer, k: int, stage: Stage) -> str:
    """The entries of the Jacobian of a stage, then its residuals."""
    writer.lines = []
    entries = len(stage.jacobian.source)
    sweep(writer, stage.program, stage.jacobian, values=True).copy("out", np.arange(entries), stage.jacobian.source)
    residual, rows = writer.indices(stage.residual), writer.number(len(stage.residual))
    writer.add(f"for (int64_t i = 0; i < {rows}; i++) out[{writer.number(entries)} + i] = w[{residual}[i]];")
    body = "\n".join("  " + line for line in writer.lines)
    return (
        f"static void lmoc_closing_{k}({_ARGUMENTS}) {{\n{body}\n"
        "  (void)time; (void)m; (void)tab; (void)w; (void)out;\n}\n"
    )
