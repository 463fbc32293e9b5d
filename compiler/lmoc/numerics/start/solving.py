"""Starts that are not given by the states alone: solved, with what cannot be met reported."""

from __future__ import annotations

import numpy as np

from lmoc.ir.reduced import StartGuess
from lmoc.messages.diagnostics import Report, Subject
from lmoc.messages.ranges import LOOKED_AT, report_alike
from lmoc.numerics.start.assembly_notes import note_unmet_guesses
from lmoc.numerics.start.gauss_newton import MISSED_SOFT, ROUNDING, GaussNewtonResult, descend, elsewhere, straight_rows
from lmoc.numerics.start.lexicographic import split
from lmoc.numerics.start.plastic import PlasticImpact, plastic_impact
from lmoc.numerics.start.singular import StartSingular
from lmoc.numerics.start.start_system import StartSystem
from lmoc.structure.messages.equations import SHOWN, listed

_LEFT_OVER = 1e-10  # of the largest state: what is smaller may be the rounding of a zero
_NOTHING = 1e-30  # what is smaller is what rounding has left of rounding
_ULPS = 16  # of what is wanted, by which it may be missed


def solve(
    system: StartSystem, x: np.ndarray, guess: np.ndarray, nearby: StartGuess | None, report: Report
) -> list[PlasticImpact]:
    """Put the states into x that meet what is wanted, and say what they do not meet.

    Parameters
    ----------
    guess : (n,) another place to begin at, where x leads nowhere or to a place at which something is missed
    nearby : what it comes from; if loops are closed there, nearest to what is wanted, it is the first place to begin at

    Returns
    -------
    The impacts by which contradicting velocities of inertias have come to agree.
    """
    closed = nearby is not None and nearby.closed
    _, jacobian = system.evaluate(guess if closed else x)
    components = split(jacobian, system.level, len(x))
    start = descend(system, components, guess if closed else x)
    settled = closed and start.finite and not start.hard.any()
    if not start.complete and not settled:
        rows, columns, _ = start.jacobian
        own = columns[components.together(np.flatnonzero(start.hard | start.soft))[rows]]
        beside = x.copy()
        if not closed:
            beside[own] = guess[own]
        if closed or (beside != x).any():
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
    if not start.complete and not settled:
        straight = straight_rows(system, x)
        start = elsewhere(system, components, x, start, straight)
    x[:] = start.x
    lost = np.flatnonzero(~np.isfinite(start.residual))
    if len(lost):
        system.evaluate(start.x)
        found, span = system.lost(int(lost[0]))
        asked = np.flatnonzero(components.together(lost) & system.hard)
        hint = "look at the start values, and at divisions by zero"
        if len(asked):
            hint = f"perhaps the model does not allow {_listed(system, asked)}; {hint}"
        report.error("E0535", f"{found} at the start", span, hint=hint)
        raise StartSingular(report.diagnostics, system.plan.reduced.state_names, span)
    groups, found = components.connected(np.flatnonzero(start.hard)), Report()
    order = np.argsort(start.jacobian[0], kind="stable")
    by_row = tuple(column[order] for column in start.jacobian)
    impacts: list[PlasticImpact] = []
    for group in groups[:LOOKED_AT]:
        impact = plastic_impact(system, group, start)
        if impact is not None:
            x[impact.states] = impact.value
            impact.report(system, report)
            impacts.append(impact)
            continue
        first, end = (np.searchsorted(by_row[0], group, side) for side in ("left", "right"))
        own = np.concatenate([np.arange(a, b) for a, b in zip(first, end, strict=True)])
        certain = components.excluded(tuple(column[own] for column in by_row), start.residual, group, straight)
        (_report_contradiction if certain else _report_nothing_found)(system, group, start, found)
    report_alike(found.diagnostics, report, SHOWN, max(0, len(groups) - LOOKED_AT))  # type: ignore[attr-defined]
    if not start.hard.any():
        x[:] = _with_zeros(system, x)
        _report_missed(system, np.flatnonzero(start.soft), start, nearby, report)
    return impacts


def _with_zeros(system: StartSystem, x: np.ndarray) -> np.ndarray:
    """The states with zeros for what rounding has left of them, as far as all that is wanted is met no worse.

    A clutch at rest slips with 7e-15 rad/s otherwise, and a relation takes that for a motion. What is small because it
    is wanted so, as the capacity of a capacitor beside the speed of light, stays.
    """
    small = np.flatnonzero((x != 0) & (np.abs(x) <= max(_LEFT_OVER * np.abs(x).max(initial=0.0), _NOTHING)))
    if not len(small) or len(small) > LOOKED_AT:
        return x
    before, (rows, columns, values) = system.evaluate(x)
    allowed = np.abs(before) + _ULPS * np.finfo(float).eps * np.abs(system.value)
    allowed += system.rounding(x, ROUNDING * np.abs(x))
    read = values != 0.0
    while len(small):
        other = x.copy()
        other[small] = 0.0
        worse = ~(np.abs(system.evaluate(other)[0]) <= allowed)
        if not worse.any():
            return other
        needed = np.isin(small, columns[worse[rows] & read])
        small = small[~needed] if needed.any() else small[:0]
    return x


def _report_contradiction(system: StartSystem, group: np.ndarray, start: GaussNewtonResult, report: Report) -> None:
    who = _listed(system, group)
    fixed = "the fixed values " if (group < len(system.targets)).all() else ""
    if len(group) == 1:
        message, hint = f"the model does not allow {who} at the start", _held(system, int(group[0]))
    else:
        message = f"{fixed}{who} contradict each other"
        hint = "fix fewer of them, or values that fit the constraints between them"
    found = f"the nearest the model allows is {_reached(system, group, start)}"
    report.error("E0531", message, system.span_of(group), found=found, hint=_with_given(system, group, hint))


def _held(system: StartSystem, k: int) -> str:
    """What ties a body to a place, where one value of it alone is not allowed."""
    from lmoc.structure.messages.holding import holder

    return holder(system.flat, int(system.targets.variable[k])) if k < len(system.targets) else ""


def _report_nothing_found(system: StartSystem, group: np.ndarray, start: GaussNewtonResult, report: Report) -> None:
    hint = "perhaps there is none; if there is, start values (start = …) near a solution lead to it"
    found = f"the nearest that was found is {_reached(system, group, start)}"
    message, hint = f"no start was found with {_listed(system, group)}", _with_given(system, group, hint)
    report.error("E0532", message, system.span_of(group), found=found, hint=hint, subject=Subject.NO_START)


def _report_missed(
    system: StartSystem, rows: np.ndarray, start: GaussNewtonResult, nearby: StartGuess | None, report: Report
) -> None:
    value = system.value + start.residual
    rows = np.union1d(rows, np.flatnonzero(np.abs(value - system.wished) > MISSED_SOFT * (1.0 + np.abs(system.wished))))
    rows = rows[~system.hard[rows]]
    rows = np.array([k for k in rows.tolist() if not system.of_class(k)], int)
    if nearby is not None and nearby.closed:
        variable = system.targets.variable
        guesses = [k for k in rows.tolist() if k < len(variable) and variable[k] in nearby.tied]
        if guesses:
            told = [(int(variable[k]), float(system.wished[k]), float(value[k])) for k in guesses]
            note_unmet_guesses(system.flat, nearby, told, report)
        rows = np.setdiff1d(rows, guesses)
    if not len(rows):
        return
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
    given = f"given for this run (--init, initial=): {listed(names)}" if names else ""
    return "; ".join(filter(None, [given, hint]))


def _reached(system: StartSystem, group: np.ndarray, start: GaussNewtonResult) -> str:
    """Describe the end of the iteration: values, and residuals of equations."""
    return ", ".join(system.reached(k, float(start.residual[k])) for k in group[:SHOWN].tolist())
