"""casadi's own CVODES: the whole trajectory is one native call, for small smooth systems without sampled inputs."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.integrate.base import Outcome, Problem, Properties, on_interrupt
from lmoc.numerics.integrate.status import Status

# between two output times. It does not see that its steps no longer move the time; `cvode`, which takes over, does
MAX_STEPS = 20_000
PROPERTIES = Properties("cvodes", "BDF", stiff=True, order="1-5", dense="1-5", library="casadi", steps=False)

_NOT_GONE = 1e-9  # s: over a shorter interval casadi does not integrate but gives the same state again
_KEPT = 8  # integrators kept with a system, each for its own times and tolerances


def integrate(problem: Problem) -> Outcome | None:
    """Integrate over the output times; None where casadi's method does not suit or has failed without a result.

    It suits where the equations are one casadi function of time, states and parameters, nobody looks at the steps, and
    the times are far enough apart.
    """
    apart = np.diff(np.concatenate([[problem.t], problem.times, [problem.end]]))
    suits = problem.system.casadi_dae() is not None and not problem.needs_steps and problem.deadline is None
    if not (suits and apart[:-1].min(initial=np.inf) > 2 * _NOT_GONE and (apart[-1] == 0 or apart[-1] > 2 * _NOT_GONE)):
        return None
    interrupted = []

    def interrupt(*_) -> None:
        interrupted.append(True)
        raise KeyboardInterrupt

    times = problem.times if apart[-1] == 0 else np.append(problem.times, problem.end)
    try:
        with on_interrupt(interrupt):
            solver = _solver(problem, times)
            result = solver(x0=problem.x, p=problem.system.casadi_dae().parameters)
    except (RuntimeError, KeyboardInterrupt):  # of an interrupt casadi makes a failure of the right-hand side
        # it keeps nothing of a run that fails
        return Outcome(problem.t, problem.x, 0, Status.INTERRUPTED) if interrupted else None
    states = np.array(result["xf"]).T
    finite = np.isfinite(states).all(axis=1)
    good = len(states) if finite.all() else int(np.argmin(finite))
    reached = min(good, len(problem.times))
    if reached:
        problem.sink(0, states[:reached])
    cost = solver.stats()
    counts = {"steps": cost["nsteps"], "evaluations": cost["nfevals"], "jacobians": cost["nlinsetups"]}
    status = Status.OK if finite.all() else Status.NOT_FINITE
    time, x = (float(times[good - 1]), states[good - 1]) if good else (problem.t, problem.x)
    return Outcome(time, x, reached, status, counts)


def _solver(problem: Problem, times: np.ndarray):
    """Return the integrator for these times and tolerances; casadi fixes both when it is made."""
    import casadi as ca

    dae = problem.system.casadi_dae()
    key = problem.t, times.tobytes(), problem.rtol, float(problem.atol.min()), problem.max_steps, problem.max_step
    kept = dae.kept
    if key not in kept:
        options = {
            "reltol": problem.rtol,
            "abstol": float(problem.atol.min()),
            "max_num_steps": min(problem.max_steps, MAX_STEPS),
            "disable_internal_warnings": True,
            "show_eval_warnings": False,
        }
        if np.isfinite(problem.max_step):
            options["max_step_size"] = problem.max_step
        if len(kept) == _KEPT:
            del kept[next(iter(kept))]
        kept[key] = ca.integrator("run", "cvodes", dae.equations, problem.t, times, options)
    return kept[key]
