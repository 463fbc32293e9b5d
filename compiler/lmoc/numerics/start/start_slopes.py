"""Derivatives of the states at a start by what it is asked for and by parameters, without starting anew.

A start meets what is asked for level by level (`lexicographic`). What decides the states and is met there is a system
of equations F(x, p) = 0 whose Jacobian has full column rank: by the implicit function theorem its solution has the
derivative that ``F_x dx = -F_p dp`` determines. Everything that this rests on is looked at: equations that are missed
where they would decide, a rank that is not full, and equations more than enough that contradict each other in the
derivatives have no answer here. An equation without a slope, such as ``√(L² - y²) = L`` at y = 0, leaves y where it is
if nothing draws it away and the equation holds with other parameters, too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.start.initialization import start_guess, states_of
from lmoc.numerics.start.start_system import StartSystem
from lmoc.numerics.start.targets import Targets, targets
from lmoc.support.sizes import DENSE

_MET = 1e-8  # of the size of a value: a missed one is off by 1e-6 and more (`gauss_newton`), another by rounding
_RANK = 1e-7  # of rows of length one: what is shorter in the directions left decides nothing
_AGREE = 1e-7  # of the largest derivative, by which equations more than enough may differ
_ASIDE = 1e-3  # by which what moves fastest is moved, to see whether equations without a slope are met there …
_STILL = 1e-13  # … and by how much of their values they may be missed
_KEPT = 8  # sets of parameters whose derivatives a plan keeps


def start_slopes(
    observer: Observer, time: float, x: np.ndarray, initial: Mapping[str, float], wished: np.ndarray, base: np.ndarray
) -> list[np.ndarray | None]:
    """Return the m derivatives (n,) of the states at a start; None where they do not follow from equations met there.

    Parameters
    ----------
    x : (n,) the states there
    initial : {name: value}, as the run was asked for
    wished : (m, flat.count) derivatives of start values
    base : (m, registers) derivatives of what follows from parameters alone
    """
    plan = observer.plan
    flat, n = plan.reduced.flat, len(plan.states)
    wanted = targets(plan, observer.values, initial, Report())
    register = plan.reduced.register_of[wanted.variable]
    at = states_of(plan, register)
    guess = start_guess(plan, observer.values, wanted)
    alone = (at >= 0).all() and not flat.initial_groups and not (guess is not None and guess.closed)
    direct = (at >= 0) & (wanted.hard | alone)
    own = at[direct]
    besides = bool(flat.initial_groups) or bool((wanted.hard & ~direct & (register >= 0)).any())  # has to be met, too
    enough = alone or (np.isin(np.arange(plan.state_count), own).all() and not besides)
    if len(np.unique(own)) == len(own) and enough:
        found = np.zeros((len(wished), n))
        found[:, own] = wished[:, wanted.variable[direct]]
        return list(found)
    if flat.initial_groups or n > DENSE:
        return [None] * len(wished)
    kept = Targets(*(column[register >= 0] for column in vars(wanted).values()))
    return _by_equations(observer, time, x, kept, wished[:, kept.variable], base)


def _by_equations(
    observer: Observer, time: float, x: np.ndarray, wanted: Targets, wished: np.ndarray, base: np.ndarray
) -> list[np.ndarray | None]:
    """Return the m derivatives (n,) from the values wanted, with their derivatives (m, targets); else None.

    What no equation of the start depends on leaves it as it is, whether or not these decide.
    """
    plan = observer.plan
    system = StartSystem(plan, observer.base, observer.signals, observer.values, time, wanted, Report())
    residual, entries = system.evaluate(x)
    matrix = _dense(entries, (len(residual), len(x)))
    reads = np.zeros(matrix.shape, bool)
    reads[entries[0], entries[1]] = True
    moving = np.flatnonzero((base != 0).any(axis=0))
    by_base = _by_base(system, moving)
    values = by_base.values(system.w, time)
    right = wished.T - _dense((by_base.rows, by_base.columns, values), (len(residual), len(moving))) @ base[:, moving].T
    if not np.isfinite(matrix).all() or not np.isfinite(right).all():
        return [None] * len(wished)
    enters = (wished != 0).any(axis=1) | (base[:, moving[np.unique(by_base.columns)]] != 0).any(axis=1)
    solved = _solved(x, (matrix, reads, residual), right, system) if enters.any() else None
    still, found = np.zeros(len(x)), []
    for k, asked in enumerate(enters):
        own = solved[0][k] if asked and solved is not None else still
        good = not asked or (solved is not None and _keeps(system, x, own, solved[1], (wished[k], base[k])))
        found.append(own if good else None)
    return found


def _by_base(system: StartSystem, moving: np.ndarray) -> Jacobian:
    """Return the derivatives by parameters; of what is no equation of the start, they are made once."""
    if len(system.outputs) > len(system.targets):
        return Jacobian(system.program, moving, system.outputs, len(system.w))
    kept, key = system.plan.once(_kept), (system.outputs.tobytes(), moving.tobytes())
    if key not in kept:
        for oldest in list(kept)[: 1 - _KEPT]:
            del kept[oldest]
        kept[key] = Jacobian(system.program, moving, system.outputs, len(system.w))
    return kept[key]


def _kept(_: Plan) -> dict[tuple[bytes, bytes], Jacobian]:
    return {}


def _keeps(
    system: StartSystem, x: np.ndarray, slope: np.ndarray, silent: tuple[np.ndarray, np.ndarray],
    moves: tuple[np.ndarray, np.ndarray],
) -> bool:  # fmt: skip
    """Return whether rows without a slope are met with other parameters, too, by states that they do not move.

    Parameters
    ----------
    slope : (n,) derivatives of the states
    silent : which rows, and what of the states they read, (rows, n)
    moves : (targets,), (registers,) derivatives of what is wanted, and of what follows from parameters alone
    """
    rows, reads = silent
    if not len(rows):
        return True
    if (slope[reads.any(axis=0)] != 0).any():
        return False
    wished, base = moves
    speed = max(np.max(np.abs(own), initial=0.0) for own in (slope, wished, base))
    for change in (-_ASIDE / speed, _ASIDE / speed):
        w = system.w.copy()
        w[: len(base)] += change * base
        w[system.plan.states] = x + change * slope
        Interpreter(system.program, len(w)).run(w, system.time)
        asked = np.concatenate([wished, np.zeros(len(system.value) - len(wished))])
        missed = w[system.outputs] - system.value - change * asked
        if not (np.abs(missed[rows]) <= _STILL * (1.0 + np.abs(system.value[rows]))).all():
            return False
    return True


def _solved(
    x: np.ndarray, rows: tuple[np.ndarray, np.ndarray, np.ndarray], right: np.ndarray, system: StartSystem
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None:
    """Return the derivatives (m, n), rows without a slope and what they read; None where the equations do not decide.

    Parameters
    ----------
    rows : the equations' derivatives (rows, n), which of them are other than 0 elsewhere, and what they miss (rows,)
    right : (rows, m) what the states have to make up for
    """
    matrix, reads, residual = rows
    size, free = np.linalg.norm(matrix, axis=1), ~reads.any(axis=0)
    if (x[free] != 0).any():
        return None
    own = np.flatnonzero(reads.any(axis=1))
    size[size == 0.0] = 1.0
    scaled = matrix[own][:, ~free] / size[own, None]
    met = np.abs(residual[own]) <= _MET * (1.0 + np.abs(system.value[own]))
    deciding = _deciding(scaled, reads[own][:, ~free], system.level[own], met)
    if deciding is None:
        return None
    silent = own[deciding[1]]
    deciding = deciding[0]
    right = right[own[deciding]] / size[own[deciding], None]
    solved = np.linalg.lstsq(scaled[deciding], right, rcond=None)[0]
    if np.max(np.abs(scaled[deciding] @ solved - right), initial=0.0) > _AGREE * np.max(np.abs(right), initial=0.0):
        return None
    found = np.zeros((right.shape[1], len(x)))
    found[:, ~free] = solved.T
    return found, (silent, reads[silent])


def _deciding(
    matrix: np.ndarray, reads: np.ndarray, level: np.ndarray, met: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the rows that decide all columns, level by level; None where some are missed, or do not suffice.

    A row may have no slope in the directions left and yet read them, as ``cos(φ)`` at φ = 0: it has one nearby, where
    a start gives it its full say. These are returned, too. So may one that is parallel to others.

    Parameters
    ----------
    reads : (rows, columns) mask of what may be other than 0 elsewhere
    """
    chosen: list[np.ndarray] = []
    silent = np.zeros(0, int)
    left = np.eye(matrix.shape[1])  # the directions in which nothing is decided yet
    for now in np.unique(level):
        if not left.shape[1]:
            break
        every = np.flatnonzero(level == now)
        short = np.linalg.norm(matrix[every] @ left, axis=1) <= _RANK
        own = every[~short]
        nearby = every[short][_read(reads[every[short]], left)]
        if not met[own].all() or not met[nearby].all() or np.linalg.norm(matrix[nearby], axis=1).any():
            return None
        silent = np.append(silent, nearby)
        if len(own):
            inside = matrix[own] @ left
            _, values, basis = np.linalg.svd(inside)
            left = left @ basis[int((values > _RANK).sum()) :].T
            turning = inside[_read(reads[own], left)]
            if len(turning) and np.linalg.matrix_rank(turning, tol=_RANK) < len(turning):
                return None
            chosen.append(own)
    return None if left.shape[1] or not chosen else (np.concatenate(chosen), silent)


def _read(reads: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return which rows read something that is not decided."""
    return reads[:, np.linalg.norm(left, axis=1) > _RANK].any(axis=1)


def _dense(entries: tuple[np.ndarray, np.ndarray, np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    rows, columns, values = entries
    found = np.zeros(shape)
    found[rows, columns] = values
    return found
