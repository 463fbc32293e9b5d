"""Variables are given values through the one state that they follow from."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.observe.one_state import moved


@pytest.mark.parametrize(
    "value, start, wanted, expected",
    [
        (lambda x: 3 * x[1] - 2, [0, 1], 7, 3),
        (lambda x: x[1] ** 3, [5, 1], 27, 3),
        (lambda x: x[1] ** 3, [5, 1], -27, -3),
        (lambda x: np.sin(x[1]), [0, 0.3], 0.1, np.arcsin(0.1)),
        (lambda x: np.sqrt(x[1]), [0, 4], 0.01, 1e-4),
        (lambda x: np.log(x[1]), [0, 1], -5, np.exp(-5)),
        (lambda x: 2 * x[1] + 1, [0, 1e9], 0.5, -0.25),
        (lambda x: 1e6 + x[1], [0, 0], 1e6 + 3, 3),
        (lambda x: 1e-12 * x[1], [0, 0], 4e-12, 4),
        (lambda x: 2 * x[1], [1, 5], 0, 0),
    ],
)
def test_the_state_is_found_from_which_the_value_follows(value, start, wanted, expected):
    found = moved(value, np.array(start, float), wanted)
    assert found.followed.tolist() == [1]
    assert found.x[1] == pytest.approx(expected, rel=1e-9, abs=1e-9) and found.x[0] == start[0]


@pytest.mark.parametrize(
    "value, wanted, followed",
    [
        (lambda x: x[0] + x[1], 3, [0, 1]),
        (lambda x: 4.0, 4.5, []),
        (lambda x: np.sin(x[0]), 2, [0]),
        (lambda x: 1 + x[1] ** 2, 0, [1]),
        (lambda x: np.nan, 0, []),
    ],
)
def test_where_there_is_none_nothing_is_changed(value, wanted, followed):
    found = moved(value, np.array([0.3, 0.4]), wanted)
    assert found.x is None
    assert np.isnan(value([0.3, 0.4])) or found.followed.tolist() == followed


CUBE = "model Cube Real x(start = 1, fixed = true); Real y = x^3; equation der(x) = -x; {} end Cube;"


def test_a_live_scene_has_the_value_that_was_set():
    live = lmoc.compile_text(CUBE.format("")).live()
    live.set("y", 27)
    assert live["y"] == pytest.approx(27, rel=1e-9) and live["x"] == pytest.approx(3, rel=1e-9)
    live = lmoc.compile_text(
        "model S Real x(start = 0.5, fixed = true), y = sin(x); equation der(x) = 1; end S;"
    ).live()
    with pytest.raises(lmoc.ModelError, match="no value of the state x leads there"):
        live.set("y", 2)
    assert live["x"] == 0.5


def test_reinit_reaches_its_value_through_what_is_not_linear():
    run = lmoc.compile_text(CUBE.format("when time > 1 then reinit(y, 27); end when;")).simulate(stop=2, rtol=1e-9)
    np.testing.assert_allclose(run["x"], np.where(run.time < 1, 1, 3 * np.e) * np.exp(-run.time), rtol=1e-7)


@pytest.mark.parametrize(
    "text, words",
    [
        ("Real y = sin(time); equation when time > 1 then reinit(y, 2); end when;", "there are no states"),
        (
            "Real a(start = 1), b(start = 2), y = a*sin(b); equation der(a) = 1; der(b) = 2;\n"
            "when time > 0.5 then reinit(a, 1); reinit(b, 1); end when;\n"
            "when time > 1 then reinit(y, 2); end when;",
            r"line 3\): it follows from 2 states: a, b",
        ),
        (
            "Real a(start = 1), y = sin(a); equation der(a) = 1; when time > 1 then reinit(y, 2); end when;",
            "no value of the state a leads there",
        ),
    ],
)
def test_a_reinit_that_cannot_be_is_told_with_its_line(text, words):
    with pytest.raises(lmoc.SimulationError, match=words) as failure:
        lmoc.compile_text(f"model M {text} end M;").simulate(stop=2)
    assert failure.value.time == pytest.approx(1)


IN_X_AND_Y = """model P
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
equation
  der(x) = vx; der(y) = vy; x^2 + y^2 = 1; der(vx) = -T*x; der(vy) = -T*y - 9.81;
  {}
end P;"""


def test_a_velocity_is_changed_where_its_place_is_whatever_the_coordinate_is():
    """At 0.3 s the coordinate is y; by the angle the same is a factor of its rate."""
    by_angle = """model P Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true);
    equation der(theta) = omega; der(omega) = -9.81*sin(theta);
    when time > 0.3 then reinit(omega, -0.5*pre(omega)); end when; end P;"""
    text = IN_X_AND_Y.format("when time > 0.3 then reinit(vx, -0.5*pre(vx)); end when;")
    run = lmoc.compile_text(text).simulate(stop=1, points=21, rtol=1e-9)
    theta = lmoc.compile_text(by_angle).simulate(stop=1, points=21, rtol=1e-9)["theta"]
    np.testing.assert_allclose(run["x"], np.sin(theta), atol=1e-7)
    live = lmoc.compile_text(IN_X_AND_Y.format("")).live()
    live.advance(0.3)
    before = live["x"], live["y"]
    live.set("vx", 1.0)
    assert (live["x"], live["y"]) == pytest.approx(before) and live["vx"] == pytest.approx(1.0, rel=1e-9)


def test_what_is_not_proportional_to_a_velocity_follows_from_its_place_too():
    text = IN_X_AND_Y.format("when time > 0.3 then reinit(s, 2); end when;").replace("T;", "T, s;", 1)
    with pytest.raises(lmoc.SimulationError, match="it follows from 2 states"):
        lmoc.compile_text(text.replace("equation\n", "equation\n  s = x + vx;\n")).simulate(stop=1)
