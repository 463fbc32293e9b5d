"""IDA: BDF for implicit systems, x' - f(t, x) = 0, or with the unknowns of large blocks as algebraic variables."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrate.base import Outcome, Problem, Properties
from lmoc.numerics.integrate.cvode import Frame

PROPERTIES = Properties("ida", "BDF", stiff=True, order="1-5", library="SUNDIALS")


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times.

    Raises
    ------
    NotFound
        The libraries are not at hand.
    """
    from lmoc.numerics.integrate.sundials import ida

    t0, opened = float(problem.times[0]), problem.system.opened()
    system = opened or problem.system
    frame = Frame(problem, system)
    y, atol, mass = problem.x, problem.atol, np.ones(problem.system.n)
    if opened is not None:
        y = opened.start(t0, problem.x)
        z = y[len(mass) :]
        atol = np.concatenate([atol, problem.rtol * np.maximum(1.0, np.abs(z))])
        mass = opened.differential.astype(float)
    y, mass = frame.arrange(y), frame.arrange(mass)

    def residual(t: float, y: np.ndarray, yp: np.ndarray, out: np.ndarray) -> None:
        frame.rhs(t, y, out)
        np.subtract(mass * yp, out, out=out)

    def fill(t: float, y: np.ndarray, target: np.ndarray, cj: float) -> None:
        frame.fill(t, y, target, -1.0, cj * mass)

    yp = np.empty_like(y)
    frame.rhs(t0, y, yp)
    given = frame.given(y, frame.arrange(atol), fill)
    outcome = frame.outcome(lambda: ida.integrate(given, residual, mass * yp, mass > 0))
    if opened is not None:
        outcome.counts["algebraic"] = opened.n - problem.system.n
        outcome.evaluation = opened.description
    return outcome
