"""The choice of the integrator while a run goes on, with the reason.

The choice follows from the model, its values and the options: never from the clock, the cache or earlier runs.
After reduction most mechanisms are not stiff, and DOP853 is fast and accurate (BDF loses energy of undamped motion).
So it begins, but in small scenes without kinks, where a Taylor series is faster from the first step on. Three things
are looked at on the way:

* After some steps it is known how many lie ahead. The errors of steps add up as long as the motion remembers them:
  what is undamped remembers them for good, so that the error of a long run is many times that of a step. The tolerance
  of the steps is made finer by as much, from the beginning on.
* Where many steps lie ahead, a Taylor series does with fewer and cheaper ones, which pays for the change; from
  then on the segments of the run begin along it.
* DOP853 notices stiffness by itself; a stiff method, chosen by the eigenvalues of the Jacobian, goes on from there.

The bounds come from charts of speed against accuracy over the models (`benchmarks/auto.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.numerics.limits import FINEST_SMOOTH
from lmoc.numerics.plan.linearity import is_linear
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome, PlanCost, Problem
from lmoc.numerics.problem.status import Status
from lmoc.numerics.problem.system import System
from lmoc.numerics.steps.added_errors import bdf_factor, calibration, refinement
from lmoc.numerics.steps.modes import EIGENVALUES, Modes
from lmoc.numerics.steps.series_rule import LOOKED_AT, is_better
from lmoc.support.records import dataclass, replace

NOT_STIFF = "not stiff"  # why a method goes on as it has begun
TRIAL = 40  # steps after which the rest of a run is judged
_AGAIN = 4  # times as many steps later it is judged again
OVERRUN = 60  # steps ahead up to which a run goes on as it has begun
_SHORT = 0.2  # of the steps before: a series whose steps are shorter is at odds with the equations, as where stiff
_COMPARED = 15  # steps of DOP853 that tell how long those of a series should be
_SERIES_WORK, _SERIES_WORK_AT = 1.2e5, 1e-4  # steps times rows up to which a series is faster than BDF at a tolerance
_LOOK = 500  # rows that take as long as a look at a step in Python, for events and closures
_LIMIT = 6.0  # |h·λ| at the edge of the stability region of an explicit method
_LEAST_PATIENCE = 2_000  # steps that DOP853 may still need where it finds the problem stiff
_LOOKED_AT_PATIENCE = 300  # the same where conditions are looked at in Python in each step, which takes as long as many
_WORK = 4e7  # rows evaluated in that time
_FOLLOWED = 300  # times as many steps where a fast swinging mode is at work: any method must follow it
_GIVEN_UP = (Status.STIFF, Status.COLLAPSED, Status.NOT_FINITE)

Integrate = Callable[[Problem, str], Outcome]


@dataclass(frozen=True)
class Leg:
    """A part of a run with one method.

    Attributes
    ----------
    name : of the method
    factor : on the tolerances
    most : steps; None for as many as the run may have
    overrun : steps by which these may be exceeded where so many are expected to reach the end: where fewer lie
        ahead than a Taylor series needs to pay, and their errors do not add up
    shortest : s, mean length of steps below which a Taylor series gives up
    """

    name: str
    factor: float = 1.0
    most: int | None = None
    overrun: int = 0
    shortest: float = 0.0


@dataclass(frozen=True)
class Used:
    """The methods used in sequence, the reasons, and the stiff method that goes on behind the next break, if any."""

    solvers: tuple[str, ...]
    reason: str
    onward: str = ""


def automatically(problem: Problem, integrate: Integrate) -> tuple[Outcome, Used]:
    """Integrate where nothing jumps.

    Parameters
    ----------
    integrate : by the name of a method
    """
    way = Way(replace(problem, patience=patience(problem.system, problem.roots is not None)))
    rule = legs(way)
    try:
        while True:
            leg = next(rule)
            way.arrive(leg, integrate(way.ahead(leg), leg.name))
    except StopIteration as end:
        return end.value


def legs(way: Way) -> Generator[Leg, None, tuple[Outcome, Used]]:
    """Yield one leg of a run after the other, each when the one before has arrived; return how the run has ended."""
    problem, reason, factor = way.problem, NOT_STIFF, 1.0
    outcome = yield from _begin(way)
    if outcome.status is Status.TOO_MANY_STEPS and not way.is_exhausted:
        outcome, finer, factor = yield from _long_way(way)
        reason += finer
    if outcome.status not in _GIVEN_UP:
        return outcome, Used(tuple(way.solvers), reason)
    name, why = stiff_method(problem, outcome)
    met = "stiffness" if outcome.status is Status.STIFF else outcome.status.value
    reason = f"{met} at t = {outcome.time:.4g} s, then {why}"
    if name == "dop853":  # it follows, whatever that takes
        way.problem = replace(problem, patience=np.inf)
        outcome, finer, _ = yield from _long_way(way)
        return outcome, Used(tuple(way.solvers), reason + finer, "dop853")
    if name in ("cvode", "ida"):
        factor = bdf_factor(problem, outcome, _jacobian(problem, outcome))
    else:
        factor *= calibration(problem)
    outcome = yield from way.go(Leg(name, factor))
    return outcome, Used(tuple(way.solvers), reason, way.solvers[-1])


Going = Generator[Leg, None, Outcome]


def _begin(way: Way) -> Going:
    """Make the first steps: along a Taylor series in a small scene and where it has paid for one, else with DOP853.

    Where there are kinks, a piece between two of them may be a single step, of which DOP853 has less work.
    """
    system, first, spent = way.problem.system, TRIAL, way.spent
    if way.problem.pieces is None and _pays(system, spent):
        spent.series = True
        if system.n <= LOOKED_AT:
            outcome = yield from way.go(Leg("taylor", most=TRIAL, overrun=OVERRUN))
            if outcome.status not in _GIVEN_UP:
                return outcome
        else:  # how long its steps are shall tell whether the series gets on
            first = _COMPARED
    overrun = OVERRUN if first == TRIAL else 0
    return (yield from way.go(Leg("dop853", calibration(way.problem), first, overrun)))


def _pays(system: System, spent: PlanCost) -> bool:
    return is_better(system, np.inf if spent.series else spent.steps)


def begins_along_series(system: System, spent: PlanCost) -> bool:
    """Return whether `TRIAL` steps of a segment are made along a Taylor series, where it is one piece."""
    return system.n <= LOOKED_AT and _pays(system, spent)


def _long_way(way: Way) -> Generator[Leg, None, tuple[Outcome, str, float]]:
    """Go on where many steps lie ahead; also what to say of their tolerance, and the factor on it.

    What lies ahead is judged by the latest steps, and again when there are several times as many: those of a transient
    tell little of what follows it.
    """
    problem, block, begun, made, text, factor, said = way.problem, TRIAL, way.problem.t, 0, "", 1.0, 1.0
    while True:
        outcome, steps = way.outcome, way.outcome.counts["steps"]
        if steps == made:  # all have been rejected
            return (yield from way.go(Leg("dop853", factor * calibration(problem)))), text, factor
        mean, ahead = (outcome.time - begun) / (steps - made), problem.end - outcome.time
        modes = way.modes(problem, outcome)
        series = _suits_series(way, modes, mean, ahead)
        stiff = not series and _is_stiff(modes, ahead, problem.patience)
        if stiff and problem.system.plan.once(is_linear):  # so it is everywhere
            outcome.status = Status.STIFF
            return outcome, text, factor
        # where that may be so here alone, DOP853 notices it, if no finer tolerance keeps its steps short
        unclear = stiff and ahead > problem.patience * mean
        factor = 1.0 if unclear else refinement(problem, modes, mean, series)
        if factor < 1.0 and block == TRIAL:
            way.begin_again()
        begun, made, block = way.outcome.time, steps, block * _AGAIN
        if not 0.5 < factor / said < 2.0:
            said, text = factor, _since(way, factor, ahead / mean, series) if factor < 1.0 else ""
        outcome = yield from _go_on(way, factor, series, block, _SHORT * mean)
        if outcome.status is not Status.TOO_MANY_STEPS or way.is_exhausted:
            return outcome, text, factor


def _suits_series(way: Way, modes: Modes, mean: float, ahead: float) -> bool:
    """Return whether a Taylor series does what lies ahead faster than DOP853 and, where it is stiff, than BDF."""
    problem, spent = way.problem, way.spent
    if _is_stiff(modes, ahead, _series_patience(problem)):
        return False
    whole = ahead + np.fmax(problem.whole - problem.end, 0.0)  # behind this segment the run goes on
    if not is_better(problem.system, np.inf if spent.series else spent.steps + whole / mean):
        return False
    spent.series = True
    return True


def _since(way: Way, factor: float, ahead: float, series: bool) -> str:
    """Say why the tolerance is finer from here on."""
    rtol = max(way.problem.rtol * factor * (1.0 if series else calibration(way.problem)), FINEST_SMOOTH)
    because = f"since the errors of some {float(f'{ahead:.1g}'):.0f} steps add up"
    return f"; at rtol {rtol:.1g} from t = {way.outcome.time:.3g} s, {because}"


def _go_on(way: Way, factor: float, series: bool, most: int, shortest: float) -> Going:
    """Make some steps along a Taylor series or with DOP853, which takes over where the series does not get on."""
    if series:
        outcome = yield from way.go(Leg("taylor", factor, most, OVERRUN, shortest))
        if outcome.status not in _GIVEN_UP:
            return outcome
    return (yield from way.go(Leg("dop853", factor * calibration(way.problem), most, OVERRUN)))


class Way:
    """A run on its way through several methods.

    Attributes
    ----------
    problem : as a whole, with the steps that DOP853 may still need where it finds it stiff
    outcome : where it stands
    solvers : used so far
    spent : by this run so far
    modes : returns the modes where a problem stands
    """

    def __init__(self, problem: Problem, modes: Callable[[Problem, Outcome], Modes] = Modes) -> None:
        self.problem, self.modes = problem, modes
        self.outcome = Outcome(problem.t, problem.x, 0)
        self.solvers: list[str] = []
        self.spent = problem.spent.setdefault(problem.system.plan, PlanCost())
        self._evaluated = 0  # before the leg under way

    def begin_again(self) -> None:
        """Go back to the beginning, since the first errors are felt for longest.

        Not where somebody has looked at the steps, or blocks go on from their last solutions, on one of their branches.
        """
        problem = self.problem
        blocks = problem.system.plan.once(_has_nonlinear_blocks)
        if not problem.needs_steps and problem.correction is None and not blocks:
            self.outcome = replace(self.outcome, time=problem.t, x=problem.x, reached=0)

    @property
    def is_exhausted(self) -> bool:
        """Return whether there have been as many steps as the run is allowed."""
        counts = self.outcome.counts
        return counts.get("steps", 0) + counts.get("rejected", 0) >= self.problem.max_steps

    def go(self, leg: Leg) -> Going:
        """Go on with a method from where the last one has stopped."""
        yield leg
        return self.outcome

    def ahead(self, leg: Leg) -> Problem:
        """Return the problem of a leg."""
        problem, before = self.problem, self.outcome
        done, self._evaluated = before.reached, problem.system.evaluations
        rtol, atol = self.tolerances(leg)
        most, overrun = self.steps(leg)
        return replace(
            problem,
            t=before.time,
            x=before.x,
            times=problem.times[done:],
            rtol=rtol,
            atol=atol,
            max_steps=most,
            overrun=overrun,
            first_step=self.first_step(leg),
            shortest=leg.shortest,
            pieces=None if self.solvers else problem.pieces,  # the first method alone
            sink=lambda first, states: problem.sink(first + done, states),
        )

    def steps(self, leg: Leg) -> tuple[int, int]:
        """Return the steps that a leg may take, and by how many it may exceed them."""
        counts = self.outcome.counts
        left = self.problem.max_steps - counts.get("steps", 0) - counts.get("rejected", 0)
        if leg.most is None:
            return left, 0
        return min(leg.most, left), leg.overrun if leg.most + leg.overrun <= left else 0

    def tolerances(self, leg: Leg) -> tuple[float, np.ndarray]:
        """Return the tolerances of a leg, relative and absolute (n,)."""
        problem = self.problem
        rtol = max(problem.rtol * leg.factor, min(problem.rtol, FINEST_SMOOTH))
        return rtol, problem.atol * (rtol / problem.rtol)

    def first_step(self, leg: Leg) -> float:
        """Return the first step of a leg, s; infinity where its method is to find it."""
        return self.outcome.step if self.solvers[-1:] == [leg.name] else np.inf

    def arrive(self, leg: Leg, later: Outcome) -> None:
        """Take the outcome of a leg."""
        problem, before = self.problem, self.outcome
        name = later.solver or leg.name
        if name == "dop853":
            self.spent.steps += later.counts.get("steps", 0)
        later.reached += before.reached
        if "evaluations" in later.counts and before.counts:  # SUNDIALS counts its own, and the system those of Python
            later.counts["evaluations"] += self._evaluated
        earlier = before.evaluation or problem.system.description
        if before.counts and later.evaluation and later.evaluation != earlier:
            later.evaluation = f"{earlier}, then {later.evaluation}"
        later.counts = {k: before.counts.get(k, 0) + later.counts.get(k, 0) for k in before.counts | later.counts}
        if self.solvers[-1:] != [name]:
            self.solvers.append(name)
        self.outcome = later


# ---------------------------------------------------------------------- stiffness


def _jacobian(problem: Problem, outcome: Outcome) -> np.ndarray | None:
    """Return the Jacobian at a place, None where it is too large for its eigenvalues or not finite."""
    if problem.system.n > EIGENVALUES:
        return None
    with np.errstate(all="ignore"):
        jacobian = problem.system.jacobian(outcome.time, outcome.x)
    return jacobian if np.isfinite(jacobian).all() else None


def _has_nonlinear_blocks(plan: Plan) -> bool:
    return any(isinstance(s, Solve) and not s.linear for s in walk(plan.program))


def patience(system: System, looked_at: bool = False) -> float:
    """Steps that are still cheaper for DOP853 than another method is.

    Parameters
    ----------
    looked_at : whether conditions are looked at in each step
    """
    if looked_at:
        return _LOOKED_AT_PATIENCE
    return min(max(_WORK / (16 * max(1, system.plan.row_count)), _LEAST_PATIENCE), system.most_steps)


def _series_patience(problem: Problem) -> float:
    """Return the steps of a Taylor series that are still cheaper than BDF, whose steps are more the finer they are."""
    looked_at = problem.roots is not None or (problem.guard is not None and problem.compiled_guard is None)
    rows = problem.system.plan.row_count + (_LOOK if looked_at else 0)
    return _SERIES_WORK * (problem.rtol / _SERIES_WORK_AT) ** -0.2 / max(5, rows)


def _is_stiff(modes: Modes, ahead: float, steps: float) -> bool:
    """Return whether a mode that decays asks an explicit method for more steps than that.

    The steps so far do not tell, since a transient may have kept them short.

    Parameters
    ----------
    ahead : s
    """
    return modes.relaxation * ahead > _LIMIT * steps


def stiff_method(problem: Problem, outcome: Outcome) -> tuple[str, str]:
    """Return the method that takes over where DOP853 has given up, and why.

    BDF where the fastest mode decays. Where it swings BDF is not stable, and Radau steps over it if its amplitude is
    below the tolerance; if not it must be followed, which explicit methods do best.
    """
    from lmoc.numerics.sundials import sundials

    system = problem.system
    if problem.correction is not None:
        return "radau", "Radau, which goes on from a corrected state without loss"
    jacobian = _jacobian(problem, outcome)
    if jacobian is None:
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
        return "dop853", f"explicit methods again, because the fastest mode is at work ({abs(fastest):.3g} rad/s)"
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
