"""The eigenvalues of the Jacobian at a place of a run: what the motion remembers, and what makes it stiff."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from lmoc.numerics.problem.base import Outcome, Problem

EIGENVALUES = 150  # states up to which they are looked at
_SHIFT = 6e-6  # of a state's size, for central differences: the cube root of the rounding error

Differences = Callable[[Problem, Outcome], np.ndarray | None]


class Modes:
    """The modes of the motion where a run stands, quadratures left out.

    Their Jacobian comes from differences, which are good for the large eigenvalues and cost a few evaluations; the
    exact one is computed by numpy for many scenes, and takes as long as hundreds.
    """

    def __init__(
        self, problem: Problem, outcome: Outcome, differences: Differences | None = None
    ) -> None:
        """
        Parameters
        ----------
        differences : returns the Jacobian where that is made for many runs at once
        """
        self._problem, self._outcome, self._differences = problem, outcome, differences or _differences

    @cached_property
    def values(self) -> np.ndarray | None:
        """The eigenvalues (k,); None where there are too many or they are not finite."""
        matrix = self._differences(self._problem, self._outcome)
        if matrix is None:
            return None
        n = self._problem.system.plan.state_count
        return np.linalg.eigvals(matrix[:n, :n])

    @property
    def memory(self) -> float:
        """Return the rate at which the motion forgets an error, 1/s; negative or zero where it does not."""
        return 0.0 if self.values is None else -float(self.values.real.max(initial=-np.inf))

    @property
    def relaxation(self) -> float:
        """Return the largest magnitude of an eigenvalue whose mode decays rather than swings, 1/s; 0 without."""
        if self.values is None:
            return 0.0
        decaying = (np.abs(self.values.imag) <= 3 * np.abs(self.values.real)) & (self.values.real < 0)
        return float(np.abs(self.values[decaying]).max(initial=0.0))


def shifts(x: np.ndarray, atol: np.ndarray, rtol: float | np.ndarray) -> np.ndarray:
    """Return by what states are shifted for differences: parts of their sizes."""
    return _SHIFT * np.maximum(np.abs(x), 1e3 * atol / rtol)


def _differences(problem: Problem, outcome: Outcome) -> np.ndarray | None:
    """Return the Jacobian by central differences; None as in `Modes.values`."""
    system, t, x = problem.system, outcome.time, outcome.x
    if system.n > EIGENVALUES:
        return None
    shift = shifts(x, problem.atol, problem.rtol)
    jacobian, spent = np.empty((system.n, system.n)), system.evaluations
    low, high = np.empty(system.n), np.empty(system.n)
    with np.errstate(all="ignore"):
        for k, h in enumerate(shift.tolist()):
            for sign, rate in ((-1.0, low), (1.0, high)):
                beside = x.copy()
                beside[k] += sign * h
                system.rhs(t, beside, rate)
            jacobian[:, k] = (high - low) / (2 * h)
    system.rhs(t, x, low)  # blocks go on from their solutions here
    system.evaluations = spent
    return jacobian if np.isfinite(jacobian).all() else None
