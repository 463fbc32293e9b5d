"""The start of a run: fixed values hold, start values are met as closely as possible, the rest of the states is zero.

Most start values sit on states and are taken over at once. What sits on other variables, and initial equations, are met
by Gauss–Newton steps (`solving`, imported where it is needed), each a lexicographic least squares problem: fixed values
first, start values in what they leave free, then the smallest states. Parts that share no state are solved apart, equal
ones together.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.ir.reduced import StartGuess
from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.event import Event
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.start.assembly_notes import note_assemblies
from lmoc.numerics.start.targets import Targets

_MET = 1e-9  # of the size, within which a closure has a coordinate that was wanted


def initial_state(
    plan: Plan,
    base: np.ndarray,
    signals: Mapping,
    values: np.ndarray,
    time: float,
    wanted: Targets,
    guess: StartGuess | None,
    report: Report,
    events: list[Event],
    first: np.ndarray | None = None,
) -> np.ndarray:
    """States and quadratures at the start.

    Parameters
    ----------
    base : registers that do not change during the run (`Plan.base`)
    wanted : from `targets`
    guess : from `start_guess`
    events : gets the impacts by which contradicting velocities of inertias come to agree
    first : (n,) where a solution is looked for; what stands on states without it

    Returns
    -------
    (n,) array; complete where `report` has no new errors: E0531 for fixed values that contradict each other, E0532
    where no solution was found, E0535 where a value is lost, E0536 where an initial equation asks for what nobody
    knows. W0533 is for start values that cannot be met.
    """
    flat = plan.reduced.flat
    x = np.zeros(len(plan.states))
    register = plan.reduced.register_of[wanted.variable]
    at = states_of(plan, register)
    direct = at >= 0
    counts = np.bincount(at[direct], minlength=len(x))
    closed = guess if guess is not None and guess.closed else None
    if direct.all() and (counts <= 1).all() and not flat.initial_groups:
        note_assemblies(flat, guess, wanted, report)
        return _taken_over(closed, wanted, at, x)
    key = None if signals else (time, *(a.tobytes() for a in (base, values, *_columns(wanted))))
    last = plan.once(_Solved)
    solved = plan.once(_solved)
    if key is not None and last.key == key:
        base[solved] = last.branch
        return last.x.copy()
    from lmoc.numerics.start.solving import solve
    from lmoc.numerics.start.start_system import StartSystem

    if first is not None:
        x[:] = first
    # a first point: what stands on states, what counts most last
    order = np.lexsort((-flat.start_rank[wanted.variable], wanted.hard))
    own = order[direct[order]]
    x[at[own]] = wanted.value[own]
    open_ = register >= 0
    kept, said = Targets(*(column[open_] for column in _columns(wanted))), len(report.diagnostics)
    rest = None if closed is None else _guessed(closed, np.zeros(len(x)), at[:0])
    system = StartSystem(plan, base, signals, values, time, kept, report, closed, rest)
    if not report.errors:
        impacts = solve(system, x, _guessed(guess, x, at[direct]), guess, report)
        events += [impact.event(system) for impact in impacts]
        overruled = np.isin(at, np.concatenate([impact.states for impact in impacts])) if impacts else False
        own = direct & wanted.hard & ~np.broadcast_to(overruled, direct.shape)
        x[at[own]] = wanted.value[own]  # to the last digit
        if not report.errors:
            note_assemblies(flat, guess, wanted, report)
        if not report.errors and len(solved):
            base[solved] = system.unknowns(x, solved)  # the run goes on where loops are closed as they were found
        if not impacts and len(report.diagnostics) == said:  # nothing to report again
            last.key, last.x, last.branch = key, x.copy(), base[solved]
    return x


def states_of(plan: Plan, register: np.ndarray) -> np.ndarray:
    """Return the numbers of the states in registers, -1 for what is none."""
    position = np.full(plan.count, -1)
    position[plan.states] = np.arange(len(plan.states))
    result: np.ndarray = np.where(register >= 0, position[register], -1)
    return result


def _taken_over(closed: StartGuess | None, wanted: Targets, at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the states where all that is wanted stands on them, at most once on each: what is fixed holds exactly."""
    x[at] = wanted.value
    if closed is not None:
        x = _guessed(closed, x, at)
        x[at[wanted.hard]] = wanted.value[wanted.hard]
    return x


class _Solved:
    """The last start of a plan that was solved for: runs from the same start are many."""

    def __init__(self, plan: Plan) -> None:
        self.key: tuple | None = None
        self.x = np.zeros(len(plan.states))
        self.branch = np.zeros(0)  # the unknowns of nonlinear blocks there


def _columns(wanted: Targets) -> tuple[np.ndarray, ...]:
    return wanted.variable, wanted.value, wanted.hard, wanted.given


def seed_blocks(plan: Plan, base: np.ndarray, wanted: Targets, guess: StartGuess | None) -> None:
    """Let Newton's method begin where the constraints hold nearby, else at the values wanted for its unknowns."""
    solved = plan.once(_solved)
    if not len(solved):
        return
    register = plan.reduced.register_of[wanted.variable]
    own = np.isin(register, solved)
    base[register[own]] = wanted.value[own]
    if guess is not None:
        kept = np.full(len(guess.unknowns), guess.closed) | ~np.isin(guess.unknowns, register[own])
        base[guess.unknowns[kept]] = guess.values[kept]


def start_guess(plan: Plan, values: np.ndarray, wanted: Targets) -> StartGuess | None:
    """Return where a start with nonlinear constraints is looked for.

    Parameters
    ----------
    values : (flat.count,) parameter values
    """
    reduced = plan.reduced
    same = not wanted.given.any() and np.array_equal(values, reduced.values, equal_nan=True)
    if same or reduced.guess_at is None:
        return reduced.guess
    if is_given(plan, wanted.variable):
        return None
    return reduced.guess_at(values, (wanted.variable[wanted.given], wanted.value[wanted.given]))


def is_given(plan: Plan, variables: np.ndarray) -> bool:
    """Return whether start values are given for all states, and all else follows from these, as in a tree of joints."""
    reduced = plan.reduced
    if reduced.constraints is not None or reduced.invariants is not None or len(plan.once(_solved)):
        return False
    return bool(np.isin(reduced.states, reduced.register_of[variables]).all())


def _solved(plan: Plan) -> np.ndarray:
    """The registers of the unknowns of nonlinear blocks."""
    blocks = [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
    return np.concatenate([np.zeros(0, int), *blocks])


def _guessed(guess: StartGuess | None, x: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(n,) another first point: where nobody has said anything, what the constraints allow.

    Where loops are closed nearest to what is wanted, a coordinate that is missed there is theirs: from where a guess
    has it, another branch may begin, or nothing at all.
    """
    first = x.copy()
    if guess is not None:
        own = first[: len(guess.states)]
        own[:] = guess.states
        first[given] = x[given]
        if guess.closed:
            missed = np.abs(own - guess.states) > _MET * (1.0 + np.abs(guess.states))
            own[missed] = guess.states[missed]
    return first
