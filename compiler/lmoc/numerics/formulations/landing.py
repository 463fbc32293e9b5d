"""The way back onto the closures of loops in C, and the watch over their rank: between many steps without Python.

The same projection as in `manifold`, and a sharper condition of the way from one place to the next: matrices change by
less than the smallest singular values at both ends, so that none between them loses its rank (Weyl), and closures do
not turn round. What does not satisfy it is left to Python, which looks at it closely.
"""

from __future__ import annotations

import ctypes
from functools import partial

import numpy as np

from lmoc.engine.kernel import Kernel, StepHook
from lmoc.engine.library import address, library
from lmoc.lower.blocks import derivatives_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.formulations.closing import ClosureStage, EqualLoops, closing
from lmoc.numerics.plan.plan import Plan

_FIRM = 1e-2  # smallest singular value from which closures are far from depending on each other
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
        *[(name, ctypes.c_void_p) for name in ("out", "w", "tape", "results")],
    ]


class _Closures(ctypes.Structure):
    _fields_ = [
        ("n", ctypes.c_int64),
        ("stages", ctypes.c_int64),
        ("states", ctypes.c_void_p),
        ("scale", ctypes.c_void_p),
        ("stage", ctypes.POINTER(_Stage)),
        ("firm", ctypes.c_double),
        ("found", ctypes.c_double * 2),
        ("largest", ctypes.c_double * 2),
    ]


def landing(plan: Plan, base: np.ndarray, scale: np.ndarray) -> Landing | None:
    """Return the closures of a plan in C; None where an input has no formula.

    Parameters
    ----------
    base : registers that do not change during a run, with room for those of the residuals
    scale : (n,) sizes of the states
    """
    return None if len(plan.sampled) else Landing(plan, base, scale)


def stage_tapes(plan: Plan) -> tuple[Tape, ...]:
    """Return what fills the entries of each stage's Jacobian; to be asked for by `Plan.once`."""
    own = plan.once(closing)
    return tuple(derivatives_tape(s.program, s.jacobian, own.count, values=True) for s in own.stages)


class Landing:
    """The closures of one run.

    Attributes
    ----------
    address : of what steps in C call (``lmoc_step_hook`` in ``engine/c/engine.h``)
    """

    def __init__(self, plan: Plan, base: np.ndarray, scale: np.ndarray) -> None:
        self._kept: list[object] = []  # what C points to
        own, tapes = plan.once(closing), plan.once(stage_tapes)
        stages = (_Stage * len(own.stages))(*(self._stage(s, t, base) for s, t in zip(own.stages, tapes, strict=True)))
        self._kept.append(stages)
        self._closures = _Closures(
            len(plan.states), len(stages), self._at(np.ascontiguousarray(plan.states, np.int32)),
            self._at(np.ascontiguousarray(scale, float)), stages, _FIRM,
        )  # fmt: skip
        reference = ctypes.cast(ctypes.pointer(self._closures), ctypes.c_void_p)
        self._hook = StepHook(reference, *map(address, ("lmoc_look", "lmoc_land", "lmoc_keep")), _PIECES)
        engine = library()
        self._look, self._many, self._keep = (
            partial(f, reference) for f in (engine.lmoc_look, engine.lmoc_land_many, engine.lmoc_keep)
        )
        self.address = ctypes.addressof(self._hook)

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

    def _stage(self, stage: ClosureStage, tape: Tape, base: np.ndarray) -> _Stage:
        groups = (_Loops * len(stage.loops))(*map(self._loops, stage.loops))
        residuals, entries = len(stage.residual), len(stage.jacobian.source)
        kernel = Kernel(tape)
        kernel.w[: len(base)] = base
        self._kept += [groups, kernel]
        results = np.concatenate([tape.results, stage.residual]).astype(np.int32)
        out = self._at(np.zeros(entries + residuals))
        return _Stage(residuals, entries, len(groups), groups, out, *kernel.addresses, self._at(results))

    def _loops(self, own: EqualLoops) -> _Loops:
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
