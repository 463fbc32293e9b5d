"""Scenes with laws that cannot go on say why and keep what they have; one that once could not goes on."""

import numpy as np
import pytest

import lmoc
from lmoc.messages.diagnostics import ModelError, SimulationError

CAUGHT = """
model Caught "a press that moves on towards the floor, with a mass between the two"
  parameter Real reach = 0;
  Motion press(q = reach - time);
  Fixed floor;
  Mass m(m = 1);
  Stop a(L = 0), b(L = 0);
equation
  connect(floor.flange, a.a);
  connect(a.b, m.flange);
  connect(m.flange, b.a);
  connect(b.b, press.flange);
end Caught;
"""
ROUND = """
model Round "a pendulum with friction, which goes past places where x does not determine y"
  Real x(start = 0.6), y(start = -0.8), vx(start = 6.4), vy, T, f;
equation
  der(x) = vx;
  der(y) = vy;
  der(vx) = f - T*x;
  der(vy) = -T*y - 9.81;
  x^2 + y^2 = 1;
  Law.dryFriction(f, vx, 0.01);
end Round;
"""
OVERLAP = """
model Overlap
  Fixed floor;
  Mass m(m = 1, q(start = -0.1));
  Stop ground(L = 0);
equation
  connect(floor.flange, ground.a);
  connect(ground.b, m.flange);
end Overlap;
"""


def test_a_mass_that_a_press_has_caught_stops_the_run():
    with pytest.raises(SimulationError, match=r"t = 0\.5 s.* laws of a, b contradict each other") as failure:
        lmoc.compile_text(CAUGHT).simulate(stop=1, parameters={"reach": 0.5})
    assert failure.value.time == pytest.approx(0.5, abs=1e-10)
    assert failure.value.partial["m.q"][-1] == 0


def test_a_mass_that_is_caught_at_the_start():
    with pytest.raises(ModelError, match="laws of a, b contradict each other"):
        lmoc.compile_text(CAUGHT).simulate(stop=1)


def test_coordinates_change_between_events():
    """What the friction takes is its force times the way of x."""
    run = lmoc.compile_text(ROUND).simulate(stop=1, points=20_001, rtol=1e-9)
    energy = (run["vx"] ** 2 + run["vy"] ** 2) / 2 + 9.81 * run["y"]
    way = np.abs(np.diff(run["x"])).sum()
    assert len(run.coordinates) > 1
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - 1).max() < 1e-9
    assert energy[0] - energy[-1] == pytest.approx(0.01 * way, rel=1e-5)


def test_a_start_in_which_bodies_overlap():
    with pytest.raises(ModelError, match="gap of 'ground' is negative, -0.1"):
        lmoc.compile_text(OVERLAP).simulate(stop=1)
