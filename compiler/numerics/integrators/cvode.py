"""CVODE: multistep methods of variable order, BDF for stiff problems and Adams for others.

SUNDIALS is called directly (`numerics.native`): values that are not finite make it try a shorter step and give up in
the end, and no Python package is imported for it.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrators.base import NOT_FINITE, TOO_LONG, Outcome, Problem, Properties, Watch
from lmoc.numerics.integrators.matrices import Layout, layout_of
from lmoc.numerics.system import System

PROPERTIES = Properties("cvode", "BDF", stiff=True, order="1-5", jacobian=True, library="SUNDIALS")
ADAMS = Properties("adams", "Adams", stiff=False, order="1-12", jacobian=True, library="SUNDIALS")

_LOOK = 64  # evaluations between two looks at the clock
_BATCH = 200_000  # numbers gathered before they are handed on


class Expired(Exception):
    """The time allowed for the run is over."""


class Frame:
    """A system as SUNDIALS sees it: states in the layout's order, the deadline watched."""

    def __init__(self, problem: Problem, system: System | None = None) -> None:
        self.problem, self.system = problem, problem.system if system is None else system
        self.layout: Layout = layout_of(self.system)
        order = self.layout.order
        self.order = order
        self.x, self.f = np.empty(self.system.n), np.empty(self.system.n)
        self.values = np.empty(len(self.system.pattern()[1]))
        self.watch = Watch(problem)
        self.calls = 0
        self.batch: list[np.ndarray] = []

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
        if self.calls % _LOOK == 0 and self.watch.expired(t):
            raise Expired
        if self.order is None:
            self.system.rhs(t, x, out)
        else:
            self.system.rhs(t, self.restore(x), self.f)
            np.take(self.f, self.order, out=out)

    def fill(self, t: float, x: np.ndarray, target: np.ndarray, scale: float = 1.0, shift=0.0) -> None:
        self.system.jacobian_values(t, self.restore(x), self.values)
        self.layout.write(self.values, scale, shift, target)

    def sink(self, k: int, x: np.ndarray) -> None:
        """Gather the states at the output times: what is computed from them is computed for many times at once."""
        self.last = self.state(x)
        self.batch.append(self.last)
        self.reached, self.time = k + 1, float(self.problem.times[k])
        if len(self.batch) * len(self.last) > _BATCH:
            self.flush()

    def flush(self) -> None:
        """Hand on what has been gathered."""
        if self.batch:
            self.problem.sink(self.reached - len(self.batch), np.array(self.batch))
            self.batch = []

    reached: int = 1
    time: float = np.nan
    last: np.ndarray | None = None

    def matrix(self, fill):
        from lmoc.numerics.native.cvode import Matrix

        y = self.layout
        return Matrix(y.kind, fill, y.lower, y.upper, y.indptr, y.indices)

    def expired(self) -> Outcome:
        self.flush()
        x = self.problem.x if self.last is None else self.last
        t = float(self.problem.times[0]) if self.last is None else self.time
        return Outcome(t, x, self.reached, TOO_LONG)

    def outcome(self, result) -> Outcome:
        """From what the native loop returns."""
        self.flush()
        calls = result.rhs_evaluations
        counts = {"steps": result.steps, "evaluations": calls, "jacobians": result.jacobian_evaluations}
        failure = NOT_FINITE if "no finite value" in result.failure else result.failure
        x = self.state(result.x)
        return Outcome(result.time, x, self.reached, failure, False, counts, matrix=self.layout.text)


def integrate(problem: Problem, method: str = "bdf") -> Outcome:
    """Integrate over the output times with "bdf" or "adams"."""
    from lmoc.numerics.native import cvode

    frame = Frame(problem)
    errors: list[BaseException] = []
    native = problem.system.callback(frame.order)
    rhs, data = native or (cvode.wrap_python(frame.rhs, problem.system.n, errors), None)
    try:
        result = cvode.integrate(
            rhs,
            data,
            frame.arrange(problem.x),
            problem.times,
            problem.rtol,
            frame.arrange(problem.error_atol),
            frame.matrix(frame.fill),
            method,
            problem.max_steps,
            problem.progress,
            frame.sink,
        )
    except Expired:
        return frame.expired()
    if errors:
        if isinstance(errors[0], Expired):
            return frame.expired()
        raise errors[0]
    return frame.outcome(result)
