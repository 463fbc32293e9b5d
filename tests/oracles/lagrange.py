"""Linear scenes assembled by hand: Lagrange's equations with Rayleigh's dissipation, solved by matrix exponentials.

Every node of a scene is an affine function of coordinates x, given as a row. So kinetic energy, elastic energy,
dissipation and virtual work give M x'' + D x' + K x = F0 + F1 sin(omega t). Directions without inertia are taken out by
null spaces, the rest is solved by a matrix exponential. Nothing here knows of parts or of the compiler.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, null_space


class Assembly:
    """M x'' + D x' + K x = F0 + F1 sin(omega t), summed up element by element."""

    def __init__(self, coordinates: int, omega: float):
        self.omega = omega
        self.M, self.D, self.K = np.zeros((3, coordinates, coordinates))
        self.F0, self.F1 = np.zeros((2, coordinates))

    def mass(self, m: float, row: np.ndarray, g: float = 0.0) -> None:
        self.M += m * np.outer(row, row)
        self.F0 += m * g * row

    def spring(self, k: float, row: np.ndarray, offset: float = 0.0) -> None:
        """Extension: row·x + offset."""
        self.K += k * np.outer(row, row)
        self.F0 -= k * offset * row

    def damper(self, c: float, row: np.ndarray) -> None:
        self.D += c * np.outer(row, row)

    def drive(self, amplitude: float, row: np.ndarray) -> None:
        """The force amplitude·sin(omega t) on a node."""
        self.F1 += amplitude * row

    def push(self, force: float, row: np.ndarray) -> None:
        """A constant force on a node."""
        self.F0 += force * row


@dataclass
class Split:
    """Bases of the directions with inertia (R), without inertia but with damping (S), and with neither (A)."""

    R: np.ndarray
    S: np.ndarray
    A: np.ndarray


def split(a: Assembly) -> Split:
    """As M and D are positive semidefinite, M [S A] = 0 and D A = 0."""
    massless = null_space(a.M, rcond=1e-10)
    R = null_space(massless.T, rcond=1e-10) if massless.size else np.eye(len(a.M))
    loose = null_space(massless.T @ a.D @ massless, rcond=1e-10) if massless.size else np.zeros((0, 0))
    damped = null_space(loose.T, rcond=1e-10) if loose.size else np.eye(massless.shape[1])
    return Split(R, massless @ damped, massless @ loose)


def well_posed(a: Assembly, b: Split) -> bool:
    """Every direction is held by an inertia, a damper or a spring, and none of them too weakly to compare with."""
    blocks = [(b.R, a.M), (b.S, a.D), (b.A, a.K)]
    return all(np.linalg.cond(V.T @ X @ V) < 1e4 for V, X in blocks if V.shape[1])


def state_counts(a: Assembly) -> tuple[int, int]:
    """Fewest and most states: position and velocity of all that has inertia, and positions of what is only damped.

    The fewest where a force feels only some combination of the damped positions (a spring between two of them feels
    their difference): to reach it, such a combination must itself be the state.
    """
    b = split(a)
    moving = 2 * b.R.shape[1]
    held = b.A @ np.linalg.solve(b.A.T @ a.K @ b.A, b.A.T @ a.K @ b.S) if b.A.shape[1] else 0
    felt = int(np.linalg.matrix_rank(a.K @ (b.S - held), tol=1e-8)) if b.S.shape[1] else 0
    return moving + felt, moving + (b.S.shape[1] if felt else 0)


def trajectory(a: Assembly, times: np.ndarray, x0: np.ndarray, v0: np.ndarray) -> np.ndarray:
    """x at the times as an array (times, coordinates), from the parts of x0 along R and S and of v0 along R."""
    b = split(a)
    R, S, A = b.R, b.S, b.A
    r, s = R.shape[1], S.shape[1]
    # x = G z + h0 + h1 sin, with z = (r, r', s) and the force balance A' (K x - F) = 0
    basis = np.hstack([R, np.zeros((len(R), r)), S])
    hold = np.linalg.solve(A.T @ a.K @ A, A.T) if A.shape[1] else np.zeros((0, len(R)))
    G, h0, h1 = basis - A @ hold @ a.K @ basis, A @ hold @ a.F0, A @ hold @ a.F1
    rest = np.hstack([-a.K @ G, (a.F0 - a.K @ h0)[:, None], (a.F1 - a.K @ h1)[:, None]])  # F - K x over (z, 1, sin)
    velocity = np.hstack([np.zeros((r, r)), np.eye(r), np.zeros((r, s + 2))])
    rest = rest - a.D @ R @ velocity
    s_rate = np.linalg.solve(S.T @ a.D @ S, S.T @ rest) if s else np.zeros((0, rest.shape[1]))
    force = R.T @ (rest - a.D @ S @ s_rate)
    acceleration = np.linalg.solve(R.T @ a.M @ R, force) if r else force
    n = 2 * r + s
    system = np.zeros((n + 3, n + 3))  # over (z, 1, sin, cos)
    system[:n, : n + 2] = np.vstack([velocity, acceleration, s_rate])
    system[n + 1, n + 2], system[n + 2, n + 1] = a.omega, -a.omega
    start = np.concatenate([R.T @ x0, R.T @ v0, S.T @ x0, [1.0, 0.0, 1.0]])
    states = [expm(system * t) @ start for t in times]
    return np.array([G @ z[:n] + h0 + h1 * z[n + 1] for z in states])
