"""CVODE: multistep methods of variable order, BDF for stiff problems and Adams for others.

SUNDIALS is called directly (`numerics.native`): values that are not finite make it try a shorter step and give up in
the end, and no Python package is imported for it.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate.system import System
from lmoc.numerics.integrate.base import Outcome, Problem, Properties, Watch
from lmoc.numerics.integrate.matrices import Layout, layout_of
from lmoc.numerics.integrate.status import Status

PROPERTIES = Properties("cvode", "BDF", stiff=True, order="1-5", library="SUNDIALS")
ADAMS = Properties("adams", "Adams", stiff=False, order="1-12", library="SUNDIALS")

_LOOK = 64  # evaluations between two looks at the clock
_BATCH = 200_000  # numbers gathered before they are handed on


class Expired(Exception):
    """The time allowed for the run is over."""


class Frame:
    """A system as SUNDIALS sees it: states in the layout's order, the deadline watched, output gathered."""

    def __init__(self, problem: Problem, system: System) -> None:
        self.problem, self.system = problem, system
        self.layout: Layout = layout_of(system)
        self.order = self.layout.order
        self.x, self.f = np.empty(system.n), np.empty(system.n)
        self.values = np.empty(len(system.pattern()[1]))
        self.watch = Watch(problem)
        self.calls = 0
        self.last = problem.x  # at the last output time reached
        self.first, self.batch = 1, []  # states at the output times `first …`, not yet handed on

    @property
    def reached(self) -> int:
        """Number of output times reached, the start counted."""
        return self.first + len(self.batch)

    def arrange(self, x: np.ndarray) -> np.ndarray:
        """From the system's order to the solver's."""
        return x.copy() if self.order is None else x[self.order]

    def restore(self, x: np.ndarray) -> np.ndarray:
        """From the solver's order to the system's."""
        if self.order is None:
            return x
        self.x[self.order] = x
        return self.x

    def state(self, x: np.ndarray) -> np.ndarray:
        """The states alone, as the run has them."""
        return self.restore(x)[: self.problem.system.n].copy()

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.calls += 1
        if self.calls % _LOOK == 0:
            self.look(t)
        if self.order is None:
            self.system.rhs(t, x, out)
        else:
            self.system.rhs(t, self.restore(x), self.f)
            np.take(self.f, self.order, out=out)

    def fill(self, t: float, x: np.ndarray, target: np.ndarray, scale: float = 1.0, shift=0.0) -> None:
        self.look(t)  # where the right-hand side is compiled, nothing else comes by between two output times
        self.system.jacobian_values(t, self.restore(x), self.values)
        self.layout.write(self.values, scale, shift, target)

    def look(self, t: float) -> None:
        """Look at the clock."""
        if self.watch.expired(t):
            raise Expired

    def sink(self, k: int, x: np.ndarray) -> None:
        """Gather the states at the output times: what is computed from them is computed for many times at once."""
        self.last = self.state(x)
        self.batch.append(self.last)
        if len(self.batch) * len(self.last) > _BATCH:
            self.flush()
        self.look(float(self.problem.times[k]))

    def flush(self) -> None:
        """Hand on what has been gathered."""
        first, batch = self.first, self.batch
        self.first, self.batch = self.reached, []
        if batch:
            self.problem.sink(first, np.array(batch))

    def given(self, x: np.ndarray, atol: np.ndarray, fill):
        """What the native session is given; x and atol in the solver's order."""
        from lmoc.numerics.integrate.sundials.matrix import Matrix
        from lmoc.numerics.integrate.sundials.session import Given

        problem, y = self.problem, self.layout
        matrix = Matrix(y.kind, fill, y.lower, y.upper, y.indptr, y.indices)
        return Given(x, problem.times, problem.rtol, atol, matrix, self.sink, problem.max_steps)

    def outcome(self, integrate) -> Outcome:
        """Run a native session and say how far it came.

        Parameters
        ----------
        integrate : () -> native.session.Ended
        """
        try:
            result = integrate()
        except Expired:
            return self.stopped(Status.TOO_LONG)
        except KeyboardInterrupt:
            return self.stopped(Status.INTERRUPTED)
        x = self.state(result.x)
        if not np.isfinite(x).all():  # a failed step may leave such values behind
            return self.stopped(result.status)
        self.flush()
        counts = {"steps": result.steps, "evaluations": result.evaluations, "jacobians": result.jacobians}
        return Outcome(result.time, x, self.reached, result.status, counts=counts, matrix=self.layout.text)

    def stopped(self, status: Status) -> Outcome:
        """Where it came to an end at the last output time."""
        self.flush()
        return Outcome(float(self.problem.times[self.reached - 1]), self.last, self.reached, status)


def integrate(problem: Problem, method: str = "bdf") -> Outcome:
    """Integrate over the output times with "bdf" or "adams".

    Raises
    ------
    NotFound
        The libraries are not at hand.
    """
    from lmoc.numerics.integrate.sundials import cvode

    frame = Frame(problem, problem.system)
    given = frame.given(frame.arrange(problem.x), frame.arrange(problem.atol), frame.fill)
    compiled = problem.system.callback(frame.order)
    return frame.outcome(lambda: cvode.integrate(given, compiled or frame.rhs, method))
