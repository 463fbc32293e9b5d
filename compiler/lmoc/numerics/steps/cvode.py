"""CVODE: multistep methods of variable order, BDF for stiff problems and Adams for others.

SUNDIALS is called directly (`numerics.sundials`): values that are not finite make it try a shorter step and give up in
the end, and no Python package is imported for it.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Expired, Integration, Problem, Properties, Watch, on_interrupt
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import OpenedSystem, System
from lmoc.numerics.steps.matrices import MatrixLayout, layout_of
from lmoc.numerics.sundials.matrix import JacobianStorage
from lmoc.numerics.sundials.session import Given, SundialsSession

PROPERTIES = Properties(
    "cvode", "BDF", "BDF", "1-5", "1-5", "SUNDIALS",
    stability="A(α)", implicit=True,
    good_for="stiff scenes whose fastest mode decays",
)  # fmt: skip

_LOOK = 64  # evaluations between two looks at the clock
_SOON = 16.0  # steps at least to where a function that has just left zero is back: order 1 bends a hop's first ones


def begin(problem: Problem, method: str = "bdf") -> Integration:
    """Return CVODE with "bdf" or "adams" at the beginning of a problem.

    Raises
    ------
    NotFound
        The libraries are not at hand.
    """
    return Cvode(problem, method)


class Multistep(Integration):
    """A solver of SUNDIALS at work: the states in the order of its matrix, the deadline watched within its steps.

    Attributes
    ----------
    session : owns the library's objects
    """

    session: SundialsSession

    def __init__(self, problem: Problem, system: System | OpenedSystem) -> None:
        super().__init__(problem)
        self.system = system
        self.layout: MatrixLayout = layout_of(system, problem.system.plan)
        self.order = self.layout.order
        self.matrix = self.layout.text
        self._y, self._f = np.empty(system.n), np.empty(system.n)
        self._values = np.empty(len(system.pattern()[1]))
        self._watch = Watch(problem)
        self._calls = 0
        self.t = self.before = problem.t
        self._x: np.ndarray | None = problem.x  # None while it is what the session has
        self._good = problem.x  # the last state that was looked at
        self._counts: dict[str, int] = {}
        self._soon = np.inf if problem.roots is None else problem.t + problem.roots.soon

    def given(self, y: np.ndarray, atol: np.ndarray, fill) -> Given:
        """Return what a session is given; y and atol in the solver's order."""
        own, problem = self.layout, self.problem
        matrix = JacobianStorage(own.kind, fill, own.lower, own.upper, own.indptr, own.indices)
        span = problem.t, problem.end
        longest = min(problem.max_step, (self._soon - problem.t) / _SOON)
        return Given(y, *span, problem.rtol, atol, matrix, problem.max_steps, longest)

    # ------------------------------------------------------------------ orders

    def arrange(self, y: np.ndarray) -> np.ndarray:
        """From the system's order to the solver's."""
        return y.copy() if self.order is None else y[self.order]

    def restore(self, y: np.ndarray) -> np.ndarray:
        """From the solver's order to the system's."""
        if self.order is None:
            return y
        self._y[self.order] = y
        return self._y

    def states(self, y: np.ndarray) -> np.ndarray:
        """The states alone, as the run has them."""
        return self.restore(y)[: self.problem.system.n].copy()

    # ------------------------------------------------------------------ callbacks

    def rhs(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        self._calls += 1
        if self._calls % _LOOK == 0:
            self.look(t)
        if self.order is None:
            self.system.rhs(t, y, out)
        else:
            self.system.rhs(t, self.restore(y), self._f)
            np.take(self._f, self.order, out=out)

    def fill(self, t: float, y: np.ndarray, target: np.ndarray, scale: float = 1.0, shift=0.0) -> None:
        self.look(t)  # where the right-hand side is compiled, nothing else comes by between two output times
        self.system.jacobian_values(t, self.restore(y), self._values)
        self.layout.write(self._values, scale, shift, target)

    def look(self, t: float) -> None:
        """Look at the clock."""
        if self._watch.expired(t):
            raise Expired

    # ------------------------------------------------------------------ the way forward

    def step(self) -> Status:
        self.steps += 1
        if self._soon < self.t:
            self._soon = np.inf
            self.session.limit_steps(self.problem.max_step)
        return self._moved(self.session.step())

    @property
    def unattended(self) -> Multistep:
        return self

    def advance(self, time: float) -> Status:
        return self._moved(self.session.advance(time))

    def _moved(self, status: Status) -> Status:
        session = self.session
        if status is Status.OK:
            self.before, self.t, self._x = self.t, session.t, None
        elif np.isfinite(session.x).all():  # a failed step may leave such values behind
            self.t, self._x = session.t, self.states(session.x)
        else:
            self._x = self._good
        return status

    @property
    def x(self) -> np.ndarray:
        if self._x is None:
            self._x = self._good = self.states(self.session.x)
        return self._x

    def collect_here(self) -> None:
        self._collected.append(self.x[None])

    def interpolate(self, times: np.ndarray) -> np.ndarray:
        return np.array([self.states(self.session.at(t)) for t in times.tolist()])

    def counts(self) -> dict[str, int]:
        return self._counts

    def __enter__(self) -> Multistep:
        self._interrupts = on_interrupt(self.session.interrupt)
        self._interrupts.__enter__()
        return self

    def __exit__(self, *error) -> None:
        self._interrupts.__exit__(*error)
        self._counts = self.session.counts()
        self.session.free()


class Cvode(Multistep):
    """CVODE at work."""

    def __init__(self, problem: Problem, method: str) -> None:
        from lmoc.numerics.sundials import cvode

        super().__init__(problem, problem.system)
        given = self.given(self.arrange(problem.x), self.arrange(problem.atol), self.fill)
        compiled = problem.system.callback(self.order)
        self.session = cvode.CvodeSession(given, compiled or self.rhs, method)

    def jump(self, x: np.ndarray) -> None:
        self.before, self._x = self.t, x
        self.session.restart(self.t, self.arrange(x))  # type: ignore[attr-defined]
