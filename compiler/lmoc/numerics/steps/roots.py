"""Sign changes of functions of time and state within a step: on the step's own dense output, in order.

They are found and located in C (``engine/c/roots.c``), which asks here for the functions at several times at once, or
knows them itself (``engine/c/step_functions.c``).
"""

from __future__ import annotations

import numpy as np

from lmoc.engine.roots import Finder
from lmoc.engine.step_functions import StepFunctions
from lmoc.numerics.problem.base import Integration
from lmoc.numerics.problem.roots import Roots


class RootFinder:
    """Follows the signs of root functions from step to step.

    Attributes
    ----------
    signs : (m,) the signs that the functions have had last; 0 where none is known yet
    which : (m,) mask of those that vanish at the root found last
    """

    def __init__(self, roots: Roots, t: float, x: np.ndarray, has_series: bool = False) -> None:
        """
        Parameters
        ----------
        has_series : the method gives its last step as a polynomial
        """
        self.roots, self.signs = roots, roots.signs
        unknown = self.signs == 0
        if unknown.any():
            self.signs[unknown] = np.sign(roots.values(np.array([t]), x[None])[0])[unknown]
        if roots.largest is None:
            roots.largest = np.abs(x)
        self._functions: StepFunctions | None = None
        if has_series and roots.in_c is not None:
            self._functions = StepFunctions(roots.in_c, roots.largest)
            self._finder = Finder.along(self.signs, self._functions)
        else:
            self._finder = Finder.asking(self.signs, self._values, self._quiet)
        self.which = self._finder.which
        self._place = t, x.copy()  # the end of the step before: multistep methods do not interpolate it exactly
        self._run: Integration
        self._seen: tuple[np.ndarray, np.ndarray]  # times and states that have been looked at last

    def begin(self, t: float, x: np.ndarray) -> None:
        """Go on from another place."""
        self._place = t, x

    def first(self, run: Integration, end: float) -> tuple[float, np.ndarray] | None:
        """Return the place (t, x) in the last step where the integration shall end; None where it goes on to `end`."""
        self._run = run
        if self._functions is not None:
            self._functions.begin(self._place, (run.t, run.x), run.series())
        self._finder.begin(run.before, end)
        while True:
            t = self._finder.next()
            if t is None:
                self._place = run.t, run.x.copy()
                return None
            x = self._at(t) if self._functions is None else self._functions.states(t)
            if self.roots.reached(t, x, self.which, self.signs):
                return t, x

    def _at(self, t: float) -> np.ndarray:
        times, states = self._seen
        at = np.flatnonzero(times == t)
        return states[at[-1]].copy() if len(at) else self._run.interpolate(np.array([t]))[0]

    def _values(self, times: np.ndarray) -> np.ndarray:
        run = self._run
        states = run.interpolate(times)
        if times[-1] == run.t:
            states[-1] = run.x
        if times[0] == self._place[0]:
            states[0] = self._place[1]
        np.fmax(self.roots.largest, np.abs(states).max(axis=0, initial=0.0), out=self.roots.largest)
        self._seen = times.copy(), states
        return self.roots.values(times, states)

    def _quiet(self, t: float, heights: np.ndarray) -> np.ndarray:
        return self.roots.quiet(t, self._seen[1][-1], heights)
