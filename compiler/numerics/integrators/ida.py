"""IDA: BDF for implicit systems, x' - f(t, x) = 0, or with the unknowns of large blocks as algebraic variables."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrators.base import Outcome, Problem, Properties
from lmoc.numerics.integrators.cvode import Expired, Frame

PROPERTIES = Properties("ida", "BDF", stiff=True, order="1-5", jacobian=True, library="SUNDIALS")


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times."""
    from lmoc.numerics.native import ida

    t0, opened = float(problem.times[0]), problem.system.opened()
    frame = Frame(problem, opened)
    y, atol, mass = problem.x, problem.error_atol, np.ones(problem.system.n)
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
    equations = ida.Equations(residual, frame.matrix(fill), mass > 0)
    try:
        result = ida.integrate(
            equations,
            y,
            mass * yp,
            problem.times,
            problem.rtol,
            frame.arrange(atol),
            frame.sink,
            problem.max_steps,
            problem.progress,
        )
    except Expired:
        return frame.expired()
    outcome = frame.outcome(result)
    if opened is not None:
        outcome.counts["algebraic"] = opened.n - problem.system.n
    return outcome
