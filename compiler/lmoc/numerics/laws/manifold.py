"""What closed laws keep at zero, and the way back to it: gaps, rates and sliding velocities as functions of the states.

The equations of a closed law hold on the level at which its force is felt; what is below stays as the integrator
carries it. Constraints that are linear in the states stay to rounding (Runge-Kutta and multistep methods keep linear
invariants), the others drift with the local error (Hairer & Wanner, Solving Ordinary Differential Equations II,
VII.2). Both are moved back: by Newton's method in as few states as there are constraints, chosen by pivoting, so that
a body at rest on the ground is at rest to the last bit.
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.instant import Gauge
from lmoc.numerics.laws.mode import Mask

MOST_NEWTON = 12
CLOSE = 2e-16  # residual, as a share of the terms that make it
ROUNDING = 1e-12  # the same, where Newton's method does not come nearer
DEPENDENT = 1e-10  # a pivot below this share of the largest entry of its row: the row depends on others


class NoWayBack(Exception):
    """The states are too far from the constraints, or these contradict each other."""


class Manifold:
    """The gaps and rates of the laws of one run as functions of the states."""

    def __init__(self, gauge: Gauge) -> None:
        self.gauge = gauge
        self.rows = np.stack([gauge.registers[0], gauge.registers[1]])
        used = self.rows[self.rows >= 0]
        self.place = np.full(self.rows.shape, -1)
        self.place[self.rows >= 0] = np.arange(len(used))
        self.jacobian = Jacobian(gauge.program, gauge.plan.states, used, gauge.plan.count)

    def _evaluate(self, t: float, x: Array, chosen: Mask) -> tuple[Array, Array]:
        """Return some gaps and rates, (m,), and their derivatives by the states, (m, n); `chosen` is (2, laws)."""
        w = self.gauge.filled(t, x)
        matrix = np.zeros((int(self.place.max()) + 1, len(x)))
        matrix[self.jacobian.rows, self.jacobian.columns] = self.jacobian.values(w, t)
        return w[self.rows[chosen]], matrix[self.place[chosen]]

    def project(self, t: float, x: Array, gaps: Mask, rates: Mask) -> Array:
        """Return the nearby state at which some gaps and rates are zero.

        Raises
        ------
        NoWayBack
            Newton's method does not converge.
        """
        chosen = np.stack([gaps, rates])
        if not chosen.any():
            return x
        residue = np.inf
        for _ in range(MOST_NEWTON):
            value, matrix = self._evaluate(t, x, chosen)
            terms = np.abs(matrix) @ np.abs(x)
            if (np.abs(value) <= CLOSE * terms).all():
                return x
            before, residue = residue, float(np.abs(value).max())
            if residue >= 0.5 * before and (np.abs(value) <= ROUNDING * (terms + residue)).all():
                return x  # as near as rounding allows
            x = x + correction(matrix, -value)
        raise NoWayBack

    def scales(self, t: float, x: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms whose sums are the gaps and the rates, 0 where a law has none."""
        chosen = self.rows >= 0
        value, matrix = self._evaluate(t, x, chosen)
        scale = np.zeros(self.rows.shape)
        scale[chosen] = np.abs(matrix) @ np.abs(x) + np.abs(value - matrix @ x)
        return scale[0], scale[1]


def correction(matrix: Array, right: Array) -> Array:
    """Return dx with matrix·dx = right and as few entries as independent rows (Gauss-Jordan, full pivoting)."""
    rows, columns = matrix.shape
    work = np.concatenate([matrix, right[:, None]], axis=1)
    scale = np.abs(matrix).max(axis=1, initial=0.0)
    left = scale > 0.0
    chosen: list[tuple[int, int]] = []
    while left.any():
        share = np.abs(work[:, :columns]) / np.where(left, scale, np.inf)[:, None]
        row, column = divmod(int(share.argmax()), columns)
        if share[row, column] <= DEPENDENT:
            break
        work[row] /= work[row, column]
        others = np.arange(rows) != row
        work[others] -= np.outer(work[others, column], work[row])
        left[row] = False
        chosen.append((row, column))
    dx = np.zeros(columns)
    for row, column in chosen:
        dx[column] = work[row, columns]
    return dx
