"""The start of a run: fixed values hold, start values are met as closely as possible, the rest of the states is zero.

Most start values sit on states and are taken over at once. What sits on other variables is met by Gauss–Newton steps,
each a lexicographic least squares problem: fixed values first, start values in what they leave free, then the
smallest states. Parts of the system that share no state are solved apart, equal ones together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmoc.diagnostics import Report, nearest
from lmoc.numerics.lexicographic import Components, split
from lmoc.numerics.plan import Plan, walk
from lmoc.numerics.start_system import StartSystem
from lmoc.semantics.flat import FlatDAE, Kind
from lmoc.structure.program import Solve

_ITERATIONS = 40
_MET = 1e-9  # of the size of the values: a fixed value counts as met
_MISSED = 1e-6  # a start value counts as missed


@dataclass(frozen=True, eq=False)
class Targets:
    """Values that variables of the flat model shall have at the start."""

    variable: np.ndarray
    value: np.ndarray
    hard: np.ndarray  # fixed, or given by the caller

    def __len__(self) -> int:
        return len(self.variable)


def targets(flat: FlatDAE, values: np.ndarray, initial: Mapping[str, float], report: Report) -> Targets:
    """Fixed and start values of unknowns, with those of the caller in place of the model's own.

    Parameters
    ----------
    values : parameter values of the flat model
    initial : {name: value}; the name of an array takes one value or as many as it has variables
    """
    start, hard = np.full(flat.count, np.nan), np.zeros(flat.count, bool)
    for a in flat.starts:
        start[a.target] = a.values(values)
    for a in flat.fixed:
        hard[a.target] = a.values(values) != 0
    start[hard & np.isnan(start)] = 0.0
    for name, value in initial.items():
        variables = flat.find(name)
        if variables is None:
            hint = nearest(name, [b.pattern for b in flat.blocks if b.kind == Kind.UNKNOWN])
            report.error("E0622", f"there is no variable '{name}' to start from", hint=hint)
        elif flat.kind[variables[0]] != Kind.UNKNOWN:
            hint = "give it with parameters= (--set)" if flat.kind[variables[0]] == Kind.PARAMETER else ""
            report.error("E0534", f"'{name}' is not a variable that can be given an initial value", hint=hint)
        else:
            start[variables], hard[variables] = value, True
    chosen = np.flatnonzero(np.isfinite(start) & (flat.kind == Kind.UNKNOWN))
    return Targets(chosen, start[chosen], hard[chosen])


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
    where no solution was found, W0533 for start values that cannot be met.
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
    kept = Targets(wanted.variable[open_], wanted.value[open_], wanted.hard[open_])
    system = StartSystem(plan, base, signals, values, time, kept, report)
    if not report.errors:
        _solve(system, x, report)
        own = direct & wanted.hard
        x[at[own]] = wanted.value[own]  # to the last digit
    return x


def seed_blocks(plan: Plan, base: np.ndarray, wanted: Targets) -> None:
    """Let Newton's method begin at the values wanted for the unknowns of nonlinear blocks."""
    solved = [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
    if solved:
        register = plan.reduced.register_of[wanted.variable]
        own = np.isin(register, np.concatenate(solved))
        base[register[own]] = wanted.value[own]


def _solve(system: StartSystem, x: np.ndarray, report: Report) -> None:
    """Gauss–Newton steps on x until the fixed values hold and nothing moves any more."""
    components = None
    before = np.inf
    for _ in range(_ITERATIONS):
        residual, jacobian = system.evaluate(x)
        if not np.isfinite(residual).all():
            _report_not_finite(system, residual, report)
            return
        if components is None:
            components = split(jacobian, system.hard, len(x))
        step = components.step(jacobian, residual, x)
        size = 1.0 + np.abs(x).max(initial=0.0)
        length = np.abs(step).max(initial=0.0)
        weight = _row_weights(jacobian, system.hard)
        worst, factor = np.linalg.norm(weight * residual), 1.0
        for _ in range(8):  # shorter steps while the fixed values get worse
            trial, _unused = system.evaluate(x + factor * step)
            new = np.linalg.norm(weight * trial)
            if new <= max(worst, _MET):
                break
            factor /= 2
        x += factor * step
        if length <= 1e-13 * size or (length <= 1e-9 * size and length >= before / 2):
            break
        before = length
    residual, jacobian = system.evaluate(x)
    _judge(system, components, jacobian, residual, report)


def _row_weights(jacobian, hard: np.ndarray) -> np.ndarray:
    """One over the length of each fixed row, as the least squares weigh it; 0 for the others."""
    rows, _, values = jacobian
    size = np.sqrt(np.bincount(rows, values**2, minlength=len(hard)))
    return np.where(hard & (size > 0), 1.0 / np.where(size > 0, size, 1.0), 0.0)


def _judge(system: StartSystem, components: Components, jacobian, residual: np.ndarray, report: Report) -> None:
    scale = 1.0 + np.abs(system.value)
    missed = system.hard & (np.abs(residual) > _MET * scale * 100)
    for group in components.connected(np.flatnonzero(missed)):
        _report_contradiction(system, group, components.dependent(jacobian, group), report)
    soft = np.flatnonzero(~system.hard & (np.abs(residual) > _MISSED * scale))
    if len(soft) and not missed.any():
        names = ", ".join(f"{system.text(k)} (starts at {system.value[k] + residual[k]:.6g})" for k in soft[:4])
        more = f" and {len(soft) - 4} more" if len(soft) > 4 else ""
        report.warning(
            "W0533",
            f"not all start values can hold together: {names}{more}",
            system.span(int(soft[0])),
            hint="fixed = true on the ones that matter makes the others follow",
        )


def _report_contradiction(system: StartSystem, group: np.ndarray, dependent: bool, report: Report) -> None:
    parts = [system.text(k) for k in group[:6].tolist()]
    listed = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]
    if dependent and len(parts) == 1:
        message = f"the model does not allow {listed} at the start"
    elif dependent:
        message = f"the fixed values {listed} contradict each other"
    else:
        message = f"no start was found with {listed}"
    report.error(
        "E0531" if dependent else "E0532",
        message,
        system.span(int(group[0])),
        found="the nearest the model allows is "
        + ", ".join(f"{system.name(k)} = {system.value[k] + system.last[k]:.6g}" for k in group[:6].tolist()),
        hint="fix fewer of them, or values that fit the constraints between them" if len(parts) > 1 else "",
    )


def _report_not_finite(system: StartSystem, residual: np.ndarray, report: Report) -> None:
    k = int(np.flatnonzero(~np.isfinite(residual))[0])
    report.error("E0535", f"{system.name(k)} has no finite value at the start", system.span(k))
