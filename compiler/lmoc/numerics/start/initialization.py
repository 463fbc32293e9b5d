"""The start of a run: fixed values hold, start values are met as closely as possible, the rest of the states is zero.

Most start values sit on states and are taken over at once. What sits on other variables, and initial equations, are met
by Gauss–Newton steps (`gauss_newton`), each a lexicographic least squares problem: fixed values first, start values in
what they leave free, then the smallest states. Parts that share no state are solved apart, equal ones together.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.messages.diagnostics import Report
from lmoc.messages.ranges import LOOKED_AT, report_alike
from lmoc.numerics.plan import Plan
from lmoc.numerics.start.gauss_newton import Start, descend, elsewhere, straight_rows
from lmoc.numerics.start.lexicographic import split
from lmoc.numerics.start.singular import StartSingular
from lmoc.numerics.start.start_system import StartSystem
from lmoc.numerics.start.targets import Targets
from lmoc.structure.messages.equations import SHOWN, listed


def initial_state(
    plan: Plan,
    base: np.ndarray,
    signals: Mapping,
    values: np.ndarray,
    time: float,
    wanted: Targets,
    report: Report,
) -> np.ndarray:
    """States and quadratures at the start.

    Parameters
    ----------
    base : registers that do not change during the run (`Plan.base`)
    wanted : from `targets`

    Returns
    -------
    (n,) array; complete where `report` has no new errors: E0531 for fixed values that contradict each other, E0532
    where no solution was found, E0535 where a value is lost, E0536 where an initial equation asks for what nobody
    knows. W0533 is for start values that cannot be met.
    """
    flat = plan.reduced.flat
    x = np.zeros(len(plan.states))
    position = np.full(plan.count, -1)
    position[plan.states] = np.arange(len(x))
    register = plan.reduced.register_of[wanted.variable]
    at = np.where(register >= 0, position[register], -1)
    direct = at >= 0
    counts = np.bincount(at[direct], minlength=len(x))
    if direct.all() and (counts <= 1).all() and not flat.initial_groups:
        x[at] = wanted.value
        return x
    # a first point: what stands on states, the fixed values last
    for level in (False, True):
        own = direct & (wanted.hard == level)
        x[at[own]] = wanted.value[own]
    open_ = register >= 0
    kept = Targets(*(column[open_] for column in (wanted.variable, wanted.value, wanted.hard, wanted.given)))
    system = StartSystem(plan, base, signals, values, time, kept, report)
    if not report.errors:
        _solve(system, x, _guess(plan, x, at[direct]), report)
        own = direct & wanted.hard
        x[at[own]] = wanted.value[own]  # to the last digit
    return x


def seed_blocks(plan: Plan, base: np.ndarray, wanted: Targets) -> None:
    """Let Newton's method begin at the values wanted for the unknowns of nonlinear blocks."""
    solved = [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
    if solved:
        near, values = plan.reduced.block_guess
        base[near] = values
        register = plan.reduced.register_of[wanted.variable]
        own = np.isin(register, np.concatenate(solved))
        base[register[own]] = wanted.value[own]


def _guess(plan: Plan, x: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(n,) another first point: where nobody has said anything, what the constraints allow."""
    guess, nearby = x.copy(), plan.reduced.nearby
    if nearby is not None:
        guess[: len(nearby)] = nearby
        guess[given] = x[given]
    return guess


def _solve(system: StartSystem, x: np.ndarray, guess: np.ndarray, report: Report) -> None:
    """Put the states into x that meet what is wanted, and say what they do not meet.

    Parameters
    ----------
    guess : (n,) where to begin instead, where x leads nowhere or to a place at which something is missed
    """
    _, jacobian = system.evaluate(x)
    components = split(jacobian, system.hard, len(x))
    start = descend(system, components, x)
    if not start.complete:
        rows, columns, _ = start.jacobian
        own = columns[components.together(np.flatnonzero(start.hard | start.soft))[rows]]
        beside = x.copy()
        beside[own] = guess[own]
        if (beside != x).any():
            system.restart()  # blocks follow their branch: they begin again where the constraints allow it, too
            other = descend(system, components, beside)
            start = other if other.better_than(start) else start
    if not start.finite:
        rows, columns, values = start.jacobian
        lost = np.concatenate([rows[~np.isfinite(values)], np.flatnonzero(~np.isfinite(start.residual))])
        own = columns[components.together(lost)[rows]]
        x[own] = guess[own]
        start = descend(system, components, x)
    straight = np.ones(len(system.value), bool)
    if not start.complete:
        straight = straight_rows(system, x)
        start = elsewhere(system, components, x, start, straight)
    x[:] = start.x
    lost = np.flatnonzero(~np.isfinite(start.residual))
    if len(lost):
        system.evaluate(start.x)
        found, span = system.lost(int(lost[0]))
        report.error("E0535", f"{found} at the start", span, hint="look at the start values, and at divisions by zero")
        raise StartSingular(report.diagnostics, system.plan.reduced.state_names, span)
    groups, found = components.connected(np.flatnonzero(start.hard)), Report()
    order = np.argsort(start.jacobian[0], kind="stable")
    by_row = tuple(column[order] for column in start.jacobian)
    for group in groups[:LOOKED_AT]:
        first, end = (np.searchsorted(by_row[0], group, side) for side in ("left", "right"))
        own = np.concatenate([np.arange(a, b) for a, b in zip(first, end, strict=True)])
        certain = components.excluded(tuple(column[own] for column in by_row), start.residual, group, straight)
        (_report_contradiction if certain else _report_nothing_found)(system, group, start, found)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(groups) - LOOKED_AT))  # type: ignore[attr-defined]
    if not start.hard.any():
        _report_missed(system, np.flatnonzero(start.soft), start, report)


def _report_contradiction(system: StartSystem, group: np.ndarray, start: Start, report: Report) -> None:
    who = _listed(system, group)
    fixed = "the fixed values " if (group < len(system.targets)).all() else ""
    if len(group) == 1:
        message, hint = f"the model does not allow {who} at the start", ""
    else:
        message = f"{fixed}{who} contradict each other"
        hint = "fix fewer of them, or values that fit the constraints between them"
    found = f"the nearest the model allows is {_reached(system, group, start)}"
    report.error("E0531", message, system.span_of(group), found=found, hint=_with_given(system, group, hint))


def _report_nothing_found(system: StartSystem, group: np.ndarray, start: Start, report: Report) -> None:
    hint = "perhaps there is none; if there is, start values (start = …) near a solution lead to it"
    found = f"the nearest that was found is {_reached(system, group, start)}"
    message, hint = f"no start was found with {_listed(system, group)}", _with_given(system, group, hint)
    report.error("E0532", message, system.span_of(group), found=found, hint=hint)


def _report_missed(system: StartSystem, rows: np.ndarray, start: Start, report: Report) -> None:
    if not len(rows):
        return
    value = system.value + start.residual
    names = listed([f"{system.text(k)} (starts at {value[k]:.6g})" for k in rows.tolist()])
    report.warning(
        "W0533",
        f"the start values contradict each other: {names}",
        system.span(int(rows[0])),
        hint="fixed = true on the ones that matter makes the others follow",
    )


def _listed(system: StartSystem, group: np.ndarray) -> str:
    return listed([system.text(k) for k in group.tolist()])


def _with_given(system: StartSystem, group: np.ndarray, hint: str) -> str:
    """A hint, and which of the values do not stand in the model."""
    names = [system.text(k) for k in group.tolist() if system.given(k)]
    told = f"given for this run (--init, initial=): {listed(names)}" if names else ""
    return "; ".join(filter(None, [told, hint]))


def _reached(system: StartSystem, group: np.ndarray, start: Start) -> str:
    """Describe the end of the iteration: values, and residuals of equations."""
    return ", ".join(system.reached(k, float(start.residual[k])) for k in group[:SHOWN].tolist())
