"""casadi's own integrators: the whole trajectory is one native call, for small smooth systems."""

from __future__ import annotations

import io
import math
from contextlib import redirect_stderr

import numpy as np

from lmoc.numerics.problem.base import Outcome, Problem, on_interrupt
from lmoc.numerics.problem.status import Status, interruption

# between two output times. It does not see that its steps no longer move the time; SUNDIALS, which takes over, does
MAX_STEPS = 20_000
_NOT_GONE = 1e-9  # s: over a shorter interval casadi does not integrate but gives the same state again
_CONVERGED = 1e-12, 1e-9  # last step of Newton's method, in units of the states; the other one where rounding is more
_KEPT = 8  # integrators kept with a system, each for its own times and tolerances

Options = dict[str, object]


def suits(problem: Problem) -> bool:
    """Return whether casadi can take a run.

    It can where the equations are one casadi function of time, states and parameters, nobody looks at the steps, and
    the times are far enough apart.
    """
    if problem.system.casadi_dae() is None or problem.needs_steps or problem.deadline is not None:
        return False
    apart = np.diff(np.concatenate([[problem.t], problem.times, [problem.end]]))
    return bool(apart[:-1].min(initial=np.inf) > 2 * _NOT_GONE and (apart[-1] == 0 or apart[-1] > 2 * _NOT_GONE))


def integrate(problem: Problem, plugin: str, options: Options) -> Outcome | None:
    """Integrate over the output times; None where the integrator does not suit or has failed without a result."""
    if not suits(problem):
        return None
    interrupted = []

    def interrupt(*_) -> None:
        interrupted.append(True)
        raise KeyboardInterrupt

    times = problem.times if problem.end in problem.times[-1:] else np.append(problem.times, problem.end)
    try:
        with on_interrupt(interrupt), redirect_stderr(io.StringIO()):  # where casadi prints each failure of Newton's
            solver = _solver(problem, times, plugin, options)
            result = solver(x0=problem.x, p=problem.system.casadi_dae().parameters)
    except (RuntimeError, KeyboardInterrupt):  # of an interrupt casadi makes a failure of the right-hand side
        # it keeps nothing of a run that fails
        return Outcome(problem.t, problem.x, 0, interruption()) if interrupted else None
    states = np.array(result["xf"]).T
    finite = np.isfinite(states).all(axis=1)
    good = len(states) if finite.all() else int(np.argmin(finite))
    reached = min(good, len(problem.times))
    if reached:
        problem.sink(0, states[:reached])
    status = Status.OK if finite.all() else Status.NOT_FINITE
    time, x = (float(times[good - 1]), states[good - 1]) if good else (problem.t, problem.x)
    return Outcome(time, x, reached, status, _counts(solver.stats()))


def _counts(cost: dict[str, int]) -> dict[str, int]:
    """Return what an integrator tells of its cost; those with fixed steps tell nothing."""
    names = {"steps": "nsteps", "evaluations": "nfevals", "jacobians": "nlinsetups"}
    return {ours: cost[theirs] for ours, theirs in names.items() if theirs in cost}


def adaptive_options(problem: Problem) -> Options:
    """Return the options of SUNDIALS in casadi."""
    options: Options = {
        "reltol": problem.rtol,
        "abstol": float(problem.atol.min()),
        "max_num_steps": min(problem.max_steps, MAX_STEPS),
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
    }
    if np.isfinite(problem.max_step):
        options["max_step_size"] = problem.max_step
    return options


def collocation(problem: Problem, scheme: str) -> Outcome | None:
    """Integrate by casadi's collocation with steps of the given length, shorter where output times require it."""
    if not suits(problem):
        return None
    elements = math.ceil((problem.end - problem.t) / problem.step - 1e-9)
    options: Options = {
        "number_of_finite_elements": elements,
        "interpolation_order": 3,
        "collocation_scheme": scheme,
        "show_eval_warnings": False,
        "rootfinder": "fast_newton",
    }
    for size in _CONVERGED:
        options["rootfinder_options"] = {"show_eval_warnings": False, "abstol": size, "abstolStep": size}
        outcome = integrate(problem, "collocation", options)
        if outcome is not None:
            return outcome
    return Outcome(problem.t, problem.x, 0, Status.NO_CONVERGENCE)


def _solver(problem: Problem, times: np.ndarray, plugin: str, options: Options):
    """Return the integrator for these times and options; casadi fixes both when it is made."""
    import casadi as ca

    dae = problem.system.casadi_dae()
    key = problem.t, times.tobytes(), plugin, str(sorted(options.items()))
    kept = dae.kept
    if key not in kept:
        if len(kept) == _KEPT:
            del kept[next(iter(kept))]
        kept[key] = ca.integrator("run", plugin, dae.equations, problem.t, times, options)
    return kept[key]
