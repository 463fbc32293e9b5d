"""DOP853's steps in C, one or many at a time."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Protocol

import numpy as np

from lmoc.numerics.evaluate.native.kernel import Call, Kernel
from lmoc.numerics.evaluate.stepper import RightHandSide, Stepper, Walked
from lmoc.numerics.integrate import dop853_table as table
from lmoc.numerics.integrate.dense_output import LAST_WEIGHTS
from lmoc.numerics.integrate.dop853_rules import RULES


class Native(RightHandSide, Protocol):
    """The part of `system.NativeSystem` that the steps need."""

    kernel: Kernel
    evaluations: int

    def shared_call(self) -> Call: ...


class _Rules(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in vars(RULES)]


class _Steps(ctypes.Structure):
    """The state of the method (``lmoc_steps`` in `c/dop853_walk.c`)."""

    _fields_ = [
        ("call", ctypes.POINTER(Call)),
        ("rules", ctypes.POINTER(_Rules)),
        *[(name, ctypes.c_void_p) for name in ("weights", "nodes", "dense", "omitted", "atol")],
        *[(name, ctypes.c_void_p) for name in ("x", "f", "x_new", "k", "last", "terms", "landed")],
        *[(name, ctypes.c_double) for name in ("t", "before", "step_size", "length", "error", "stiffness")],
        *[(name, ctypes.c_double) for name in ("grow", "stiff_count", "calm_count", "careful", "cuts")],
        ("cuts_since", ctypes.c_double),
        *[(name, ctypes.c_int64) for name in ("pending", "staged", "lost")],
        *[(name, ctypes.c_double) for name in ("rtol", "end", "max_step", "patience")],
        *[(name, ctypes.c_int64) for name in ("steps", "rejected", "evaluations", "most")],
        ("times", ctypes.c_void_p),
        ("out", ctypes.c_void_p),
        *[(name, ctypes.c_int64) for name in ("outputs", "reached", "room")],
        ("hold", ctypes.c_void_p),
    ]


class NativeStepper(Stepper):
    """All stages of a step in one C call, or many steps."""

    def __init__(self, system: Native) -> None:
        n = system.n
        self.system = system
        self.x, self.f, self.x_new, self.last = (np.zeros(n) for _ in range(4))
        self.k, self.atol = np.zeros((16, n)), np.zeros(n)
        self.result = np.zeros(2)
        self._call = system.shared_call()
        library = system.kernel.library
        self._attempt, self._more, self._walk = (
            library.lmoc_dop853_attempt, library.lmoc_dop853_more, library.lmoc_dop853_walk
        )  # fmt: skip
        real, pointer = ctypes.c_double, ctypes.c_void_p
        self._attempt.argtypes = [pointer, real, real, real, *[pointer] * 8]
        self._more.argtypes = [pointer, real, real, *[pointer] * 5]
        self._attempt.restype = self._more.restype = None
        self._walk.argtypes, self._walk.restype = [pointer], ctypes.c_int
        self._reference = ctypes.byref(self._call)
        fixed = (_weights(), _nodes(), self.atol, self.k, self.last, self.result)
        self._at = [a.ctypes.data for a in fixed]  # asking numpy for an address takes as long as a small evaluation
        self._x, self._x_new = self.x.ctypes.data, self.x_new.ctypes.data
        self._steps: _Steps | None = None

    @property
    def walker(self) -> NativeStepper:
        return self

    def start(self, t, x, rtol, atol) -> None:
        self.x[:], self.atol[:], self.rtol = x, atol, float(rtol)
        self.system.rhs(t, self.x, self.f)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        self.k[0] = self.f
        weights, times, atol, k, last, result = self._at
        call = self._reference
        self._attempt(call, t, h, self.rtol, weights, times, self._x, atol, k, self._x_new, last, result)
        self.system.evaluations += 12
        error, stiffness = self.result.tolist()
        return error, stiffness

    def stages(self, t: float, h: float) -> np.ndarray:
        weights, times, _, k, last, _ = self._at
        self._more(self._reference, t, h, weights, times, self._x, k, last)
        self.system.evaluations += 3
        return self.k

    def accept(self) -> None:
        self.x, self.x_new = self.x_new, self.x
        self._x, self._x_new = self._x_new, self._x
        self.f[:] = self.k[12]

    def walk(self, kept, given, times, out) -> Walked:
        steps = self._steps = self._made() if self._steps is None else self._steps
        steps.x, steps.x_new, steps.rtol = self._x, self._x_new, self.rtol
        steps.times, steps.out, steps.outputs, steps.room = times.ctypes.data, out.ctypes.data, len(times), len(out)
        for name, value in (*kept.items(), *given.items()):
            setattr(steps, name, value)
        found = self._walk(ctypes.byref(steps))
        for name in kept:
            kept[name] = getattr(steps, name)
        self.system.evaluations += steps.evaluations
        return Walked(found, steps.steps, steps.rejected, steps.reached)

    def _made(self) -> _Steps:
        """The state with the arrays that stay."""
        weights, nodes, atol, k, last, _ = self._at
        self._rules = _Rules(*vars(RULES).values())
        self._terms, self._landed = np.zeros((7, self.system.n)), np.zeros(self.system.n)
        return _Steps(
            ctypes.pointer(self._call), ctypes.pointer(self._rules), weights, nodes,
            _dense().ctypes.data, LAST_WEIGHTS.ctypes.data, atol, f=self.f.ctypes.data, k=k, last=last,
            terms=self._terms.ctypes.data, landed=self._landed.ctypes.data,
        )  # fmt: skip


@lru_cache(maxsize=1)
def _weights() -> np.ndarray:
    """(19, 16) the coefficients of the 16 stages, then those of the new state and of the two error estimates."""
    rows = [*table.A, table.B, table.E5, table.E3]
    return np.array([np.pad(row, (0, 16 - len(row))) for row in rows])


@lru_cache(maxsize=1)
def _nodes() -> np.ndarray:
    return np.ascontiguousarray(table.C)


@lru_cache(maxsize=1)
def _dense() -> np.ndarray:
    """(4, 16) the coefficients of the dense output."""
    return np.ascontiguousarray(table.D)
