"""An open chain of uniform bars by hand: forces in the joints from one banded solve, in time proportional to length.

Coordinates are the angles of the bars from the horizontal. A bar with the forces F_i at its first end and -F_(i+1) at
its second has the accelerations of both ends; where two bars meet these agree, which ties three forces in a row.
"""

from __future__ import annotations

import numpy as np


class OpenChain:
    """n bars of mass m and length l, the first hanging from a fixed point, under gravity g along -y."""

    def __init__(self, n: int, l: float = 1.0, m: float = 1.0, g: float = 9.81):
        self.n, self.l, self.m, self.g = n, l, m, g
        self._band = np.zeros((7, 2 * n))

    def accelerations(self, theta: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """(n,) angular accelerations of the bars."""
        from scipy.linalg import solve_banded

        n, l, m = self.n, self.l, self.m
        u = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        across = np.stack([-u[:, 1], u[:, 0]], axis=1)
        # at either end: 1/m for the forces' sum, 3/m along `across` for their moments
        turn = 3 / m * across[:, :, None] * across[:, None, :]
        same, other = np.eye(2) / m + turn, np.eye(2) / m - turn
        diagonal = same.copy()
        diagonal[1:] += same[:-1]
        inward = (l / 2 * omega**2)[:, None] * u
        right = np.empty((n, 2))
        right[0] = -inward[0] + [0.0, self.g]
        right[1:] = -inward[1:] - inward[:-1]
        band, coupling = self._band, -other[:-1]
        for i in range(2):
            for j in range(2):
                band[3 + i - j, j::2] = diagonal[:, i, j]
                band[3 + i - j - 2, 2 + j :: 2] = coupling[:, i, j]  # row of bar i, force of bar i + 1
                band[3 + i - j + 2, j : 2 * n - 2 : 2] = coupling[:, i, j]
        force = solve_banded((3, 3), band, right.ravel(), check_finite=False).reshape(n, 2)
        both = force.copy()
        both[:-1] += force[1:]
        return -6 / (m * l) * np.einsum("ik,ik->i", across, both)

    def rate(self, t: float, z: np.ndarray) -> np.ndarray:
        """The derivative of (angles, angular velocities)."""
        theta, omega = z[: self.n], z[self.n :]
        return np.concatenate([omega, self.accelerations(theta, omega)])

    def tip(self, theta: np.ndarray) -> tuple[float, float]:
        """The place of the free end."""
        return float(self.l * np.cos(theta).sum()), float(self.l * np.sin(theta).sum())

    def energy(self, theta: np.ndarray, omega: np.ndarray) -> float:
        """Kinetic and potential energy."""
        l, m = self.l, self.m
        u = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        across = np.stack([-u[:, 1], u[:, 0]], axis=1)
        step = l * u
        start = np.cumsum(step, axis=0) - step
        rate = (l * omega)[:, None] * across
        speed = np.cumsum(rate, axis=0) - rate / 2
        height = start[:, 1] + step[:, 1] / 2
        return float(m / 2 * (speed**2).sum() + m * l**2 / 24 * (omega**2).sum() + m * self.g * height.sum())
