"""Constraints that follow from others only where all of them hold."""

import numpy as np
import pytest
from oracles.models import compiled
from scipy.integrate import solve_ivp

import lmoc
from lmoc.messages.diagnostics import ModelError, SimulationError

RODS = """\
model Rods
  import Planar.*;
  parameter Real L = 0.5;
  parameter Real L2 = L;
  inner World world;
  Anchor anchor;
  PointMass mass(m = 1, x(start = 0, fixed = true), y(start = -0.5), vx(start = 1.5, fixed = true));
  Rod rod1(L = L), rod2(L = L2);
  Real total = rod1.f + rod2.f;
equation
  connect(anchor.point, rod1.a);
  connect(anchor.point, rod2.a);
  connect(rod1.b, mass.point);
  connect(rod2.b, mass.point);
end Rods;
"""


def pendulum(length: float, angle: float, rate: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle against the horizontal and its rate, of a point that hangs on a rod."""
    found = solve_ivp(
        lambda _, y: (y[1], -9.81 * np.cos(y[0]) / length), (0, times[-1]), (angle, rate), "DOP853", times, rtol=1e-12,
        atol=1e-13,
    )  # fmt: skip
    return found.y


def codes(run) -> list[str]:
    return [d.code for d in run.notes]


def test_the_same_rod_twice():
    run = lmoc.compile_text(RODS).simulate(stop=1, points=11, rtol=1e-9)
    angle, rate = pendulum(0.5, -np.pi / 2, 3.0, run.time)
    assert run["mass.x"] == pytest.approx(0.5 * np.cos(angle), abs=1e-7)
    assert run["mass.y"] == pytest.approx(0.5 * np.sin(angle), abs=1e-7)
    assert np.isnan(run["rod1.f"]).all() and np.isnan(run["rod2.f"]).all()
    assert run["total"] == pytest.approx(0.5 * rate**2 - 9.81 * np.sin(angle), rel=1e-6)
    assert codes(run).count("N0415") == 1


def test_a_platform_on_three_parallel_cranks():
    run = compiled("planar/three_cranks").simulate(stop=1, points=11, rtol=1e-9)
    angle, _ = pendulum(0.4, -1.2, 0.0, run.time)
    for crank in ("foot1.phi", "foot2.phi", "foot3.phi"):
        assert run[crank] == pytest.approx(angle, abs=1e-7)
    assert run["platform.theta"] == pytest.approx(np.zeros(11), abs=1e-10)
    assert len(run.coordinates[0][1]) == 2 and codes(run).count("N0415") == 1
    assert np.isnan(run["crank2.a.fx"]).all()


def test_another_length_is_no_repetition():
    dae = lmoc.compile_text(RODS)
    with pytest.raises((ModelError, SimulationError)):
        dae.simulate(stop=0.1, parameters={"L2": 0.7})
    assert dae.simulate(stop=0.1, parameters={"L": 0.7}, initial={"mass.y": -0.7})["mass.y"][0] == pytest.approx(-0.7)


PARALLELOGRAM = """\
model Parallelogram
  Real a(start = {start}, fixed = true), b(start = {start}), c(start = 0), w(start = 0, fixed = true);
equation
  w = der(a);
  der(w) = -9.81*cos(a);
  cos(a) + 2*cos(c) = 2 + cos(b);
  sin(a) + 2*sin(c) = sin(b);
end Parallelogram;
"""


@pytest.mark.parametrize("start", [0.0, 0.7])
def test_a_stretched_parallelogram_has_no_constraint_too_many(start):
    """At a = 0 the Jacobian loses its rank, beside it it has it."""
    dae = lmoc.compile_text(PARALLELOGRAM.format(start=start))
    assert "N0415" not in [d.code for d in dae.notes] and len(dae.reduced.undetermined) == 0


def test_a_constraint_without_rank_that_says_something_stays():
    text = """\
model Square
  Real x(start = 1, fixed = true), y(start = 1), z(start = 1), v(start = 0, fixed = true);
equation
  v = der(x);
  der(v) = -x;
  (x - y)^2 + (sin(x) - sin(y))^2 = 0;
  z^3 = y;
end Square;
"""
    dae = lmoc.compile_text(text)
    assert "N0415" not in [d.code for d in dae.notes]
    run = dae.simulate(stop=1, points=5)
    assert run["x"] == pytest.approx(np.cos(run.time), abs=1e-5)
    assert run["y"] == pytest.approx(run["x"], abs=1e-4)


def test_dropped_constraints_are_watched():
    dae = lmoc.compile_text(RODS)
    assert any("no longer follows" in check.message for check in dae.reduced.flat.checks)


def on_a_line(direction: tuple[float, float], angle: float) -> str:
    """A body with three of its points on one line; only the sum of the normal forces is unique."""
    nx, ny = direction
    return f"""
model Line
  import Planar.*;
  inner World world;
  Body body(m = 1, J = 0.1, x(start = 0), y(start = 0), vx(start = 1, fixed = true), theta(start = {angle}));
  PointOf p(rx = 0.5), q(rx = -0.5), s(rx = 0.1);
  Guide g(nx = {nx}, ny = {ny}), h(nx = {nx}, ny = {ny}), i(nx = {nx}, ny = {ny});
  Real total = g.fn + h.fn + i.fn;
equation
  connect(body.frame, p.frame); connect(body.frame, q.frame); connect(body.frame, s.frame);
  connect(p.point, g.point); connect(q.point, h.point); connect(s.point, i.point);
end Line;"""


@pytest.mark.parametrize("direction", [(1, 0), (1, 0.3), (0.5, -2)])
def test_three_points_of_a_body_on_one_line(direction):
    angle = float(np.arctan2(direction[1], direction[0]))
    run = lmoc.compile_text(on_a_line(direction, angle)).simulate(stop=1, points=11, rtol=1e-9)
    along, across = np.cos(angle), np.sin(angle)
    way = run.time / along - 9.81 * across * run.time**2 / 2
    np.testing.assert_allclose(run["body.x"], way * along, atol=1e-8)
    np.testing.assert_allclose(run["body.y"], way * across, atol=1e-8)
    assert run["total"] == pytest.approx(np.full(11, 9.81 * along), rel=1e-7)
    assert all(np.isnan(run[f"{guide}.fn"]).all() for guide in "ghi")
    assert codes(run).count("N0415") == 1


TWICE = """
model Twice "a point of a body on the same line twice, each time with a mass that goes along"
  import Planar.*;
  inner World world(g = 0);
  Body body(m = 1, J = 0.1, x(start = 0.3), y(start = 0.2), theta(start = 0.2), omega(start = 1, fixed = true));
  PointOf p(rx = 0.5), q(rx = 0.5);
  Guide g(nx = 1, ny = 0.3), h(nx = 1, ny = 0.3);
  Mass m(m = 1), n(m = 2, v(start = 0.5, fixed = true));
equation
  connect(body.frame, p.frame); connect(body.frame, q.frame);
  connect(p.point, g.point); connect(q.point, h.point);
  connect(g.flange, m.flange); connect(h.flange, n.flange);
end Twice;"""


def test_the_same_guide_twice():
    """Both masses are one of 3 kg, and momentum along the line stays."""
    run = lmoc.compile_text(TWICE).simulate(stop=2, points=21, rtol=1e-9)
    np.testing.assert_allclose(run["m.q"], run["n.q"], atol=1e-12)
    size = np.hypot(1, 0.3)
    momentum = 3 * run["m.v"] + (run["body.vx"] + 0.3 * run["body.vy"]) / size
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-7)
    assert run.energy.balance < 1e-7
    assert np.isnan(run["g.fn"]).all() and np.isnan(run["h.fn"]).all()

PLATFORM = """
model Platform "three parallel cranks whose feet are no straight line"
  import Planar.*;
  inner World world;
  Ground ground;
  Link base2(rx = 1, ry = 0), base3(rx = 0.3, ry = -0.6), arm2(rx = 1, ry = 0), arm3(rx = 0.3, ry = -0.6);
  Revolute foot1(phi(start = -1.2, fixed = true), omega(start = 8, fixed = true)), foot2, foot3, head1, head2, head3;
  Bar crank1(l = 0.4, m = 0.1), crank2(l = 0.4, m = 0.1), crank3(l = 0.4, m = 0.1);
  Body platform(m = 2, J = 0.3, cx = 0.3, cy = 0.1);
equation
  connect(ground.frame, foot1.a); connect(ground.frame, base2.a); connect(ground.frame, base3.a);
  connect(base2.b, foot2.a); connect(base3.b, foot3.a);
  connect(foot1.b, crank1.a); connect(foot2.b, crank2.a); connect(foot3.b, crank3.a);
  connect(crank1.b, head1.a); connect(crank2.b, head2.a); connect(crank3.b, head3.a);
  connect(platform.frame, head1.b); connect(platform.frame, arm2.a); connect(platform.frame, arm3.a);
  connect(arm2.b, head2.b); connect(arm3.b, head3.b);
end Platform;"""


def test_which_constraints_are_left_out_changes_where_the_others_would_lose_their_rank():
    """Two cranks in line with their feet determine nothing, the third one does."""
    run = lmoc.compile_text(PLATFORM).simulate(stop=0.5, points=21, rtol=1e-9)
    inertia, moment = 3 * 0.1 * 0.4**2 / 3 + 2 * 0.4**2, (3 * 0.1 * 0.2 + 2 * 0.4) * 9.81
    exact = solve_ivp(lambda _, y: (y[1], -moment / inertia * np.cos(y[0])), (0, 0.5), (-1.2, 8), "DOP853", run.time,
                      rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    for crank in ("foot1.phi", "foot2.phi", "foot3.phi"):
        np.testing.assert_allclose(run[crank], exact, atol=1e-7)
    np.testing.assert_allclose(run["platform.theta"], 0, atol=1e-9)
