"""Radau IIA of order 5 by scipy: implicit, one step, accurate where a stiff problem also oscillates."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrators.base import (
    COLLAPSED,
    NOT_FINITE,
    TOO_LONG,
    TOO_MANY,
    Outcome,
    Problem,
    Properties,
    Watch,
)

PROPERTIES = Properties("radau", "Radau IIA", stiff=True, order="5", jacobian=True, library="scipy")

_DENSE = 100  # states up to which the Jacobian is a dense matrix


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8)."""
    from scipy.integrate import Radau

    times, t0 = problem.times, float(problem.times[0])
    if len(times) == 1:
        return Outcome(t0, problem.x, 1)
    solver = Radau(
        _rhs(problem),
        t0,
        problem.x.copy(),
        float(times[-1]),
        rtol=max(problem.rtol, 1e-13),
        atol=problem.error_atol,
        jac=_jacobian(problem),
    )
    watch, reached, steps, failure = Watch(problem), 1, 0, ""
    while solver.status == "running":
        try:
            solver.step()
        except ValueError:  # a value that is not finite reached the factorization
            failure = NOT_FINITE
            break
        steps += 1
        last = int(np.searchsorted(times, solver.t, "right"))
        if solver.status != "failed" and last > reached:
            problem.sink(reached, solver.dense_output()(times[reached:last]).T)
            reached = last
        if watch.expired(solver.t) or steps >= problem.max_steps:
            failure = TOO_MANY if steps >= problem.max_steps else TOO_LONG
            break
    if solver.status == "failed":
        failure = COLLAPSED
    counts = {"steps": steps, "jacobians": solver.njev}
    return Outcome(float(solver.t), solver.y.copy(), reached, failure, False, counts)


def _rhs(problem: Problem):
    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(problem.system.n)
        problem.system.rhs(t, x, out)
        return out

    return rhs


def _jacobian(problem: Problem):
    system = problem.system
    if system.n <= _DENSE:
        return lambda t, x: system.jacobian(t, x)
    from scipy.sparse import csc_matrix

    indptr, indices = system.pattern()

    def jacobian(t: float, x: np.ndarray):
        values = np.empty(len(indices))
        system.jacobian_values(t, x, values)
        return csc_matrix((values, indices, indptr), shape=(system.n, system.n))

    return jacobian
