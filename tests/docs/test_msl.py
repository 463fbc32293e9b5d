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


def test_a_bend_between_two_samples_is_where_its_sides_meet() -> None:
    at, fine = np.linspace(0, 1, 51), np.linspace(0, 1, 1001)

    def roof(t: np.ndarray, top: float = 0.0) -> np.ndarray:
        return 1 + top * (np.abs(t - 0.51) < 0.002) - 3 * np.abs(t - 0.51)

    assert outside(at, roof(at), fine, roof(fine), 0.002) <= 1
    assert outside(at, roof(at), fine, roof(fine, 0.02), 0.002) > 3
    round_top = np.cos(6 * (fine - 0.51))  # no bend: nothing is added to the samples
    assert outside(at, np.cos(6 * (at - 0.51)), fine, round_top + 0.02 * (np.abs(fine - 0.51) < 0.002), 0.002) > 3
