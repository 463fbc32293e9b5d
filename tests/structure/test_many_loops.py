"""What is found at the start of mechanisms with many loops: by sparse factors, with what dense singular values find."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT

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
