"""Choice of the integrator, with the reason.

After reduction most mechanisms are not stiff, and DOP853 is the fastest and the most accurate (BDF loses energy of
undamped motion). So it begins; it notices stiffness by itself, and a stiff method goes on from where it gave up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.integrate import loop
from lmoc.numerics.integrate.base import Outcome, Problem, Properties
from lmoc.numerics.integrate.status import NotFound, Status, Unsuitable

NAMES = (
    "dop853", "taylor", "cvode", "adams", "ida", "cvodes", "idas", "radau", "gauss", "rk4", "midpoint", "verlet",
    "generalized-alpha", "collocation", "collocation-radau",
)  # fmt: skip

_LEAST_PATIENCE = 2_000  # steps that DOP853 may still need where it finds the problem stiff
_WORK = 4e7  # rows evaluated in that time
_EIGENVALUES = 150  # states up to which the Jacobian's eigenvalues are looked at
_FOLLOWED = 15  # times as many steps where a fast swinging mode is at work: any method must follow it
_TIGHTER = 0.1  # factor on the tolerances of BDF, whose global error is larger than its local one by more than DOP853's


def table() -> tuple[Properties, ...]:
    """Return the properties of each integrator."""
    return tuple(_module(name).PROPERTIES for name in NAMES)


def _module(name: str):
    return import_module(f"lmoc.numerics.integrate.{name.replace('-', '_')}")


def integrate(problem: Problem, name: str) -> Outcome:
    """Integrate with one method.

    Where an integrator of casadi does not serve, that of SUNDIALS does, and DOP853 where there is no Taylor series.

    Raises
    ------
    NotFound
        The library that it comes from is not at hand.
    Unsuitable
        The method does not apply to the scene, and no other is of its kind.
    """
    module = _module(name)
    if hasattr(module, "begin"):
        method = module.begin(problem)
        if method is not None:
            return loop.integrate(problem, method)
        instead = "dop853"
    else:  # a whole run in one call
        outcome = module.integrate(problem)
        if outcome is not None:
            return outcome
        instead = getattr(module, "INSTEAD", None)
        if instead is None:
            reason = (
                "casadi integrates small smooth scenes only, without events, and has not taken this run or has failed"
            )
            raise Unsuitable(reason, "gauss and radau take all scenes")
    return replace(loop.integrate(problem, _module(instead).begin(problem)), solver=instead)


def run(problem: Problem, solver: str) -> tuple[Outcome, dict[str, object]]:
    """Integrate with a named solver, or with the one that suits, from one break of the right-hand side to the next.

    Returns
    -------
    The outcome, and for the statistics: which solver, and why.

    Raises
    ------
    ModelError
        E0540: the requested solver needs SUNDIALS, which is not available, or another kind of scene.
    """
    try:
        outcome, used = _in_pieces(problem, solver)
    except NotFound as error:
        message = f"solver '{solver}' cannot be used: the SUNDIALS libraries of scikit-sundae were not found"
        raise ModelError([Diagnostic("E0540", message, hint="dop853 and radau do without them")]) from error
    except Unsuitable as error:
        raise ModelError(
            [Diagnostic("E0540", f"solver '{solver}' cannot be used: {error}", hint=error.hint)]
        ) from error
    return outcome, {"solver": ", ".join(used.solvers), "reason": used.reason}


@dataclass(frozen=True)
class _Used:
    """The methods used in sequence, and the reasons."""

    solvers: tuple[str, ...]
    reason: str


def _in_pieces(problem: Problem, solver: str) -> tuple[Outcome, _Used]:
    outcome, used, method = Outcome(problem.t, problem.x, 0), None, solver
    begin = problem.t
    edges = _edges(problem)
    while True:
        try:
            edge = next(edges)
        except KeyboardInterrupt:  # while a callable was looked at
            outcome.status = Status.INTERRUPTED
            return outcome, used or _Used((), "")
        if edge - _near(edge) / 2 <= begin:  # a kink at the start
            begin = edge + _near(edge) / 2
            continue
        if begin >= problem.end:
            break
        later, own = _smooth(_until(problem, outcome, begin, edge), method)
        later.counts = _added(outcome.counts, later.counts)
        later.matrix, later.evaluation = later.matrix or outcome.matrix, later.evaluation or outcome.evaluation
        later.reached += outcome.reached
        outcome, begin = later, edge + _near(edge) / 2
        taken_over = len(own.solvers) > 1
        if used is None or taken_over:
            used = own
        if taken_over:  # the stiff method goes on behind the next break
            method = own.solvers[-1]
        if outcome.status is not Status.OK or edge >= problem.end:
            break
    if len(problem.breaks):
        outcome.counts["breaks"] = len(problem.breaks)
    return outcome, used


def _edges(problem: Problem) -> Iterator[float]:
    """Yield the breaks of a problem, and where other bounds on the steps begin; infinity at last."""
    begin = problem.t
    for edge in (*problem.breaks.tolist(), np.inf):
        yield from problem.lookout.edges(begin, min(edge, problem.end))
        yield edge
        begin = max(begin, edge)


def _until(problem: Problem, outcome: Outcome, begin: float, edge: float) -> Problem:
    """Return the rest of a problem, from just after one edge to just before the next, with outputs on that edge."""
    done, times = outcome.reached, problem.times
    end = min(problem.end, edge - _near(edge) / 2)
    inside = times[done : np.searchsorted(times, end if np.isinf(edge) else edge + _near(edge), "right")]
    return replace(
        problem,
        t=begin,
        x=outcome.x,
        end=end,
        times=np.minimum(np.maximum(inside, begin), end),
        max_step=min(problem.max_step, problem.lookout.longest(begin, end)),
        sink=lambda first, states: problem.sink(first + done, states),
        breaks=np.zeros(0),
    )


def _near(t: float) -> float:
    """A distance in time that does not count: some units of the last digit, by which stages of a step may be off."""
    return 4e-15 * max(abs(t), 1e-300) if np.isfinite(t) else 0.0


def _added(one: dict[str, int], two: dict[str, int]) -> dict[str, int]:
    return {k: one.get(k, 0) + two.get(k, 0) for k in one | two}


def _smooth(problem: Problem, solver: str) -> tuple[Outcome, _Used]:
    """Integrate where nothing jumps."""
    if solver != "auto":
        outcome = integrate(problem, solver)
        reason = f"in place of {solver}, which does not take this run" if outcome.solver else "asked for"
        return outcome, _Used((outcome.solver or solver,), reason)
    outcome = integrate(replace(problem, patience=patience(problem.system)), "dop853")
    if outcome.status not in (Status.STIFF, Status.COLLAPSED, Status.NOT_FINITE):
        return outcome, _Used(("dop853",), "not stiff")
    spent = problem.system.evaluations
    name, why = stiff_method(problem, outcome)
    later = integrate(_rest(problem, outcome, name), name)
    later.reached += outcome.reached
    later.counts = _added(outcome.counts, later.counts)
    if "evaluations" in later.counts:  # SUNDIALS counts its own, and the system those of Python
        later.counts["evaluations"] += spent
    if later.evaluation:
        later.evaluation = f"{problem.system.description}, then {later.evaluation}"
    met = "stiffness" if outcome.status is Status.STIFF else outcome.status.value
    solvers = ("dop853",) if name == "dop853" else ("dop853", name)
    return later, _Used(solvers, f"{met} at t = {outcome.time:.4g} s, then {why}")


def patience(system: System) -> float:
    """Steps that are still cheaper for DOP853 than another method is."""
    return min(max(_WORK / (16 * max(1, system.plan.row_count)), _LEAST_PATIENCE), system.most_steps)


def stiff_method(problem: Problem, outcome: Outcome) -> tuple[str, str]:
    """Return the method that takes over where DOP853 has given up, and why.

    BDF where the fastest mode decays. Where it swings BDF is not stable, and Radau steps over it if its amplitude is
    below the tolerance; if not it must be followed, which DOP853 does best.
    """
    from lmoc.numerics.integrate.sundials import sundials

    system = problem.system
    jacobian = system.jacobian(outcome.time, outcome.x) if system.n <= _EIGENVALUES else np.array([[np.nan]])
    if not np.isfinite(jacobian).all():
        if not sundials.available():
            return "radau", "Radau, because SUNDIALS is not at hand"
        if system.plan.has_large_blocks:
            return "ida", "BDF on the index-1 form, whose matrix is sparse"
        return "cvode", "BDF"
    values, vectors = np.linalg.eig(jacobian)
    k = int(np.argmax(np.abs(values)))
    fastest = values[k]
    if abs(fastest.imag) <= 3 * abs(fastest.real):
        why = f"because the fastest mode decays (time constant {1 / max(abs(fastest), 1e-300):.3g} s)"
        return ("cvode", f"BDF, {why}") if sundials.available() else ("radau", f"Radau, {why}")
    most = _FOLLOWED * patience(system)
    followed = outcome.status is Status.STIFF and problem.end - outcome.time < most * outcome.step
    if followed and _at_work(problem, outcome, values, vectors, k):
        return "dop853", f"DOP853 again, because the fastest mode is at work ({abs(fastest):.3g} rad/s)"
    return "radau", f"Radau, because the fastest mode swings ({abs(fastest):.3g} rad/s)"


def _at_work(problem: Problem, outcome: Outcome, values: np.ndarray, vectors: np.ndarray, k: int) -> bool:
    """Return whether the amplitude of mode k is above the tolerances."""
    rate = np.empty(problem.system.n)
    problem.system.rhs(outcome.time, outcome.x, rate)
    try:
        amplitude = vectors[:, k] * np.linalg.solve(vectors, rate.astype(complex))[k] / values[k]
    except np.linalg.LinAlgError:
        return True
    allowed = problem.atol + problem.rtol * np.abs(outcome.x)
    return bool((np.abs(amplitude) > allowed).any())


def _rest(problem: Problem, outcome: Outcome, name: str) -> Problem:
    """Return the rest of a problem from where an integrator gave up."""
    done = outcome.reached
    factor = _TIGHTER if name == "cvode" else 1.0
    return replace(
        problem,
        t=outcome.time,
        x=outcome.x,
        times=problem.times[done:],
        rtol=max(problem.rtol * factor, 1e-13),
        atol=problem.atol * factor,
        sink=lambda first, states: problem.sink(first + done, states),
    )
