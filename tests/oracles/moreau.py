"""Time stepping of one-dimensional scenes with laws, on matrices that are assembled by hand.

The scheme of J. J. Moreau (1988) and M. Jean (1999), as in V. Acary and B. Brogliato, Numerical Methods for Nonsmooth
Dynamical Systems, 2008, chapter 10: velocities at the end of a step solve one complementarity problem for impulses,
whatever happens within the step. It knows no events and no modes, and is of first order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

THETA = 0.5  # weight of the end of the step in the forces
MOST_SWEEPS = 20_000
CONVERGED = 1e-13  # change of the impulses in a sweep, as a share of the largest one


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene in n coordinates; each row of a matrix of directions belongs to one element.

    Attributes
    ----------
    mass, stiffness, damping : (n,), (n, n), (n, n)
    rest : (n,) forces of the springs where all coordinates are zero
    load : t -> (n,) external forces
    bilateral : (g, n) rows of what is held at zero, such as ``q1 − N·q2``
    gap_rows, gap_offset, restitution : (u, n), (u,), (u,) unilateral laws: gap = offset + row·q
    one_way : (o, n) rows of velocities that cannot become negative
    friction_rows, slip, stick : (f, n), (f,), (f,) sliding velocities and limits
    q, v : (n,) at the start
    """

    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest: np.ndarray
    load: Callable[[float], np.ndarray]
    bilateral: np.ndarray
    gap_rows: np.ndarray
    gap_offset: np.ndarray
    restitution: np.ndarray
    one_way: np.ndarray
    friction_rows: np.ndarray
    slip: np.ndarray
    stick: np.ndarray
    q: np.ndarray
    v: np.ndarray

    @property
    def free(self) -> np.ndarray:
        """(n, d) a basis of the motions that the bilateral constraints allow."""
        return null_space(self.bilateral)

    def forces(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n,) of springs, dampers and loads."""
        return self.rest - self.stiffness @ q - self.damping @ v + self.load(t)


def null_space(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the directions in which rows·q does not change."""
    if not len(rows):
        return np.eye(rows.shape[1])
    _, sizes, vectors = np.linalg.svd(rows)
    return vectors[int((sizes > 1e-10).sum()) :].T


def march(scene: Scene, stop: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates and velocities (steps + 1, n) at equal steps up to a time."""
    h, basis = stop / steps, scene.free
    rows = np.concatenate([scene.gap_rows, scene.one_way, scene.friction_rows]) @ basis
    unilateral, complementary = len(scene.gap_rows), len(scene.gap_rows) + len(scene.one_way)
    mass = basis.T @ (scene.mass[:, None] * basis)
    stiffness, damping = basis.T @ scene.stiffness @ basis, basis.T @ scene.damping @ basis
    inverse = np.linalg.inv(mass + h * THETA * damping + (h * THETA) ** 2 * stiffness)
    before = mass - h * (1 - THETA) * damping - h**2 * THETA * (1 - THETA) * stiffness
    delassus = rows @ inverse @ rows.T
    q, v = scene.q.astype(float), basis.T @ scene.v
    path, rates = [q], [basis @ v]
    impulse = np.zeros(len(rows))
    for k in range(steps):
        right = before @ v + h * basis.T @ (scene.rest + scene.load((k + THETA) * h) - scene.stiffness @ q)
        rate = rows @ v
        lower, upper = np.zeros(len(rows)), np.full(len(rows), np.inf)
        reached = scene.gap_offset + scene.gap_rows @ q + 0.5 * h * rate[:unilateral] <= 0.0
        upper[:unilateral][~reached] = 0.0
        still = np.abs(rate[complementary:]) <= 1e-9 * (1.0 + np.abs(v).max())
        upper[complementary:] = h * np.where(still, scene.stick, scene.slip)
        lower[complementary:] = -upper[complementary:]
        wanted = np.zeros(len(rows))
        wanted[:unilateral] = scene.restitution * np.minimum(rate[:unilateral], 0.0)
        impulse = sweep(delassus, rows @ inverse @ right + wanted, lower, upper, impulse)
        after = inverse @ (right + rows.T @ impulse)
        q, v = q + h * basis @ (THETA * after + (1 - THETA) * v), after
        path.append(q)
        rates.append(basis @ v)
    return np.array(path), np.array(rates)


def sweep(matrix: np.ndarray, q: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Solve x ∈ [lower, upper] with matrix·x + q complementary to the bounds, by projected Gauss-Seidel."""
    rows, right = matrix.tolist(), q.tolist()
    x, low, high = np.clip(x, lower, upper).tolist(), lower.tolist(), upper.tolist()
    moving = [i for i in range(len(x)) if high[i] > low[i] and rows[i][i] > 0.0]
    for _ in range(MOST_SWEEPS):
        change = 0.0
        for i in moving:
            residual = right[i] + sum(a * b for a, b in zip(rows[i], x, strict=True))
            new = min(max(x[i] - residual / rows[i][i], low[i]), high[i])
            change = max(change, abs(new - x[i]))
            x[i] = new
        if change <= CONVERGED * max(map(abs, x), default=0.0):
            break
    return np.array(x)
