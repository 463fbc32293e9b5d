"""DOP853 kept at work from one time to the next, for a scene that is stepped: what it keeps between steps stays in C.

A step of such a scene is often a single one of the method, so that what Python does about it would cost more.
"""

from __future__ import annotations

import ctypes

import numpy as np

from lmoc.engine.library import library
from lmoc.numerics.evaluate.engine_stepper import EngineStepper
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
    """

    def __init__(self, run: dop853.Dop853, stepper: EngineStepper) -> None:
        self._run, self._system = run, stepper.system  # what C reads lives in them
        self._steps = stepper.loaded(*run.state(_MOST))
        self.x = stepper.x
        self._reference = ctypes.byref(self._steps)
        self._walk, self._restart = library().lmoc_dop853_walk, library().lmoc_dop853_restart

    @property
    def t(self) -> float:
        """s"""
        return float(self._steps.t)

    @t.setter
    def t(self, value: float) -> None:
        self._steps.t = value

    @property
    def max_step(self) -> float:
        """The longest step, s."""
        return float(self._steps.max_step)

    @max_step.setter
    def max_step(self, value: float) -> None:
        self._steps.max_step = value

    def jump(self, x: np.ndarray) -> None:
        """Go on from another state at the same time."""
        self.x[:] = x
        self.restart()

    def restart(self) -> None:
        """Go on from the same state with an input that has another value."""
        self._restart(self._reference)

    def reach(self, end: float, most: int) -> Status:
        """Make up to so many steps towards a time, the last one exactly to it."""
        steps, system = self._steps, self._system
        system.note_work()
        steps.end, steps.most = end, most
        found = self._walk(self._reference)
        system.evaluations += steps.evaluations
        return dop853.WALKED[found]
