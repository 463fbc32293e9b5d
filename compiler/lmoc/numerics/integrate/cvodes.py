"""casadi's own CVODES: the whole trajectory is one native call, for small smooth systems without sampled inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmoc.numerics.integrate import cvode
from lmoc.numerics.integrate.base import Outcome, Problem, Properties, on_interrupt
from lmoc.numerics.integrate.status import Status

# between two output times. It does not see that its steps no longer move the time; `cvode`, which takes over, does
MAX_STEPS = 20_000
PROPERTIES = Properties("cvodes", "BDF", stiff=True, order="1-5", library="casadi")

_NOT_GONE = 1e-9  # s: over a shorter interval casadi does not integrate but gives the same state again
_KEPT = 8  # integrators kept with a system, each for its own times and tolerances


def suits(problem: Problem) -> bool:
    """Whether the system is one casadi function of time, states and parameters, and its times are far enough apart."""
    plain = problem.system.casadi_dae() is not None
    return plain and problem.deadline is None and np.diff(problem.times).min() > 2 * _NOT_GONE


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times; by `cvode`, the same method, where casadi's cannot.

    Raises
    ------
    NotFound
        `cvode` is needed and not at hand.
    """
    if not suits(problem):
        return replace(cvode.integrate(problem), solver="cvode")
    interrupted = []

    def interrupt(*_) -> None:
        interrupted.append(True)
        raise KeyboardInterrupt

    try:
        with on_interrupt(interrupt):
            solver = _solver(problem)
            result = solver(x0=problem.x, p=problem.system.casadi_dae().parameters)
    except (RuntimeError, KeyboardInterrupt):  # of an interrupt casadi makes a failure of the right-hand side
        if interrupted:
            return Outcome(float(problem.times[0]), problem.x, 1, Status.INTERRUPTED)
        # it keeps nothing of a run that fails: the same method again, for the partial result
        return replace(cvode.integrate(problem), solver="cvode")
    states = np.array(result["xf"]).T
    finite = np.isfinite(states).all(axis=1)
    reached = len(states) if finite.all() else int(np.argmin(finite))
    if reached:
        problem.sink(1, states[:reached])
    last = states[reached - 1] if reached else problem.x
    cost = solver.stats()
    counts = {"steps": cost["nsteps"], "evaluations": cost["nfevals"], "jacobians": cost["nlinsetups"]}
    status = Status.OK if finite.all() else Status.NOT_FINITE
    return Outcome(float(problem.times[reached]), last, reached + 1, status, counts=counts)


def _solver(problem: Problem):
    """The integrator for these times and tolerances; casadi fixes both when it is made."""
    import casadi as ca

    dae = problem.system.casadi_dae()
    key = problem.times.tobytes(), problem.rtol, float(problem.atol.min()), problem.max_steps
    kept = dae.kept
    if key not in kept:
        options = {
            "reltol": problem.rtol,
            "abstol": float(problem.atol.min()),
            "max_num_steps": min(problem.max_steps, MAX_STEPS),
            "disable_internal_warnings": True,
            "show_eval_warnings": False,
        }
        if len(kept) == _KEPT:
            del kept[next(iter(kept))]
        kept[key] = ca.integrator("run", "cvodes", dae.equations, float(problem.times[0]), problem.times[1:], options)
    return kept[key]
