"""Pictures of linear models: the phase, the ranges, and what is written on them."""

import numpy as np
import pytest
import sympy as sp

from lmoc.report.linear_plots import bode, phase, step
from lmoc.report.mode_plots import modes
from lmoc.report.units import ratio
from lmoc.symbolic.linearize import LinearModel
from lmoc.symbolic.transfer import TransferFunction

s = sp.Symbol("s")
OMEGA = np.array([0.01, 0.5, 2.0, 100.0])


def transfer(top, bottom) -> TransferFunction:
    return TransferFunction("u", "y", sp.sympify(top), sp.sympify(bottom), (), {})


@pytest.mark.parametrize(
    ("top", "bottom", "expected"),
    [
        ("1", "s**2 + 1", [0, 0, -180, -180]),  # undamped: as if weakly damped
        ("s**2 + 1", "(s + 1)**2", [-1.1, -53, 53, -1.1]),
        ("1", "s**2", [-180] * 4),
        ("1", "s**3", [-270] * 4),
        ("s", "1", [90] * 4),
        ("1", "s - 1", [-180, -153, -117, -90.6]),
        ("0", "s + 1", None),
    ],
)
def test_phase(top, bottom, expected):
    tf = transfer(top, bottom)
    if expected is None:
        assert np.all(np.isfinite(phase(tf, OMEGA)))
        return
    found = phase(tf, OMEGA)
    response = tf.response(OMEGA)
    assert np.allclose(np.exp(1j * np.radians(found)), response / np.abs(response), atol=1e-9)
    if top != "s**2 + 1":
        assert np.allclose(found, expected, atol=0.7)


def test_a_negative_gain_turns_by_half_a_turn():
    tf = transfer("-1", "s**2 + 1")
    assert set(np.round(phase(tf, OMEGA))) == {180.0, 0.0} or set(np.round(phase(tf, OMEGA))) == {-180.0, 0.0}


def test_bode_leaves_endless_peaks_out_of_the_picture():
    upper, lower = bode(transfer("1", "s**2 + 1"), title="Scene", units=("N", "m")).axes
    low, high = upper.get_ylim()
    assert low < 1e-2 and 10 < high < 1000
    assert upper.get_ylabel() == "amplitude y/u in m/N" and lower.get_xlabel() == "angular frequency in rad/s"


@pytest.mark.parametrize(("top", "bottom"), [("0", "1"), ("3", "1"), ("1", "s"), ("1", "s - 1"), ("s + 1", "s + 2")])
def test_any_proper_transfer_function_can_be_drawn(top, bottom):
    bode(transfer(top, bottom))
    (axis,) = step(transfer(top, bottom), units=("N.m", "rad")).axes
    assert axis.get_ylabel() == "y in rad" and len(axis.lines) >= 1


def test_step_of_a_first_order_lag():
    (axis,) = step(transfer("2", "0.5*s + 1")).axes
    time, value = axis.lines[0].get_data()
    assert np.allclose(value, 2 * (1 - np.exp(-time / 0.5)), atol=1e-9) and time[-1] == pytest.approx(3.0)


def test_step_follows_fast_motion_beside_slow_decay():
    (axis,) = step(transfer("1", "(s + 0.1)*(s**2 + 0.2*s + 100)")).axes
    time, _ = axis.lines[0].get_data()
    assert time[1] < 2 * np.pi / 10 / 15


def model(A):
    A = np.array(A, float)
    n = len(A)
    names = [f"x{i}" for i in range(n)]
    empty = np.zeros((n, 0))
    return LinearModel(
        names, [], names, A, (empty,), np.eye(n), (empty,), dict.fromkeys(names, 0.0), np.zeros(n), np.zeros(n)
    )


def test_modes_are_told():
    figure = modes(model([[0, 1], [-4, -0.4]]))
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles[1].startswith("2 rad/s, 0.3183 Hz, damping 0.1")
    assert modes(model([[0.0]])).axes[1].get_title(loc="left") == "rigid motion"
    assert modes(model([[-3.0]])).axes[1].get_title(loc="left") == "decays with 3/s"
    assert len(modes(model(np.zeros((0, 0)))).axes) == 1


@pytest.mark.parametrize(
    ("above", "below", "expected"),
    [
        ("m", "N", "m/N"),
        ("rad", "N.m", "rad/(N·m)"),
        ("m", "m", "1"),
        ("m/s", "N", "(m/s)/N"),
        ("m", "", ""),
        ("m", "1", "m"),
    ],
)
def test_unit_of_a_quotient(above, below, expected):
    assert ratio(above, below) == expected
