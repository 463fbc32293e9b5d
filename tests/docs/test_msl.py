"""How results are held against those of a library that are published with it."""

import numpy as np
import pytest

from benchmarks.msl import outside


def saw(t: np.ndarray, jump: float) -> np.ndarray:
    return t - 2 * (t > jump)


def test_a_jump_between_two_samples_may_be_anywhere_between_them() -> None:
    at, fine = np.linspace(0, 1, 51), np.linspace(0, 1, 1001)
    assert outside(at, saw(at, 0.5199), fine, saw(fine, 0.5199), 0.002) <= 1
    assert outside(at, saw(at, 0.5199), fine, saw(fine, 0.525), 0.002) > 100
    moved = outside(at, saw(at, 0.5199), fine, saw(fine, 0.5199) + 0.02, 0.002)
    assert moved == pytest.approx(0.02 / np.ptp(saw(at, 0.5199)) / 0.002, rel=0.05)
