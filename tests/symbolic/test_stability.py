"""Stability of ẋ = A x, on matrices small enough to see the answer."""

import numpy as np
import pytest

from lmoc.symbolic.stability import spectrum, stability


def told(A):
    A = np.array(A, float)
    return stability(spectrum(A), A)


def block(*parts):
    n = sum(len(p) for p in parts)
    A, at = np.zeros((n, n)), 0
    for p in parts:
        A[at : at + len(p), at : at + len(p)] = p
        at += len(p)
    return A


def oscillator(stiffness, damping=0.0):
    return np.array([[0, 1], [-stiffness, -damping]])


COUPLED_TWICE = block(oscillator(1), oscillator(1))
COUPLED_TWICE[1, 2] = 1.0  # the second drives the first at its own frequency


@pytest.mark.parametrize(
    ("A", "expected"),
    [
        (oscillator(4), "stable"),
        (oscillator(4, 1e-6), "asymptotically stable"),
        (oscillator(4, -1e-6), "unstable"),
        (oscillator(-4), "unstable"),
        (oscillator(1e8, 2e4), "asymptotically stable"),  # a double root by critical damping
        (oscillator(0), "marginal"),  # drifts
        (block(oscillator(0), oscillator(4)), "marginal"),  # a hanging crane
        (block(oscillator(0), oscillator(-4)), "unstable"),  # an upright one
        (np.eye(3, k=1), "unstable"),  # grows with the square of time
        (block(oscillator(0), [[0]]), "marginal"),
        (oscillator(0, 1), "neutral"),
        (np.zeros((2, 2)), "neutral"),
        (np.zeros((0, 0)), "asymptotically stable"),
        (block(oscillator(1), oscillator(1)), "stable"),  # twice the same frequency, two modes
        (COUPLED_TWICE, "unstable"),  # resonance
        (block(oscillator(1), [[-1e6]]), "stable"),
        (block(oscillator(0, 1), oscillator(1, -0.1)), "unstable"),
    ],
)
def test_stability(A, expected):
    assert told(A) == expected


@pytest.mark.parametrize("ratio", [1e8, 1e12, 1e16])
def test_a_stiff_part_does_not_hide_the_motion_of_a_soft_one(ratio):
    A = [[0, 1, 0, 0], [-ratio - 1, 0, 1, 0], [0, 0, 0, 1], [1, 0, -1, 0]]
    assert told(A) == "stable"
    assert np.allclose(np.abs(spectrum(np.array(A, float)).values[:2]), 1.0)


def test_two_free_masses_drift_with_a_zero_eigenvalue_that_is_zero():
    found = spectrum(np.array([[0, 1, 0, 0], [-3, 0, 3, 0], [0, 0, 0, 1], [1.5, 0, -1.5, 0]]))
    assert found.chains == (1, 1) and np.all(found.values[:2] == 0)
    assert np.allclose(found.values[2:], [1j * np.sqrt(4.5), -1j * np.sqrt(4.5)])


def test_a_long_free_chain_has_one_zero_pair_however_soft_its_modes():
    n = 60
    stiffness = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness[0, 0] = stiffness[-1, -1] = 1
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, np.zeros((n, n))]])
    found = spectrum(A)
    assert found.chains == (1, 1)
    expected = 2 * np.sin(np.arange(n) * np.pi / (2 * n))
    assert np.allclose(np.sort(np.abs(found.values))[::2], expected, atol=1e-9)
