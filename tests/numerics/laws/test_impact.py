"""Impacts against momentum, energy and the closed forms of classic collisions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.impacts import NEWTON, POISSON, collide


def chain(masses):
    """The rates of the gaps between masses in a row: g_i = x_{i+1} − x_i, its matrix G and W = G·M⁻¹·Gᵀ."""
    n = len(masses)
    gaps = np.eye(n, k=1)[:-1] - np.eye(n)[:-1]
    inverse = np.diag(1.0 / np.asarray(masses))
    return gaps, inverse, gaps @ inverse @ gaps.T


def after(masses, velocity, e):
    gaps, inverse, delassus = chain(masses)
    impact = collide(delassus, gaps @ velocity, np.full(len(gaps), e))
    return velocity + inverse @ gaps.T @ impact.impulse, impact


def test_newtons_cradle_is_simultaneous():
    velocity, impact = after(np.ones(5), np.array([1.0, 0, 0, 0, 0]), 1.0)
    assert velocity == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4], abs=1e-12) and impact.law == NEWTON


def test_two_masses_with_restitution():
    velocity, impact = after([2.0, 3.0], np.array([4.0, -1.0]), 0.5)
    assert velocity == pytest.approx([-0.5, 2.0], abs=1e-13)
    assert impact.lost.sum() == pytest.approx(0.5 * 1.2 * 25 * (1 - 0.25), rel=1e-13)


def test_a_train_of_plastic_impacts_moves_as_one():
    velocity, impact = after(np.arange(1.0, 6.0), np.array([3.0, 0, 0, 0, 0]), 0.0)
    assert velocity == pytest.approx(np.full(5, 0.2), rel=1e-12)
    assert impact.lost.sum() == pytest.approx(4.5 - 0.5 * 15 * 0.04, rel=1e-12)


def test_a_law_that_opens_takes_no_impulse():
    velocity, impact = after(np.ones(3), np.array([1.0, 0.0, 2.0]), 0.0)
    assert velocity == pytest.approx([0.5, 0.5, 2.0]) and impact.impulse[1] == 0.0


def test_poissons_law_where_newtons_would_create_energy():
    """Two coupled contacts, the elastic one struck and the plastic one at rest (after Kane's paradox)."""
    delassus, rate, e = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([-1.0, -0.5]), np.array([0.0, 1.0])
    found = [collide(delassus, rate * s, e) for s in (1.0, 1e-6, 1e6)]
    assert len({f.law for f in found}) == 1
    for f in found:
        assert f.lost.sum() >= -1e-12 * float(f.impulse @ np.abs(f.rate))


@given(st.integers(0, 10**6), st.integers(1, 12))
def test_no_impact_creates_energy_or_pulls(seed, n):
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(n, random.integers(1, 15)))
    velocity, e = random.normal(size=jacobian.shape[1]), random.random(n)
    inverse = np.diag(random.random(jacobian.shape[1]) + 0.1)
    rate = jacobian @ velocity
    impact = collide(jacobian @ inverse @ jacobian.T, rate, e)
    end = velocity + inverse @ jacobian.T @ impact.impulse
    mass = 1.0 / np.diag(inverse)
    lost = 0.5 * (mass * velocity) @ velocity - 0.5 * (mass * end) @ end
    scale = (mass * velocity) @ velocity + np.abs(impact.impulse) @ np.abs(rate)
    assert impact.impulse.min() >= 0.0
    assert impact.lost.sum() == pytest.approx(lost, abs=1e-8 * scale)
    assert lost >= -1e-8 * scale
    assert (jacobian @ end >= -1e-7 * np.abs(rate).max()).all()
    assert impact.law in (NEWTON, POISSON)


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_laws_that_bar_each_other_come_to_rest(size):
    """A string and a stop of one length between two bodies, and strings to the wall: what is compressed stays.

    Newton's law contradicts itself, since the string would rebound and the stop would not let it; in the compression
    of Poisson's law the rates vanish up to rounding, and the expansion must not take that for motion.
    """
    gaps = np.array([[1.0, -1.0], [0.0, -1.0], [-1.0, 1.0], [1.0, 0.0]])  # strings 1, 2 and 4, stop 3
    delassus = gaps @ np.diag([1 / 1.53, 1.0]) @ gaps.T
    rate = gaps @ [0.0, 1.0] * size
    impact = collide(delassus, rate, np.array([0.5, 0.0, 1.0, 0.8]))
    assert impact.law == "Poisson" and impact.rate == pytest.approx(np.zeros(4), abs=1e-14 * size)
    assert (impact.impulse >= 0.0).all() and impact.lost.sum() == pytest.approx(size**2 / 2, rel=1e-12)
