"""IDA: BDF for implicit systems, here on x' - f(t, x) = 0."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrators.base import Outcome, Problem, Properties
from lmoc.numerics.integrators.cvode import Expired, Frame

PROPERTIES = Properties("ida", "BDF", stiff=True, order="1-5", jacobian=True, library="SUNDIALS")


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times."""
    from lmoc.numerics.native import ida

    frame = Frame(problem)

    def residual(t: float, y: np.ndarray, yp: np.ndarray, out: np.ndarray) -> None:
        frame.rhs(t, y, out)
        np.subtract(yp, out, out=out)

    def fill(t: float, y: np.ndarray, target: np.ndarray, cj: float) -> None:
        frame.fill(t, y, target, -1.0, cj)

    y = frame.arrange(problem.x)
    yp = np.empty_like(y)
    frame.rhs(float(problem.times[0]), y, yp)
    equations = ida.Equations(residual, frame.matrix(fill), np.ones(len(y), bool))
    try:
        result = ida.integrate(
            equations,
            y,
            yp,
            problem.times,
            problem.rtol,
            frame.arrange(problem.error_atol),
            frame.sink,
            problem.max_steps,
            problem.progress,
        )
    except Expired:
        return frame.expired()
    return frame.outcome(result)
