"""casadi's own CVODES: the whole trajectory is one native call, for small smooth systems without sampled inputs."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrators import cvode
from lmoc.numerics.integrators.base import NOT_FINITE, Outcome, Problem, Properties
from lmoc.numerics.system import CasadiSystem

# between two output times. It does not see that its steps no longer move the time; `cvode`, which takes over, does
MAX_STEPS = 20_000
PROPERTIES = Properties("cvodes", "BDF", stiff=True, order="1-5", jacobian=True, library="casadi")


def suits(problem: Problem) -> bool:
    """Whether the system is one casadi function of time, states and parameters."""
    return isinstance(problem.system, CasadiSystem) and not problem.system.samplers


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times; by `cvode`, the same method, where casadi's cannot."""
    times = problem.times
    if len(times) == 1:
        return Outcome(float(times[0]), problem.x, 1)
    if not suits(problem):
        return cvode.integrate(problem)
    try:
        solver = _solver(problem)
        result = solver(x0=problem.x, p=problem.system.p)
    except RuntimeError:  # it keeps nothing of a run that fails: the same method again, for the partial result
        return cvode.integrate(problem)
    states = np.array(result["xf"]).T
    finite = np.isfinite(states).all(axis=1)
    reached = len(states) if finite.all() else int(np.argmin(finite))
    if reached:
        problem.sink(1, states[:reached])
    last = states[reached - 1] if reached else problem.x
    cost = solver.stats()
    counts = {"steps": cost["nsteps"], "evaluations": cost["nfevals"], "jacobians": cost["nlinsetups"]}
    return Outcome(float(times[reached]), last, reached + 1, "" if finite.all() else NOT_FINITE, False, counts)


def _solver(problem: Problem):
    """The integrator for these times and tolerances; casadi fixes both when it is made."""
    import casadi as ca

    system = problem.system
    key = problem.times.tobytes(), problem.rtol, float(problem.atol.min()), problem.max_steps
    if key not in system.native_integrators:
        lowered = system.lowered
        dae = {"t": lowered.time, "x": lowered.x, "p": lowered.p, "ode": lowered.out}
        options = {
            "reltol": problem.rtol,
            "abstol": float(problem.atol.min()),
            "max_num_steps": min(problem.max_steps, MAX_STEPS),
            "disable_internal_warnings": True,
            "show_eval_warnings": False,
        }
        grid = problem.times[1:]
        system.native_integrators[key] = ca.integrator("run", "cvodes", dae, float(problem.times[0]), grid, options)
    return system.native_integrators[key]
