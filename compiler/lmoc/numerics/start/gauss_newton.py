"""Gauss–Newton steps to a start, and where to begin again when they end in the wrong place.

A step solves the lexicographic least squares problem of `lexicographic`; it is halved while the fixed values get
worse. Where rows are missed though they bend, the iteration may have begun at a stationary point (``q^2 = 4`` at
``q = 0``), or ended in one. Then it begins again beside the first guess, with steps no longer than a radius that
doubles while they do well (a trust region, Nocedal & Wright, Numerical Optimization, 2006, chapter 4), so that it runs
downhill to the solution nearby; next farther away.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.start.lexicographic import Components
from lmoc.numerics.start.start_system import StartSystem
from lmoc.structure.linear.generic import spread
from lmoc.support.records import dataclass

_ITERATIONS = 40
_HALVINGS = 8
_MET = 1e-9  # of the size of the values: weighted fixed rows that count as met while steps are judged
_MISSED_HARD, MISSED_SOFT = 1e-7, 1e-6  # a fixed value, a start value counts as missed
ROUNDING = 1e-13  # of the sizes of the states: a residual that such changes of them make is met as well as it can be
_ROUGHLY = 1e-3  # of the size of a value: by more nothing is missed, however steep it is
_CLEARLY = 1e-3  # by which share of what is missed another start must be better
_UNCHANGED = 1e-9  # of the largest entry of a row: its gradient is the same everywhere
# how far from the first guess to begin again, from near to far and on both sides; then in scattered directions
_AWAY = (1e-3, -1e-3, 0.1, -0.1, 1.0, -1.0, 10.0, -10.0)
_SCATTERED = (0.1, 0.1, 1.0, 1.0, 1.0, 10.0)


@dataclass(frozen=True, eq=False)
class GaussNewtonResult:
    """The end of an iteration.

    Attributes
    ----------
    x : (n,) states
    residual : (m,)
    jacobian : (rows, columns, values)
    hard, soft : (m,) masks of fixed values and of start values that are missed
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: tuple[np.ndarray, np.ndarray, np.ndarray]
    hard: np.ndarray
    soft: np.ndarray

    @property
    def complete(self) -> bool:
        return not (self.hard.any() or self.soft.any())

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.residual).all() and np.isfinite(self.jacobian[2]).all())

    @property
    def badness(self) -> tuple[bool, int, float, float]:
        """To be compared: no value at all, then fixed values missed and by how much, then the start values."""
        size = np.abs(self.residual)
        return not self.finite, int(self.hard.sum()), float(size[self.hard].sum()), float(size[self.soft].sum())

    def better_than(self, other: GaussNewtonResult) -> bool:
        """Return whether this start is better by more than the tolerance for equality."""
        *mine, own = self.badness
        *others, most = other.badness
        return mine[:2] < others[:2] or (mine[:2] == others[:2] and own < (1.0 - _CLEARLY) * most)


def descend(system: StartSystem, components: Components, x: np.ndarray, radius: float = np.inf) -> GaussNewtonResult:
    """Steps from x until the fixed values hold and nothing moves any more, or until a value is lost.

    Parameters
    ----------
    radius : how long the first step may be
    """
    x, before, whole = x.copy(), np.inf, False
    for _ in range(_ITERATIONS):
        residual, jacobian, lost = _without_lost(*system.evaluate(x))
        if lost.any() and (whole or lost.all()):
            break
        whole = not lost.any()
        step = components.step(jacobian, residual, x - system.rest)
        largest, length = np.abs(x).max(initial=0.0), np.abs(step).max(initial=0.0)
        step *= min(1.0, radius / max(length, 1e-300))
        weight = _row_weights(jacobian, system.hard)
        factor = _shortened(system, x, step, weight, np.linalg.norm(weight * residual))
        x += factor * step
        radius *= 2 * factor
        if length <= 1e-13 * largest or (length <= 1e-9 * (1.0 + largest) and length >= before / 2):
            break
        before = length
    return _ended(system, x)


def _without_lost(residual: np.ndarray, jacobian) -> tuple[np.ndarray, tuple, np.ndarray]:
    """Residuals and Jacobian with zeros for rows without a finite value, and which these are.

    A temperature is 0/0 in an empty tank: once the others have filled it, it has a value.
    """
    rows, columns, values = jacobian
    lost = ~np.isfinite(residual)
    lost[rows[~np.isfinite(values)]] = True
    return np.where(lost, 0.0, residual), (rows, columns, np.where(lost[rows], 0.0, values)), lost


def _shortened(system: StartSystem, x: np.ndarray, step: np.ndarray, weight: np.ndarray, worst: float) -> float:
    """The share of a step after which the fixed values are not worse than before."""
    factor = 1.0
    for _ in range(_HALVINGS):
        residual = np.where(weight > 0, system.evaluate(x + factor * step)[0], 0.0)
        if np.linalg.norm(weight * residual) <= max(worst, _MET):
            break
        factor /= 2
    return factor


def _row_weights(jacobian, hard: np.ndarray) -> np.ndarray:
    """One over the length of each fixed row, as the least squares weigh it; 0 for the others."""
    rows, _, values = jacobian
    size = np.sqrt(np.bincount(rows, values**2, minlength=len(hard)))
    return np.where(hard & (size > 0), 1.0 / np.where(size > 0, size, 1.0), 0.0)


def _ended(system: StartSystem, x: np.ndarray) -> GaussNewtonResult:
    residual, jacobian = system.evaluate(x)
    scale, left = 1.0 + np.abs(system.value), rounding(jacobian, x, len(residual))
    left = np.where(left <= scale, np.minimum(left, _ROUGHLY * scale), 0.0)  # a root's slope is infinite
    missed = np.abs(residual)
    # what is met by the size of numbers as a whole may be far off by that of its terms, as an energy of 1e-20 J
    doubtful = system.hard & (missed > left) & (missed <= _MISSED_HARD * scale)
    if doubtful.any():
        scale = np.where(doubtful, system.sizes(x) + np.abs(system.value), scale)
    hard = system.hard & ~(missed <= np.maximum(_MISSED_HARD * scale, left))
    soft = ~system.hard & ~(missed <= np.maximum(MISSED_SOFT * scale, left))
    return GaussNewtonResult(x, residual, jacobian, hard, soft)


def rounding(jacobian: tuple[np.ndarray, np.ndarray, np.ndarray], x: np.ndarray, count: int) -> np.ndarray:
    """Return (count,) how much each residual changes where rounding changes the states."""
    rows, columns, values = jacobian
    return np.bincount(rows, ROUNDING * np.abs(values) * (1.0 + np.abs(x[columns])), minlength=count)


# --------------------------------------------------------------------- beginning again


def elsewhere(
    system: StartSystem, components: Components, guess: np.ndarray, found: GaussNewtonResult, straight: np.ndarray
) -> GaussNewtonResult:
    """The best start from other first guesses for the parts in which something is missed and something bends.

    Parameters
    ----------
    guess : (n,) the first one
    found : where it led
    straight : (m,) mask of rows with the same gradient everywhere; another guess is no use to parts of such rows alone
    """
    rows, columns, _ = found.jacobian
    bent = components.together(np.flatnonzero(found.hard | found.soft)) & ~straight
    own = np.zeros(len(guess), bool)
    own[columns[bent[rows]]] = True
    if not own.any():
        return found
    tries = (*_AWAY, *_SCATTERED) if found.hard.any() else _AWAY[:2]
    best, rest = found, found.x if found.finite else guess
    for k, away in enumerate(tries):
        x = np.where(own, guess, rest)
        x[own] += away * _direction(int(own.sum()), k) * (1.0 + np.abs(x[own]))
        start = descend(system, components, x, radius=abs(away))
        best = min(best, start, key=lambda s: s.badness)
        if best.complete:
            break
    return best


def _direction(size: int, k: int) -> np.ndarray:
    """Components between 1/2 and 1, no two of them alike; between -1 and 1 for the scattered tries."""
    scattered = spread(size, k + 1)
    return 0.5 + 0.5 * scattered if k < len(_AWAY) else 2.0 * scattered - 1.0


def straight_rows(system: StartSystem, x: np.ndarray) -> np.ndarray:
    """(m,) whether a residual is an affine function of the states, as far as gradients at three points tell."""
    rows, _, values = system.evaluate(x)[1]
    straight = np.ones(len(system.value), bool)
    largest = np.zeros(len(system.value))
    np.fmax.at(largest, rows, np.abs(values))
    for k in range(2):
        change = system.evaluate(x + (1.0 + np.abs(x)) * _direction(len(x), len(_AWAY) + k))[1][2] - values
        straight[rows[~(np.isfinite(change) & (np.abs(change) <= _UNCHANGED * largest[rows]))]] = False
    return straight
