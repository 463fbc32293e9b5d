"""Passing a bifurcation on the branch on which the velocities are continuous.

Where the constraints depend on each other several branches of a motion meet, and momentum continues the one that has
come there: a smooth curve of which one point alone cannot be evaluated. The way over it is one step of Gauss
collocation (Hairer, Nørsett & Wanner I, II.7) whose stages keep off that point, with an even number of them about it.
Newton's method begins at each stage where the motion so far points to, as in the continuation of curves through
branching points (Allgower & Georg, Numerical Continuation Methods, 1990, chapter 8). The step counts only if two orders
agree within the tolerances, and if the positions found lie on one smooth curve.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lmoc.numerics.coordinates.change import block_unknowns
from lmoc.numerics.problem.system import System
from lmoc.support.records import dataclass

_STAGES, _FEWER = 8, 6  # even, so that none is in the middle
_ITERATIONS = 40
_CONVERGED = 0.01  # of the tolerances
_NEAR = 0.25  # of the way of a block's unknowns: as far from where they were expected they may be found
_SMOOTH = 1e-6  # of the way: as much as they may miss the polynomial through the others
_BETWEEN = (0.46, 0.54)  # of the step: between the stages in the middle
_BESIDE = 1e-2  # of the step: as far aside a derivative is taken by differences
_LOOSE = 1e-9  # of the size of the unknowns: rounding where constraints almost depend on each other


@dataclass(frozen=True, eq=False)
class Passage:
    """A step over a place where the constraints depend on each other.

    Attributes
    ----------
    times : (k,) s, its beginning, the stages, its end
    states : (k, n)
    solutions : (k, m) of the nonlinear blocks
    """

    times: np.ndarray
    states: np.ndarray
    solutions: np.ndarray

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states and solutions of the blocks at times within, by the polynomial through all places."""
        weights = _lagrange(self.times, times)
        return weights @ self.states, weights @ self.solutions


class _Branch:
    """The right-hand side on the branch of one place.

    Attributes
    ----------
    t, x, solutions : that place, and the solutions of the blocks there
    slope : (n,) derivatives of the states
    rates, curvature : first and second derivatives of the solutions
    """

    def __init__(self, system: System, place: tuple[float, np.ndarray, np.ndarray], width: float) -> None:
        self.system, self.width = system, width
        self.unknowns = system.plan.once(block_unknowns)
        self.t, self.x, self.solutions = place
        self.slope, _ = self.at(*place)
        (before, _), (after, _) = (self._beside(place, self.slope, k) for k in (-1, 1))
        bend = (after - before) / (2 * _BESIDE * width)
        (_, before), (_, after) = (self._beside(place, self.slope + k * _BESIDE * width / 2 * bend, k) for k in (-1, 1))
        self.rates = (after - before) / (2 * _BESIDE * width)
        self.curvature = (after - 2 * self.solutions + before) / (_BESIDE * width) ** 2

    @property
    def known(self) -> bool:
        """Return whether all of it has been found."""
        return bool(np.isfinite(np.concatenate([self.slope, self.rates, self.curvature])).all())

    def expected(self, t: float) -> np.ndarray:
        """Return the solutions of the blocks as the motion so far leads to them."""
        time = t - self.t
        return self.solutions + time * (self.rates + time / 2 * self.curvature)

    def at(self, t: float, x: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the states, and the solutions of the blocks found from some nearby."""
        slope = np.empty(len(x))
        self.system.rhs_near(t, x, self.unknowns, near, slope)
        return slope, self.system.registers[self.unknowns]

    def evaluate(self, t: float, x: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the same; None where the solutions found are not near."""
        slope, found = self.at(t, x, near)
        way = np.abs(near - self.solutions).max(initial=0.0)
        allowed = _NEAR * way + _LOOSE * (1.0 + np.abs(near).max(initial=0.0))
        good = np.isfinite(slope).all() and np.abs(found - near).max(initial=0.0) <= allowed
        return (slope, found) if good else None

    def _beside(
        self, place: tuple[float, np.ndarray, np.ndarray], slope: np.ndarray, side: int
    ) -> tuple[np.ndarray, np.ndarray]:
        t, x, near = place
        step = side * _BESIDE * self.width
        return self.at(t + step, x + step * slope, near)


def passage(
    system: System, place: tuple[float, np.ndarray, np.ndarray], width: float, tolerance: np.ndarray
) -> Passage | None:
    """Return a step from a place to beyond the singular one in its middle; None where it cannot be trusted.

    Parameters
    ----------
    system : its blocks are left at any place
    place : s, (n,) the state, and the solutions of the blocks
    width : s, of the step
    tolerance : (n,) of the state at its end
    """
    branch = _Branch(system, place, width)
    if not branch.known:
        return None
    fewer, found = (_collocated(branch, width, stages, tolerance) for stages in (_FEWER, _STAGES))
    if fewer is None or found is None or not (np.abs(found.states[-1] - fewer.states[-1]) <= tolerance).all():
        return None
    return found if _is_smooth(branch, found) else None


def _collocated(branch: _Branch, width: float, stages: int, tolerance: np.ndarray) -> Passage | None:
    """Return one step of Gauss collocation, by fixed-point iteration; None where that does not converge."""
    nodes, matrix, weights = _gauss(stages)
    times = branch.t + width * nodes
    near = [branch.expected(t) for t in times]
    states, slopes = branch.x + width * np.outer(nodes, branch.slope), np.zeros((stages, len(branch.x)))
    missed = np.inf
    for _ in range(_ITERATIONS):
        for k in range(stages):
            found = branch.evaluate(times[k], states[k], near[k])
            if found is None:
                return None
            slopes[k], near[k] = found
        before, states = states, branch.x + width * matrix @ slopes
        last, missed = missed, float((np.abs(states - before) / tolerance).max())
        if missed <= _CONVERGED or 0.5 * last < missed <= 1.0:  # rounding is larger the nearer the stages are
            break
    else:
        return None
    end, there = branch.t + width, branch.x + width * weights @ slopes
    places = np.concatenate([[branch.t], times])
    solutions = np.vstack([branch.solutions, near])
    found = branch.evaluate(end, there, _lagrange(places, np.array([end]))[0] @ solutions)
    if found is None:
        return None
    return Passage(np.append(places, end), np.vstack([branch.x, states, there]), np.vstack([solutions, found[1]]))


def _is_smooth(branch: _Branch, found: Passage) -> bool:
    """Return whether the blocks' unknowns lie on one smooth curve, about the middle of the step, too.

    There a step onto another branch has a kink, and one from a curve to another that comes near without meeting it
    differs from the polynomial through its places.
    """
    width = found.times[-1] - found.times[0]
    way = np.abs(found.solutions[-1] - found.solutions[0]).max(initial=0.0)
    allowed = _SMOOTH * way + _LOOSE * (1.0 + np.abs(found.solutions[0]))
    times = found.times[0] + width * np.array(_BETWEEN)
    for t, x, near in zip(times, *found.at(times), strict=True):
        slope, solutions = branch.at(t, x, near)
        if not (np.isfinite(slope).all() and (np.abs(solutions - near) <= allowed).all()):
            return False
    return True


@lru_cache(maxsize=4)
def _gauss(stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes in 0 … 1, the matrix, and the weights of Gauss's method."""
    points, weights = np.polynomial.legendre.leggauss(stages)
    nodes = (points + 1) / 2
    matrix = np.array([(c * weights / 2) @ _lagrange(nodes, c * nodes) for c in nodes])
    return nodes, matrix, weights / 2


def _lagrange(places: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the values (points, places) of polynomials, each one at its own place and zero at the others."""
    difference = places[:, None] - places
    np.fill_diagonal(difference, 1.0)
    factors = (at[:, None, None] - places) / difference  # (points, own place, other place)
    factors[:, np.arange(len(places)), np.arange(len(places))] = 1.0
    return factors.prod(axis=2)
