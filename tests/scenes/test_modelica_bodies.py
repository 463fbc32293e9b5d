"""Bodies written as Modelica's libraries write them, in a plane and in space, against closed forms."""

from math import gamma, pi, sqrt

import numpy as np
import pytest

import lmoc

G = 9.81
PLANE = """
package Plane
  connector Frame
    Real x(unit = "m"); Real y(unit = "m"); Real phi(unit = "rad");
    flow Real fx(unit = "N"); flow Real fy(unit = "N"); flow Real t(unit = "N.m");
  end Frame;
  model World
    parameter Real direction[2] = {0, -1};
    function gravity input Real r[2]; input Real n[2]; output Real g[2]; algorithm g := 9.81*n; end gravity;
  end World;
  model Body
    Frame frame;
    outer World world;
    parameter Real m(unit = "kg"); parameter Real I(unit = "kg.m2");
    Real r[2](each unit = "m") = {frame.x, frame.y};
    Real v[2](each unit = "m/s") = der(r);
    Real w(unit = "rad/s") = der(frame.phi);
  equation
    {frame.fx, frame.fy} + m*world.gravity(r, world.direction) = m*der(v);
    frame.t = I*der(w);
  end Body;
  model Revolute
    Frame a; Frame b;
    Real phi(unit = "rad"); Real w(unit = "rad/s") = der(phi);
  equation
    {a.x, a.y, a.phi + phi} = {b.x, b.y, b.phi};
    {a.fx, a.fy, a.t} + {b.fx, b.fy, b.t} = zeros(3);
    a.t = 0;
  end Revolute;
  model Rod
    Frame a; Frame b;
    parameter Real r[2](each unit = "m");
    Real e[2](each unit = "m") = {{cos(a.phi), -sin(a.phi)}, {sin(a.phi), cos(a.phi)}}*r;
  equation
    {a.x, a.y} + e = {b.x, b.y};
    a.phi = b.phi;
    {a.fx, a.fy} + {b.fx, b.fy} = zeros(2);
    a.t + b.t + e*{b.fy, -b.fx} = 0;
  end Rod;
  model Fixed
    Frame frame;
  equation
    {frame.x, frame.y, frame.phi} = zeros(3);
  end Fixed;
  function friction "from 0 over a peak to what is left in sliding"
    input Real v; input Real adhering; input Real sliding; input Real peak; input Real rest; output Real mu;
  protected
    Real s = abs(v);
    Real u;
  algorithm
    if s < adhering then
      mu := peak*s/adhering;
    elseif s < sliding then
      u := (s - adhering)/(sliding - adhering);
      mu := peak + (rest - peak)*u^2*(3 - 2*u);
    else
      mu := rest;
    end if;
    mu := if v < 0 then -mu else mu;
  end friction;
  model Wheel
    Frame frame;
    parameter Real R(unit = "m"); parameter Real mu;
    Real slip(unit = "m/s") = der(frame.x) + R*der(frame.phi);
  equation
    frame.y = R;
    frame.fx = -frame.fy*noEvent(friction(slip, 0.01, 0.03, 0.5, mu));
    frame.t = R*frame.fx;
  end Wheel;
end Plane;
"""
PENDULUM = """
model Pendulum
  inner Plane.World world;
  Plane.Fixed fixed;
  Plane.Revolute revolute(phi(start = 0, fixed = true), w(start = 0, fixed = true));
  Plane.Rod rod(r = {1, 0});
  Plane.Body body(m = 1, I = 0.1);
equation
  connect(fixed.frame, revolute.a);
  connect(revolute.b, rod.a);
  connect(rod.b, body.frame);
end Pendulum;
"""
SPIN = """
model Spin
  inner Plane.World world;
  Plane.Wheel wheel(R = 0.1, mu = 0.15);
  Plane.Body body(m = 0.01, I = 0.0005, w(start = 15, fixed = true), frame(phi(start = 0, fixed = true)),
    r(start = {0, 0.1}, fixed = {true, false}), v(start = {2, 0}, fixed = {true, false}));
equation
  connect(body.frame, wheel.frame);
end Spin;
"""
TOP = """
model Top
  parameter Real I[3] = {1, 1, 2};
  Real w[3](start = {0.3, 0, 2}, each fixed = true);
  Real Q[4](start = {0, 0, 0, 1}, fixed = {true, true, true, false});
equation
  Q*Q = 1;
  w = 2*[Q[4], Q[3], -Q[2], -Q[1]; -Q[3], Q[4], Q[1], -Q[2]; Q[2], -Q[1], Q[4], -Q[3]]*der(Q);
  diagonal(I)*der(w) + cross(w, diagonal(I)*w) = zeros(3);
end Top;
"""


def test_pendulum_of_frames():
    """From rest at the level of its pivot, by the integral of energy: a quarter of the period and the speed there."""
    run = lmoc.compile_text(PLANE + PENDULUM, model="Pendulum")
    quarter = sqrt(1.1 / (2 * G)) * sqrt(pi) / 2 * gamma(0.25) / gamma(0.75)
    found = run.simulate(times=[0.0, quarter / 2, quarter], rtol=1e-10)
    phi, w = found["revolute.phi"], found["revolute.w"]
    assert phi[-1] == pytest.approx(-pi / 2, abs=1e-8)
    assert w == pytest.approx(-np.sqrt(-2 * G * np.sin(phi) / 1.1), abs=1e-8)
    assert found["body.r[2]"] == pytest.approx(np.sin(phi), abs=1e-12)


def test_wheel_that_slips_with_counter_spin():
    """Sliding friction is constant; about the point of contact the angular momentum stays, until it rolls."""
    run = lmoc.compile_text(PLANE + SPIN, model="Spin").simulate(times=[0.0, 0.8, 1.9, 3.0], rtol=1e-9)
    t = np.array([0.0, 0.8, 1.9])
    assert run["body.v[1]"][:3] == pytest.approx(2 - 0.15 * G * t, abs=1e-8)
    assert run["body.w"][:3] == pytest.approx(15 - 0.15 * G * 0.01 * 0.1 / 0.0005 * t, abs=1e-7)
    rolling = -(0.0005 * 15 - 0.01 * 0.1 * 2) / (0.0005 / 0.1 + 0.01 * 0.1)
    assert run["body.v[1]"][-1] == pytest.approx(rolling, abs=1e-7)
    assert run["wheel.slip"][-1] == pytest.approx(0, abs=1e-8)


def test_top_by_quaternions():
    """A symmetric body without torque: Euler's closed form, and an angular momentum that stays in space."""
    run = lmoc.compile_text(TOP).simulate(stop=6, points=61, rtol=1e-9)
    w, q = (np.array([run[f"{name}[{k + 1}]"] for k in range(n)]) for name, n in (("w", 3), ("Q", 4)))
    turning = [0.3 * np.cos(2 * run.time), 0.3 * np.sin(2 * run.time), 2 + 0 * run.time]
    assert w == pytest.approx(np.array(turning), abs=1e-7)
    assert (q**2).sum(axis=0) == pytest.approx(np.ones(61), abs=1e-12)
    own = np.diag([1, 1, 2]) @ w
    v, s = q[:3].T, q[3][:, None]  # the vector and the scalar part
    momentum = (2 * s**2 - 1) * own.T + 2 * (v * own.T).sum(axis=1)[:, None] * v + 2 * s * np.cross(v, own.T)
    assert momentum == pytest.approx(np.tile([0.3, 0, 4], (61, 1)), abs=1e-7)
