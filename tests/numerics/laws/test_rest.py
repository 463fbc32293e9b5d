"""What laws hold at rest does not move by one bit."""

import numpy as np
import pytest
from oracles.lawful import held_velocities

import lmoc

SLOPE = """model Slope "a block that sticks on a slope"
  Fixed wall; Mass m(m = 1.3, g = 9.81*sin(0.3), q(start = 0.7, fixed = true), v(start = 0, fixed = true));
  DryFriction f(F = 9);
equation
  connect(wall.flange, f.a); connect(f.b, m.flange);
end Slope;"""
PLANAR = """model PlanarSlope "a point that rests and sticks on an inclined line, pulled by a force that changes"
  import Planar.*;
  inner World world;
  PointMass p(m = 1.3, x(start = 0, fixed = true), y(start = 0, fixed = true), vx(start = 0, fixed = true),
    vy(start = 0, fixed = true));
  Contact c(nx = -sin(0.3), ny = cos(0.3), mu = 0.9);
  Force f(fx = sin(time), fy = 0);
equation
  connect(c.point, p.point); connect(f.point, p.point);
end PlanarSlope;"""
FRAME = """model Frame "a mass that sticks in a frame that moves to and fro"
  Motion base(q = 0.2*time + sin(time)); MovingFrame frame; Mass m(m = 1.3); DryFriction f(F = 90);
equation
  connect(base.flange, frame.base); connect(frame.flange, m.flange);
  connect(base.flange, f.a); connect(f.b, m.flange);
initial equation
  frame.q = 0.7; frame.v = 0;
end Frame;"""


@pytest.mark.parametrize("seed", range(40))
def test_what_is_held_does_not_show_in_the_null_space(seed):
    """Forms in one, two or more velocities, some of which depend on each other, against singular vectors."""
    dice = np.random.default_rng(seed)
    forms, most = np.zeros((int(dice.integers(1, 12)), 8)), int(dice.integers(1, 5))
    for row in forms:
        row[dice.choice(8, size=1 + int(dice.integers(0, most)), replace=False)] = dice.choice([-2, -1, 1, 3])
    forms[0, :2] = 1.0, 1e-17  # rounding
    _, values, vectors = np.linalg.svd(np.where(np.abs(forms) > 1e-9, forms, 0.0))
    free = vectors[np.count_nonzero(values > 1e-9) :]
    assert held_velocities(forms).tolist() == (np.abs(free).max(axis=0, initial=0.0) < 1e-9).tolist()


def test_velocities_vanish_where_the_forms_leave_no_other_choice():
    s, c = np.sin(0.3), np.cos(0.3)
    both = np.array([[-s, c, 0.0, 0.0], [c, s, 0.0, 0.0]])
    assert held_velocities(both).tolist() == [True, True, False, False]
    assert not held_velocities(both[:1]).any()  # it may slide
    chain = np.array([[0.0, 1.0, 0, -1.0], [0.0, 0.0, 0.0, 2.0]])
    assert held_velocities(chain).tolist() == [False, True, False, True]
    assert not held_velocities(chain[:1]).any()  # they move together
    assert held_velocities(np.array([[np.nan] * 2, [0.0, 3.0]])).tolist() == [False, True]
    assert not held_velocities(np.zeros((0, 3))).any()
    assert held_velocities(np.array([[1e-9, 0.0], [1e9, 1e9]])).all()  # rows have scales of their own


@pytest.mark.parametrize("solver", ["auto", "cvode", "gauss"])
@pytest.mark.parametrize(
    "text, names", [(SLOPE, ["m.q"]), (PLANAR, ["p.x", "p.y"]), (FRAME, ["frame.q"])], ids=["slope", "planar", "frame"]
)
def test_a_hundred_seconds_of_sticking_without_drift(text, names, solver):
    run = lmoc.compile_text(text).simulate(stop=100, points=201, solver=solver)
    assert run.events == ()
    for name in names:
        assert (run[name] == run[name][0]).all()


def test_what_is_held_is_let_go():
    """The block slides once its load has grown beyond the limit: at 2 s, with (F(t) − 4)/m from there on."""
    text = """model Loaded
  Fixed wall; Mass m(m = 2); DryFriction f(F = 4); Force pull(f = 2*time);
equation
  connect(wall.flange, f.a); connect(f.b, m.flange); connect(pull.flange, m.flange);
end Loaded;"""
    run = lmoc.compile_text(text).simulate(times=[0.0, 1.9, 3.0], rtol=1e-10)
    assert run["m.q"][1] == 0.0 == run["m.v"][1]
    assert [e.time for e in run.events] == pytest.approx([2.0], abs=1e-10)
    assert run["m.v"][-1] == pytest.approx(0.5, abs=1e-10) and run["m.q"][-1] == pytest.approx(1 / 6, abs=1e-10)


def test_a_belt_does_not_hold_a_mass_at_rest():
    """A velocity that a law keeps equal to that of a belt is none that vanishes, even where the belt turns."""
    text = """model Belt
  Motion belt(q = sin(time)); Mass m(m = 1, q(start = 0, fixed = true), v(start = 1, fixed = true));
  DryFriction f(F = 9);
equation
  connect(belt.flange, f.a); connect(f.b, m.flange);
end Belt;"""
    run = lmoc.compile_text(text).simulate(stop=5, rtol=1e-10)
    assert run.events == () and run["m.q"] == pytest.approx(np.sin(run.time), abs=1e-9)
