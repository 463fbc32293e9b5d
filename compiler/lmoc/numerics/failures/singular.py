"""Places that a fixed choice of coordinates cannot pass: the others no longer follow from them.

At the lowest point of a pendulum its height says nothing about the side, and where a rocker turns back its angle says
nothing about the crank. The constraints' Jacobian by the dependent coordinates is singular there, the reduced
equations have several solutions (Haug, Computer Aided Kinematics and Dynamics, 1989, section 3.7), and integrators
take one of them without noticing. The determinant of the Jacobian along the run tells it: it is looked at over the
output times, and where it heads for zero, closely.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate.system import System

_AHEAD = 1e-4  # of the time between them: the step for the determinant's rate
_SINGULAR = 2e-3  # of its largest value: as near to zero as no determinant comes that only turns back
_FINE = 5e-4  # of it: the most that it changes in a step of the close look
_STEPS = 100, 3000  # least and most of these
_FALLING = 0.5  # of its first rate: as fast a determinant is still when it falls through zero
_ENDED = 0.02  # of its largest value, where the run found no solution beyond
_LOOKS = 5  # places that are looked at closely


def singular_place(system: System, t: np.ndarray, x: np.ndarray) -> tuple[float, int] | None:
    """The time of the first singular place on the way, and a register that cannot be told there; None without one.

    Parameters
    ----------
    t, x : times (k,) and states (k, n) of a run that this system has just made
    """
    constrained = system.plan.reduced.nearby is not None  # other blocks, as those of springs, say nothing of places
    if len(t) < 2 or not (len(system.unknowns) and constrained):
        return None
    system.restart()
    gaps = np.diff(t)
    value, rate = _leverages(system, t, x, [*gaps, gaps[-1]])
    scale = np.nanmax(np.abs(value), axis=0) * np.where(value[0] < 0, -1.0, 1.0)
    value, rate, gap = value / scale, rate / scale, gaps[: len(value) - 1, None]
    heading = value[:-1] + rate[:-1] * gap < 0
    away = (value[1:] - rate[1:] * gap < 0) | ~(value[1:] > _SINGULAR)
    for k, block in np.argwhere(heading & away)[:_LOOKS].tolist():
        if _reaches_zero(system, t[k : k + 2], x[k], block, scale[block], abs(rate[k, block])):
            return float(t[k]), int(system.unknowns[block])
    return None


def singular_end(system: System, t: np.ndarray, x: np.ndarray) -> int | None:
    """A register that the coordinates no longer tell at the end of a run that found no solution beyond it, or None.

    Parameters
    ----------
    t, x : times (k,) and states (k, n) on the way and at the end
    """
    if system.plan.reduced.nearby is None or not len(system.unknowns):
        return None
    system.restart()
    values = []
    for time, state in zip(t, x, strict=True):
        _slope(system, time, state)
        values.append(np.abs(system.determinants()))
    ratio = values[-1] / np.maximum(np.nanmax(values, axis=0), 1e-300)
    lost = int(np.argmin(np.where(np.isfinite(ratio), ratio, 0.0)))
    return int(system.unknowns[lost]) if not ratio[lost] > _ENDED else None


def _leverages(system: System, t, x, gaps) -> tuple[np.ndarray, np.ndarray]:
    """Determinants and their rates at all times, up to the first where one has vanished: (times, blocks)."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    largest = 0.0
    for args in zip(t, x, gaps, strict=True):
        found.append(_leverage(system, *args))
        largest = np.fmax(largest, np.abs(found[-1][0]))
        if not (np.abs(found[-1][0]) > _SINGULAR * largest).all():
            break
    return np.array([value for value, _ in found]), np.array([rate for _, rate in found])


def _leverage(system: System, t: float, x: np.ndarray, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Determinants of all nonlinear blocks, and their rates along the motion."""
    slope, _ = _slope(system, t, x)
    here, step = system.determinants(), _AHEAD * gap
    _slope(system, t + step, x + step * slope)
    return here, (system.determinants() - here) / step


def _slope(system: System, t: float, x: np.ndarray) -> tuple[np.ndarray, bool]:
    out = np.empty(system.n)
    system.rhs(t, x, out)
    return out, bool(np.isfinite(out).all())


def _reaches_zero(system, span: np.ndarray, x: np.ndarray, block: int, scale: float, rate: float) -> bool:
    """Whether a determinant falls through zero between two times: classical Runge-Kutta steps, short as it is fast.

    Where it only touches zero, as that of cubic springs in series which relax, it slows down before.
    """
    count = int(np.clip(rate * (span[1] - span[0]) / _FINE, *_STEPS))
    h = (span[1] - span[0]) / count
    before = np.inf
    for k in range(count):
        t = span[0] + k * h
        k1, good = _slope(system, t, x)
        value = system.determinants()[block] / scale
        if not good or not value > _SINGULAR:
            return not before - value < _FALLING * rate * h
        before = value
        k2, _ = _slope(system, t + h / 2, x + h / 2 * k1)
        k3, _ = _slope(system, t + h / 2, x + h / 2 * k2)
        k4, _ = _slope(system, t + h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return False
