"""DOP853 kept at work from one time to the next, for a scene that is stepped: what it keeps between steps stays in C.

A step of such a scene is often a single one of the method, so that what Python does about it would cost more: all the
more with many scenes side by side (`Abreast`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.evaluate.engine_stepper import EngineStepper, Steps
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.steps import dop853

_MOST = 64  # steps that C is asked for when it takes over


def begin(problem: Problem) -> Onward | dop853.Dop853:
    """Return the method at the beginning of a problem: in C where nothing in its steps asks Python."""
    run = dop853.begin(problem)
    walker = run.stepper.walker
    return Onward(run, walker) if isinstance(walker, EngineStepper) else run


class Onward:
    """The method at work.

    Attributes
    ----------
    x : (n,) the state, written in place
    system, steps : what it integrates, and what the method keeps, for C
    """

    def __init__(self, run: dop853.Dop853, stepper: EngineStepper) -> None:
        self._run, self.system = run, stepper.system  # what C reads lives in them
        self.steps = stepper.loaded(*run.state(_MOST))
        self.x = stepper.x
        self._begun = ctypes.string_at(ctypes.addressof(self.steps), ctypes.sizeof(self.steps)), self.x.copy()
        self._reference = ctypes.byref(self.steps)
        self._walk, self._restart = library().lmoc_dop853_walk, library().lmoc_dop853_restart

    @property
    def t(self) -> float:
        """s"""
        return float(self.steps.t)

    @t.setter
    def t(self, value: float) -> None:
        self.steps.t = value

    @property
    def max_step(self) -> float:
        """The longest step, s."""
        return float(self.steps.max_step)

    @max_step.setter
    def max_step(self, value: float) -> None:
        self.steps.max_step = value

    def jump(self, x: np.ndarray) -> None:
        """Go on from another state at the same time."""
        self.x[:] = x
        self.restart()

    def rewind(self) -> None:
        """Go back to the beginning, with the length of step that was chosen there."""
        steps, self.x[:] = self._begun
        ctypes.memmove(ctypes.addressof(self.steps), steps, len(steps))
        self.restart()

    def restart(self) -> None:
        """Go on from the same state with an input that has another value."""
        self._restart(self._reference)

    def reach(self, end: float, most: int) -> Status:
        """Make up to so many steps towards a time, the last one exactly to it."""
        steps, system = self.steps, self.system
        system.note_work()
        steps.end, steps.most = end, most
        found = self._walk(self._reference)
        system.evaluations += steps.evaluations
        return dop853.WALKED[found]


class _Abreast(ctypes.Structure):
    """``lmoc_abreast`` in ``engine/c/abreast.h``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("runs", "blocks", "given", "most")],
        *[(name, ctypes.c_void_p) for name in ("each", "registers", "values", "ends", "x", "found")],
        ("evaluations", ctypes.c_int64),
    ]


class Abreast:
    """Methods at work on several scenes of one plan, all of which go on in one call.

    Attributes
    ----------
    values : (scenes, registers) what the registers are to hold while a scene goes on
    ends : (scenes,) s, to which they go on
    x : (scenes, n) where they have come to
    """

    def __init__(self, runs: Sequence[Onward], registers: Sequence[int], most: int) -> None:
        """
        Parameters
        ----------
        registers : which are given a value when a scene goes on; the same for all
        most : steps that are made at once at most
        """
        self._runs, count = list(runs), len(runs)
        self._each = (ctypes.POINTER(Steps) * count)()
        self._registers = np.array(registers, np.int64)
        self.values, self.ends = np.zeros((count, len(registers))), np.zeros(count)
        self.x, self._found = np.zeros((count, len(runs[0].x))), np.zeros(count, np.int64)
        arrays = [a.ctypes.data for a in (self._registers, self.values, self.ends, self.x, self._found)]
        blocks = len(runs[0].system.kernel.tape.blocks)
        self._own = _Abreast(count, blocks, len(registers), most, ctypes.addressof(self._each), *arrays)
        self._reference, self._go = ctypes.byref(self._own), library().lmoc_dop853_abreast
        self._turn = 0
        for k, run in enumerate(runs):
            self.put(k, run)

    def put(self, k: int, run: Onward) -> None:
        """Have another run in one of the places, or the same one, which somebody has moved."""
        self._runs[k], self._each[k], self.x[k] = run, ctypes.pointer(run.steps), run.x

    def go(self) -> np.ndarray | None:
        """Go on to the ends; returns which (scenes,) have not come there, or None where all have."""
        system = self._runs[self._turn].system  # one by one, they go on with compiled code when it is there
        self._turn = (self._turn + 1) % len(self._runs)
        system.note_work()
        behind = self._go(self._reference)
        system.evaluations += self._own.evaluations
        if not behind:
            return None
        return (self._found != 0) | np.array([run.t < end for run, end in zip(self._runs, self.ends, strict=True)])
