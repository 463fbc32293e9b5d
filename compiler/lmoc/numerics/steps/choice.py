"""The integrators by name, and a run from one break of its right-hand side to the next."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.problem.base import REQUESTED, Outcome, Pieces, Problem, Properties
from lmoc.numerics.problem.status import Inapplicable, NotFound, Status, Unsuitable, interruption
from lmoc.numerics.steps import loop
from lmoc.numerics.steps.automatic import Used, automatically
from lmoc.support.records import replace

NAMES = (
    "dop853", "taylor", "cvode", "adams", "ida", "cvodes", "idas", "radau", "gauss", "rk4", "midpoint", "verlet",
    "generalized-alpha", "collocation", "collocation-radau",
)  # fmt: skip


_FEW, _MANY = 64, 16_384  # pieces that are looked ahead
_NEAR, _LEAST = 4e-15, 1e-300  # of the time, s: a distance in time that does not count


def table() -> tuple[Properties, ...]:
    """Return the properties of each integrator, time stepping of scenes with laws included."""
    from lmoc.numerics.laws.time_stepping import PROPERTIES

    return *(_module(name).PROPERTIES for name in NAMES), PROPERTIES


def _module(name: str):
    return import_module(f"lmoc.numerics.steps.{name.replace('-', '_')}")


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
        try:
            return loop.integrate(problem, module.begin(problem))
        except Inapplicable as error:
            instead, why = "dop853", f": {error}"
    else:  # a whole run in one call
        outcome = module.integrate(problem)
        if outcome is not None:
            return outcome
        instead, why = getattr(module, "INSTEAD", None), ""
        if instead is None:
            reason = "casadi integrates small smooth scenes only, without events, closed loops and times that coincide"
            raise Unsuitable(reason, "gauss and radau work for all scenes")
    return replace(loop.integrate(problem, _module(instead).begin(problem)), solver=instead, why=why)


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


def _in_pieces(problem: Problem, solver: str) -> tuple[Outcome, Used]:
    outcome, used, method = Outcome(problem.t, problem.x, 0), None, solver
    begin, passed = problem.t, -np.inf
    ahead, following = edges(problem), _Following(problem)
    while True:
        try:
            edge = next(ahead)
        except KeyboardInterrupt:  # while a callable was looked at
            outcome.status = interruption()
            return outcome, used or Used((), "")
        if edge < passed:
            continue
        if edge - near(edge) / 2 <= begin:  # a kink at the start
            begin = edge + near(edge) / 2
            continue
        if begin >= problem.end:
            break
        later, own = _smooth(_until(problem, outcome, (begin, edge), following), method)
        later.counts = _added(outcome.counts, later.counts)
        later.matrix, later.evaluation = later.matrix or outcome.matrix, later.evaluation or outcome.evaluation
        later.reached += outcome.reached
        outcome, passed = later, later.time
        begin = max(edge + near(edge) / 2, passed)
        if used is None or own.onward:
            used = own
        if own.onward:  # a stiff method goes on behind the next break
            method = own.onward
        if outcome.status is not Status.OK or edge >= problem.end:
            break
    if len(problem.breaks):
        outcome.counts["breaks"] = int(np.searchsorted(problem.breaks, outcome.time + near(outcome.time), "right"))
    return outcome, used


def edges(problem: Problem) -> Iterator[float]:
    """Yield the breaks of a problem, and where other bounds on the steps begin; infinity at last."""
    begin = problem.t
    if problem.lookout.is_free:
        for first in range(0, len(problem.breaks), _FEW):  # an event may come soon
            yield from problem.breaks[first : first + _FEW].tolist()
        yield np.inf
        return
    for edge in (*problem.breaks.tolist(), np.inf):
        yield from problem.lookout.edges(begin, min(edge, problem.end))
        yield edge
        begin = max(begin, edge)


class _Following:
    """The pieces behind the one under way, more of them the more of them have been passed."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self._most, self._until = problem, _FEW, problem.t
        self._edges: np.ndarray | None = None  # those of callables show on the way only
        if len(problem.breaks) and problem.lookout.is_known:
            self._edges = problem.breaks if problem.lookout.is_free else np.array([*edges(problem)][:-1])

    def behind(self, begin: float, reached: int) -> Pieces | None:
        """Return what follows the piece that begins at a time, as `_until` would make it.

        Parameters
        ----------
        reached : output times up to the end of that piece
        """
        problem, every = self.problem, self._edges
        if every is None:
            return None
        self._most = min(2 * self._most, _MANY) if begin >= self._until else _FEW
        first = int(np.searchsorted(every, begin, "right"))
        edge = every[first : first + self._most]
        aside = _NEAR * np.maximum(np.abs(edge), _LEAST)
        begins, ends, seen = edge + aside / 2, edge - aside / 2, edge + aside
        if first + self._most >= len(every):  # the last one ends with the problem
            ends, seen = np.append(ends, problem.end), np.append(seen, np.inf)
        begins, ends, seen = begins[: len(ends) - 1], np.minimum(ends[1:], problem.end), seen[1:]
        whole = begins < ends
        begins, ends, seen = begins[whole], ends[whole], seen[whole]
        if not len(begins):
            return Pieces((begins, ends, ends), np.zeros(0))
        self._until = float(ends[-1])
        times = problem.times[reached : np.searchsorted(problem.times, seen[-1], "right")]
        which = np.searchsorted(seen, times, "left")
        longest = np.full(len(begins), problem.max_step)
        if not problem.lookout.is_free:
            spans = zip(begins.tolist(), ends.tolist(), strict=True)
            longest = np.minimum(longest, [problem.lookout.longest(*span) for span in spans])
        return Pieces((begins, ends, longest), np.minimum(np.maximum(times, begins[which]), ends[which]))


def _until(problem: Problem, outcome: Outcome, span: tuple[float, float], following: _Following) -> Problem:
    """Return the rest of a problem, from just after one edge to just before the next, with outputs on that edge.

    Parameters
    ----------
    span : s, where it begins, and the next edge
    following : the pieces behind
    """
    (begin, edge), done, times = span, outcome.reached, problem.times
    end = min(problem.end, edge - near(edge) / 2)
    longest = min(problem.max_step, problem.lookout.longest(begin, end))
    if begin == problem.t and end == problem.end and longest == problem.max_step and not len(problem.breaks):
        return problem  # nothing divides it
    inside = times[done : np.searchsorted(times, end if np.isinf(edge) else edge + near(edge), "right")]
    return replace(
        problem,
        t=begin,
        x=outcome.x,
        end=end,
        times=np.minimum(np.maximum(inside, begin), end),
        max_step=longest,
        whole=problem.end,
        sink=lambda first, states: problem.sink(first + done, states),
        breaks=np.zeros(0),
        pieces=following.behind(begin, done + len(inside)),
    )


def near(t: float) -> float:
    """A distance in time that does not count: some units of the last digit, by which stages of a step may be off."""
    return _NEAR * max(abs(t), _LEAST) if np.isfinite(t) else 0.0


def _added(one: dict[str, int], two: dict[str, int]) -> dict[str, int]:
    return {k: one.get(k, 0) + two.get(k, 0) for k in one | two}


def _smooth(problem: Problem, solver: str) -> tuple[Outcome, Used]:
    """Integrate where nothing jumps."""
    if solver != "auto":
        outcome = integrate(problem, solver)
        reason = f"in place of {solver}, which cannot do this run{outcome.why}" if outcome.solver else REQUESTED
        return outcome, Used((outcome.solver or solver,), reason)
    return automatically(problem, integrate)
