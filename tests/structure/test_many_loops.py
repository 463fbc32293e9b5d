"""What is found at the start of mechanisms with many loops: by sparse factors, with what dense singular values find."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp

import lmoc
from lmoc.structure.loops.smallest import (
    damped_step,
    in_rows_of_length_one,
    projected,
    smallest_step,
    surely_independent,
)
from lmoc.support.sizes import DENSE

N = DENSE + 20


@pytest.fixture
def chain() -> np.ndarray:
    """(N, N + 2) equations between neighbours, none of which follows from others."""
    random = np.random.default_rng(1)
    jacobian = np.zeros((N, N + 2))
    for k in range(N):
        jacobian[k, k : k + 3] = random.uniform(-1, 1, 3)
    return jacobian


def test_steps_of_many_equations_are_those_of_dense_matrices(chain):
    right = np.random.default_rng(2).uniform(-1, 1, N)
    unit = in_rows_of_length_one(chain)
    assert smallest_step(unit, right) == pytest.approx(np.linalg.lstsq(unit, right)[0], rel=1e-7, abs=1e-7)
    normal = chain.T @ chain
    damped = normal + np.diag(1e-3 * np.diag(normal) + 1e-14 * np.trace(normal))
    assert damped_step(chain, right, 1e-3) == pytest.approx(
        np.linalg.solve(damped, chain.T @ right), rel=1e-7, abs=1e-9
    )


def test_directions_and_rank_are_those_of_singular_values(chain):
    direction = np.random.default_rng(3).uniform(-1, 1, N + 2)
    _, size, right = np.linalg.svd(in_rows_of_length_one(chain))
    free = right[N:]
    assert projected(chain, direction, 1e-4) == pytest.approx(free.T @ (free @ direction), abs=1e-3)
    assert surely_independent(in_rows_of_length_one(chain), size.min() / 20)
    assert not surely_independent(in_rows_of_length_one(chain), size.min() / 5)
    chain[-1] = chain[-2] + 1e-6 * chain[-1]
    assert not surely_independent(in_rows_of_length_one(chain), 1e-6)


def test_no_dense_decomposition_grows_with_the_number_of_windows(monkeypatch):
    """IFToMM A02 with 24 windows: 146 constraints."""
    seen = []
    for name in ("svd", "lstsq"):
        dense = getattr(np.linalg, name)

        def noted(a, *given, dense=dense, **more):
            seen.append(max(a.shape[-2:]))
            return dense(a, *given, **more)

        monkeypatch.setattr(np.linalg, name, noted)
    dae = lmoc.compile(ROOT / "models/classic/windows.lmo", parameters={"N": 24})
    assert dae.states == ["first.phi", "first.omega"]
    assert max(seen, default=0) <= DENSE


def lattice(n: int) -> tuple[str, int, int]:
    """A rhombic lattice of n by n meshes hanging from a corner, in 60 degrees: its text, points and bars."""
    along, across = np.array([0.5, -np.sqrt(0.75)]), np.array([-0.5, -np.sqrt(0.75)])
    number = {(i, j): i * (n + 1) + j for i in range(n + 1) for j in range(n + 1)}
    bars = [(k, number[i + di, j + dj]) for (i, j), k in number.items() for di, dj in ((1, 0), (0, 1))
            if (i + di, j + dj) in number]  # fmt: skip
    parts = ["Anchor p0;"]
    for (i, j), k in number.items():
        x, y = (i * along + j * across).tolist()
        parts += [f"PointMass p{k}(m = 1, x(start = {x!r}), y(start = {y!r}));"] if k else []
    parts += [f"Rod r{k}(L = 1);" for k in range(len(bars))]
    joints = [f"connect(p{a}.point, r{k}.a); connect(r{k}.b, p{b}.point);" for k, (a, b) in enumerate(bars)]
    text = "\n".join(["model Net", "import Planar.*;", "inner World world;", *parts, "equation", *joints, "end Net;"])
    return text, len(number), len(bars)


def pins_of_a_lattice(n: int, times: np.ndarray) -> np.ndarray:
    """Places (times, points, 2): each pin is a sum of unit vectors, whose angles are minimal coordinates."""
    i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
    sums = np.concatenate([np.arange(n) < i[:, None], np.arange(n) < j[:, None]], axis=1).astype(float)
    weights, lifted = sums.T @ sums, sums.sum(axis=0)

    def slope(t: float, z: np.ndarray) -> np.ndarray:
        angle, rate = np.split(z, 2)
        apart = angle[:, None] - angle
        right = -9.81 * lifted * np.cos(angle) - (weights * np.sin(apart)) @ rate**2
        return np.concatenate([rate, np.linalg.solve(weights * np.cos(apart), right)])

    start = np.concatenate([np.repeat([-np.pi / 3, -2 * np.pi / 3], n), np.zeros(2 * n)])
    angles = solve_ivp(slope, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-12).y[: 2 * n].T
    return np.stack([np.cos(angles) @ sums.T, np.sin(angles) @ sums.T], axis=2)


def test_a_lattice_starts_where_its_pins_are_given(tmp_path):
    """Of 40 bars some would always miss their angles where all are looked for from one place."""
    text, points, bars = lattice(4)
    (tmp_path / "net.lmo").write_text(text)
    dae = lmoc.compile(tmp_path / "net.lmo")
    run = dae.simulate(stop=0.25, points=26, rtol=1e-9)
    assert len(dae.states) == 2 * (2 * (points - 1) - bars)
    exact = pins_of_a_lattice(4, run.time)
    for k in range(1, points):
        assert np.abs(run[f"p{k}.x"] - exact[:, k, 0]).max() < 1e-8
        assert np.abs(run[f"p{k}.y"] - exact[:, k, 1]).max() < 1e-8
