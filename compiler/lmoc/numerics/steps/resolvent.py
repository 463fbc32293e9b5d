"""Solutions of (σ·I - J)·y = b for the Jacobian J of a system: what Newton's method within implicit steps asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.numerics.problem.system import System
from lmoc.support.sizes import DENSE

_INVERSE = 40  # states up to which a product with the inverse is the fastest


class Resolvent:
    """(σ·I - J)⁻¹ for one J and the shifts σ, real or complex, that steps of one length need.

    Attributes
    ----------
    evaluations : Jacobians computed so far
    """

    def __init__(self, system: System, shifts: Sequence[complex] | np.ndarray) -> None:
        self.system, self._shifts = system, shifts
        self.evaluations = 0
        self._jacobian = None
        self._h = np.nan

    def at(self, t: float, x: np.ndarray) -> None:
        """Take the Jacobian at a place."""
        self.evaluations += 1
        self._h = np.nan
        if self.system.n <= DENSE:
            self._jacobian = self.system.jacobian(t, x)
            return
        from scipy.sparse import csc_matrix

        indptr, indices = self.system.pattern()
        values = np.empty(len(indices))
        self.system.jacobian_values(t, x, values)
        self._jacobian = csc_matrix((values, indices, indptr), shape=(self.system.n, self.system.n))

    def factorize(self, h: float) -> bool:
        """Prepare the solutions for steps of length h, σ = shift/h; whether that is possible."""
        if h == self._h:
            return True
        try:
            self._solvers = [self._solver(shift / h) for shift in self._shifts]
        except (np.linalg.LinAlgError, RuntimeError, ValueError):  # singular or not finite
            return False
        self._h = h
        return True

    def _solver(self, shift: complex):
        n = self.system.n
        if n <= _INVERSE:
            return np.linalg.inv(shift * np.eye(n) - self._jacobian).__matmul__
        if n <= DENSE:
            from scipy.linalg import lu_factor, lu_solve

            factors = lu_factor(shift * np.eye(n) - self._jacobian)
            return lambda b: lu_solve(factors, b, check_finite=False)
        from scipy.sparse import identity
        from scipy.sparse.linalg import splu

        return splu((shift * identity(n, format="csc") - self._jacobian).tocsc()).solve

    def solve(self, k: int, b: np.ndarray) -> np.ndarray:
        """Return y for the k-th shift."""
        return self._solvers[k](b)
