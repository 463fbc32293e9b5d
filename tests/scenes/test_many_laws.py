"""Scenes of many laws, and laws that act on each other."""

from pathlib import Path

import numpy as np
import pytest

import lmoc

MODELS = Path(__file__).parents[2] / "models/laws"

STACK = """model Stack parameter Integer N = 50;
  Fixed floor; Mass m[N](each m = 1, each g = -9.81); Stop s[N](each L = 0.1);
equation
  connect(floor.flange, s[1].a); connect(s[1].b, m[1].flange);
  for i in 2:N loop connect(m[i-1].flange, s[i].a); connect(s[i].b, m[i].flange); end for;
initial equation
  for i in 1:N loop m[i].q = 0.1*i; m[i].v = 0; end for;
end Stack;"""
CRADLE = """model Cradle
  Mass m[5](each m = 1); Stop s[4](each L = 0.1, each e = 1);
equation
  for i in 1:4 loop connect(m[i].flange, s[i].a); connect(s[i].b, m[i+1].flange); end for;
initial equation
  for i in 1:5 loop m[i].q = if i == 1 then -0.5 else 0.1*i; m[i].v = if i == 1 then 1 else 0; end for;
end Cradle;"""
LOCKED = """model Locked "two inertias that a clutch holds together; a stop ends the way of one"
  FixedShaft pole;
  Inertia a(J = 1, omega(start = 2, fixed = true)), b(J = 3, omega(start = 2, fixed = true));
  Clutch clutch(tau = 5); Backlash stop(clearance = 2, e = 0);
equation
  connect(a.shaft, clutch.a); connect(clutch.b, b.shaft); connect(a.shaft, stop.a); connect(stop.b, pole.shaft);
end Locked;"""
SHARED = """model Shared "two frictions on one mass, and a pull that grows"
  Fixed wall; Mass m(m = 2); DryFriction a(F = 1, Fstick = 1.5), b(F = 2); Force pull(f = 2*time);
equation
  connect(wall.flange, a.a); connect(wall.flange, b.a); connect(a.b, m.flange); connect(b.b, m.flange);
  connect(pull.flange, m.flange);
end Shared;"""
BETWEEN = """model Between "a mass between an end stop and a taut string, with friction, that is pushed to and fro"
  Fixed wall; Mass m(m = 1); Stop stop(L = 0); Cable string(L = 0); DryFriction f(F = 1);
  Force push(f = 5*sin(3*time));
equation
  connect(wall.flange, stop.a); connect(stop.b, m.flange); connect(wall.flange, string.a);
  connect(string.b, m.flange); connect(wall.flange, f.a); connect(f.b, m.flange); connect(push.flange, m.flange);
end Between;"""


def test_a_stack_at_rest_does_not_sink():
    run = lmoc.compile_text(STACK).simulate(stop=100, points=3)
    assert run.events == ()
    for i in range(1, 51):
        assert (run[f"m[{i}].q"] == run[f"m[{i}].q"][0]).all() and abs(run[f"s[{i}].gap"]).max() < 1e-14
        assert -run[f"s[{i}].f"][-1] == pytest.approx(9.81 * (51 - i), rel=1e-12)


def test_a_cradle_obeys_the_law_that_it_names():
    run = lmoc.compile_text(CRADLE).simulate(stop=1, rtol=1e-10)
    assert [run[f"m[{i}].v"][-1] for i in range(1, 6)] == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4], abs=1e-12)
    assert {e.note for e in run.events} == {"Newton's law"} and {e.time for e in run.events} == {run.events[0].time}
    assert run.events[0].time == pytest.approx(0.6, abs=1e-12)


def test_friction_carries_no_impulse():
    """The other inertia keeps its speed, and is braked by the clutch from then on: 2 rad/s at 5/3 rad/s²."""
    run = lmoc.compile_text(LOCKED).simulate(stop=3, rtol=1e-10, times=[0.0, 0.5, 0.5 + 1e-9, 1.0, 3.0])
    impact = next(e for e in run.events if e.impulse)
    assert impact.time == pytest.approx(0.5, abs=1e-10) and impact.impulse == pytest.approx(2.0, rel=1e-10)
    assert run["b.omega"][2] == pytest.approx(2.0, abs=1e-8) and run["a.omega"][2] == 0.0
    assert run["b.omega"][3] == pytest.approx(2 - 5 / 3 * 0.5, abs=1e-9)
    assert [e.kind for e in run.events][-1] == "lock" and run["b.omega"][-1] == 0.0


@pytest.mark.parametrize("solver", ["dop853", "cvode", "radau"])
def test_frictions_share_a_load_up_to_the_sum_of_their_limits(solver):
    """They hold 1.5 + 2 N, which the pull of 2·t reaches at 1.75 s, and slide with 1 + 2 N."""
    run = lmoc.compile_text(SHARED).simulate(stop=3, rtol=1e-9, times=[0.0, 1.0, 1.7, 3.0], solver=solver)
    assert (run["m.q"][:3] == 0).all()
    since = 3 - 1.75
    assert run["m.v"][-1] == pytest.approx((2 * 1.75 - 3) / 2 * since + since**2 / 2, abs=1e-7)
    assert len(run.events) <= 4


def test_friction_beside_a_stop_and_a_string():
    """Nothing moves, and the three forces balance the push whatever its direction is."""
    run = lmoc.compile_text(BETWEEN).simulate(stop=4, rtol=1e-9)
    assert np.abs(run["m.q"]).max() < 1e-13
    total = 5 * np.sin(3 * run.time) - run["stop.f"] - run["string.f"] - run["f.f"]
    assert np.abs(total).max() < 1e-8
    assert (-run["stop.f"]).min() > -1e-8 and run["string.f"].min() > -1e-8 and np.abs(run["f.f"]).max() < 1 + 1e-8


@pytest.mark.parametrize("count", [41, 101])
def test_a_train_of_many_strings(count):
    """40 and 100 laws: string k is taut at √(0.01 k (k+1)) s; the modes are those that are met, not all subsets."""
    dae = lmoc.compile(MODELS / "wagons.lmo", parameters={"N": count})
    k = np.arange(1, count)
    caught = np.sqrt(0.01 * k * (k + 1))
    run = dae.simulate(stop=caught[-1] + 1.0, points=3)
    assert [e.time for e in run.events] == pytest.approx(caught, abs=1e-10)
    assert {e.kind for e in run.events} == {"taut"} and len(run.modes) == count
    assert run[f"wagon[{count}].v"][-1] == pytest.approx(10 * run.time[-1] / count, abs=1e-12)
    assert run.energy.balance < 1e-12


LOCKED_PLANAR = """model LockedPlanar "two points on a slide, held together by friction; a stop ends the way of one"
  import Planar.*;
  inner World world(g = 0);
  PointMass a(m = 1, x(start = 0, fixed = true), y(start = 0, fixed = true), vx(start = 2, fixed = true),
    vy(start = 0, fixed = true));
  PointMass b(m = 3, x(start = 0, fixed = true), y(start = 1, fixed = true), vx(start = 2, fixed = true),
    vy(start = 0, fixed = true));
  Guide along(nx = 1, ny = 0, y0 = 0), beside(nx = 1, ny = 0, y0 = 1);
  DryFriction hold(F = 5); Contact stop(nx = -1, ny = 0, d = -1);
equation
  connect(along.point, a.point); connect(beside.point, b.point); connect(stop.point, a.point);
  connect(along.flange, hold.a); connect(hold.b, beside.flange);
end LockedPlanar;"""


def test_friction_carries_no_impulse_in_the_plane():
    """A point hits a wall at 0.5 s and stays; the other keeps its speed and is braked from then on, at 5/3 m/s²."""
    run = lmoc.compile_text(LOCKED_PLANAR).simulate(stop=3, rtol=1e-10, times=[0.0, 0.5, 0.5 + 1e-9, 1.0, 3.0])
    impact = next(e for e in run.events if e.impulse)
    assert impact.time == pytest.approx(0.5, abs=1e-10) and impact.impulse == pytest.approx(2.0, rel=1e-10)
    assert impact.energy_lost == pytest.approx(2.0, rel=1e-10)
    assert run["b.vx"][2] == pytest.approx(2.0, abs=1e-8) and run["a.vx"][2] == pytest.approx(0.0, abs=1e-12)
    assert run["b.vx"][3] == pytest.approx(2 - 5 / 3 * 0.5, abs=1e-9)
    assert run["b.x"][-1] == pytest.approx(1 + 2**2 / 2 * 3 / 5, abs=1e-9) and run["b.vx"][-1] == 0.0
