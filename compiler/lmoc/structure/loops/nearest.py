"""The nearest point that satisfies some equations, from several first guesses.

What has been given hardly moves; what has not may be anywhere. From a first guess the rest is fitted to the given
values as well as can be (Levenberg–Marquardt: Marquardt, J. SIAM 11, 1963), which leaves flat places, then all move by
the smallest weighted steps that satisfy the linearized equations (Ben-Israel, J. Math. Anal. Appl. 15, 1966).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.structure.linear.generic import spread
from lmoc.structure.loops.smallest import damped_step, smallest_step

# steps of each iteration; the relative size of the last one; how often it begins; how far from the given values,
# squared and weighted, a point may be to be taken at once
STEPS, CLOSED, ATTEMPTS, NEAR = 40, 1e-12, 9, 1e-2
# beyond so many times the given values a point is where a flat place has thrown the iteration
FAR = 1e3

Linearized = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def nearest(begin: np.ndarray, weight: np.ndarray, linearized: Linearized, placed: bool = False) -> np.ndarray | None:
    """Return the nearest of the points that satisfy the equations; None where none is found.

    Parameters
    ----------
    begin : (n,) first values
    weight : (n,) how easily each gives way; those with 1 have not been given
    linearized : from values to the residual (m,) and its Jacobian (m, n)
    placed : whether some of the equations determine a place, as given values do; if nothing does, only `begin` is tried
    """
    free = weight == 1.0
    scale = max(float(np.abs(begin).max(initial=0)), 1e-300)
    best, best_cost = None, np.inf
    for attempt in range(ATTEMPTS if free.any() and (placed or not free.all()) else 1):
        first = begin.copy()
        if attempt:
            size = np.pi if attempt % 2 else scale  # angles, lengths
            first[free] = (2 * spread(int(np.count_nonzero(free)), attempt) - 1) * size
        found = closed(first if not attempt and free.all() else fitted(first, free, linearized), weight, linearized)
        if found is None or np.abs(found).max() > FAR * max(scale, 1.0):
            continue
        with np.errstate(over="ignore"):  # that is far away
            cost = float(np.sum(((found - begin) / scale)[~free] ** 2 / weight[~free]))
        if cost < best_cost:
            best, best_cost = found, cost
        if best_cost <= NEAR:
            break
    return best


def fitted(values: np.ndarray, free: np.ndarray, linearized: Linearized) -> np.ndarray:
    """Return values whose free ones make the residual small while the others stay."""
    if not free.any():
        return values
    residual, jacobian = linearized(values)
    damping, cost = 1e-3, residual @ residual
    for _ in range(STEPS):
        own = jacobian[:, free]
        if not (np.isfinite(own).all() and np.isfinite(cost)):
            return values
        new = values.copy()
        new[free] -= damped_step(own, residual, damping)
        new_residual, new_jacobian = linearized(new)
        new_cost = new_residual @ new_residual
        if not new_cost < cost:
            damping *= 10.0
            if damping > 1e8:
                return values
            continue
        small = new_cost >= (1.0 - 1e-6) * cost
        values, residual, jacobian, cost, damping = new, new_residual, new_jacobian, new_cost, damping / 10.0
        if small:
            return values
    return values


def closed(values: np.ndarray, weight: np.ndarray | float, linearized: Linearized) -> np.ndarray | None:
    """Return the values after the smallest weighted steps to where the residual vanishes; None where they diverge."""
    scale, ease = np.sqrt(np.mean(values**2)) or 1.0, np.sqrt(weight)
    before = np.inf
    for _ in range(STEPS):
        residual, jacobian = linearized(values)
        if not (np.isfinite(jacobian).all() and np.isfinite(residual).all()):
            return None
        size = np.linalg.norm(jacobian * ease, axis=1)
        size[size == 0] = 1.0
        step = ease * smallest_step(jacobian * ease / size[:, None], -residual / size)
        values = values + step
        length, extent = float(np.abs(step).max(initial=0.0)), max(scale, float(np.abs(values).max(initial=0.0)))
        if length <= CLOSED * extent or (length <= 1e-7 * extent and length > before / 4):
            return values  # at a place where the equations have no full rank, steps stay at the root of rounding
        before = length
    return None
