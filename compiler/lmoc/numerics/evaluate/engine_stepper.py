"""DOP853's steps in C, one or many at a time."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import lru_cache
from typing import Protocol

import numpy as np

from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import library
from lmoc.engine.pieces import Passing, passing
from lmoc.numerics.dop853 import table
from lmoc.numerics.dop853.dense_output import LAST_WEIGHTS
from lmoc.numerics.dop853.rules import RULES
from lmoc.numerics.problem.stepper import RightHandSide, Stepper, Walked


class InEngine(RightHandSide, Protocol):
    """The part of `engine_system.EngineSystem` that the steps need."""

    kernel: Kernel
    evaluations: int

    @property
    def python_inputs(self) -> int:
        """Return how many inputs Python gives at each stage."""

    def shared_call(self) -> Call: ...

    def note_work(self) -> None: ...

    def sample_many(self, times: np.ndarray, out: np.ndarray) -> None: ...


class _Rules(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in vars(RULES)]


class Steps(ctypes.Structure):
    """The state of the method (``steps`` in ``engine/c/walk.c``)."""

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
        ("hook", ctypes.c_void_p),
        *[(name, ctypes.c_double) for name in ("trial", "goal")],
    ]


class EngineStepper(Stepper):
    """All stages of a step in one C call, or many steps."""

    def __init__(self, system: InEngine) -> None:
        n, inputs = system.n, system.python_inputs
        self.system = system
        # a state, and behind it the inputs that Python gives
        self._now, self._new, self._last = (np.zeros(n + inputs) for _ in range(3))
        self.x, self.x_new, self.f = self._now[:n], self._new[:n], np.zeros(n)
        self.k, self.atol = np.zeros((16, n)), np.zeros(n)
        self.result = np.zeros(2)
        self._call, self._samples = system.shared_call(), np.zeros((16, inputs))
        self._call.samples = self._samples.ctypes.data
        self._library = library()
        self._reference = self._call.reference
        fixed = (weights(), nodes(), self.atol, self.k, self._last, self.result)
        self._at = [a.ctypes.data for a in fixed]  # asking numpy for an address takes as long as a small evaluation
        self._x, self._x_new = self._now.ctypes.data, self._new.ctypes.data
        self._steps: Steps | None = None

    @property
    def walker(self) -> EngineStepper | None:
        return None if self.system.python_inputs else self

    @property
    def addresses(self) -> tuple[int, int]:
        """Where the state stands, and the new one."""
        return self._x, self._x_new

    def start(self, t, x, rtol, atol) -> None:
        self.x[:], self.atol[:], self.rtol = x, atol, float(rtol)
        self.system.rhs(t, self.x, self.f)

    def _sample(self, t: float, h: float, first: int, last: int) -> None:
        if self.system.python_inputs:
            times = np.append(table.C[:12], [1.0, *table.C[13:]])[first:last]
            self.system.sample_many(t + times * h, self._samples[first:last])

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        self.k[0] = self.f
        weights, times, atol, k, last, result = self._at
        self._sample(t, h, 1, 13)
        self._library.lmoc_dop853_attempt(
            self._reference, t, h, self.rtol, weights, times, self._x, atol, k, self._x_new, last, result
        )
        self.system.evaluations += 12
        error, stiffness = self.result.tolist()
        return error, stiffness

    def stages(self, t: float, h: float) -> np.ndarray:
        weights, times, _, k, last, _ = self._at
        self._sample(t, h, 13, 16)
        self._library.lmoc_dop853_more(self._reference, t, h, weights, times, self._x, k, last)
        self.system.evaluations += 3
        return self.k

    def accept(self) -> None:
        self.x, self.x_new = self.x_new, self.x
        self._x, self._x_new = self._x_new, self._x
        self.f[:] = self.k[12]

    def walk(self, kept, given, times, out) -> Walked:
        self.system.note_work()
        steps = self.loaded(kept, given)
        steps.times, steps.out, steps.outputs, steps.room = times.ctypes.data, out.ctypes.data, len(times), len(out)
        found = self._library.lmoc_dop853_walk(ctypes.byref(steps))
        for name in kept:
            kept[name] = getattr(steps, name)
        self.system.evaluations += steps.evaluations
        return Walked(found, steps.steps, steps.rejected, steps.reached)

    def pass_kinks(self, kept, given, bounds, times, out, most) -> Passing:
        self.system.note_work()
        steps, own = self.loaded(kept, given), passing(self._call, bounds, times, out, most)
        self._library.lmoc_dop853_pass(ctypes.byref(steps), ctypes.byref(own))
        self.system.evaluations += own.evaluations
        return own

    def loaded(self, kept: Mapping[str, float], given: Mapping[str, float | None]) -> Steps:
        """Return the state of the method in C, with what Python keeps of it and what is asked for."""
        steps = self._steps = self.steps() if self._steps is None else self._steps
        steps.x, steps.x_new, steps.rtol = self._x, self._x_new, self.rtol
        for name, value in (*kept.items(), *given.items()):
            setattr(steps, name, value)
        return steps

    def steps(self) -> Steps:
        """Return the state of the method, with the arrays that stay."""
        weights, nodes, atol, k, last, _ = self._at
        self._rules = _Rules(*vars(RULES).values())
        self._terms, self._landed = np.zeros((7, self.system.n)), np.zeros(self.system.n)
        return Steps(
            ctypes.pointer(self._call), ctypes.pointer(self._rules), weights, nodes,
            dense().ctypes.data, LAST_WEIGHTS.ctypes.data, atol, f=self.f.ctypes.data, k=k, last=last,
            terms=self._terms.ctypes.data, landed=self._landed.ctypes.data,
        )  # fmt: skip


@lru_cache(maxsize=1)
def weights() -> np.ndarray:
    """(19, 16) the coefficients of the 16 stages, then those of the new state and of the two error estimates."""
    rows = [*table.A, table.B, table.E5, table.E3]
    return np.array([np.pad(row, (0, 16 - len(row))) for row in rows])


@lru_cache(maxsize=1)
def nodes() -> np.ndarray:
    return np.ascontiguousarray(table.C)


@lru_cache(maxsize=1)
def dense() -> np.ndarray:
    """(4, 16) the coefficients of the dense output."""
    return np.ascontiguousarray(table.D)
