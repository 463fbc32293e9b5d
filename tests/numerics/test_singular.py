"""Coordinates that cease to determine the rest on the way: the run says so, and only then."""

import numpy as np
import pytest
from conftest import ROOT

import lmoc

PENDULUM = """
model Pendulum
  Real x(start = 1, fixed = true), y(start = 0), vx, vy, T;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
end Pendulum;
"""

ANGLE = """
model Angle
  Real phi(start = 0, fixed = true), omega;
equation
  der(phi) = omega; der(omega) = -9.81*cos(phi);
end Angle;
"""

ROCKER = """
model Rocker "Two arms whose ends are joined: the shorter one turns, the longer one rocks"
  {0}; {1};
  Arm short(l = 0.3), long(l = 0.5);
  Rod rod;
equation
  connect(crank.shaft, short.shaft); connect(rocker.shaft, long.shaft);
  connect(short.flange, rod.a); connect(rod.b, long.flange);
end Rocker;
"""
CRANK = "Inertia crank(J = 1, omega(start = 5, fixed = true))"
ARM = "Inertia rocker(J = 0.5)"

NEARLY_PARALLEL = """
model FourBar
  parameter Real a = 1, b = 2, c = 1.001, d = 2, J1 = 1, J3 = 0.5;
  Real theta(start = 1.5, fixed = true), phi(start = 1.5), omega(start = 1, fixed = true), w3, lam, gx, gy, gt, gp;
equation
  der(theta) = omega; der(phi) = w3;
  gx = d + c*cos(phi) - a*cos(theta); gy = c*sin(phi) - a*sin(theta); gx^2 + gy^2 = b^2;
  gt = 2*gx*a*sin(theta) - 2*gy*a*cos(theta); gp = 2*gy*c*cos(phi) - 2*gx*c*sin(phi);
  J1*der(omega) = gt*lam; J3*der(w3) = gp*lam;
end FourBar;
"""


def broken_off(dae, **options) -> lmoc.SimulationError:
    with pytest.raises(lmoc.SimulationError, match="do not determine") as caught:
        dae.simulate(**options)
    return caught.value


@pytest.mark.parametrize("solver", ["dop853", "cvode", "adams"])
def test_height_of_a_pendulum_at_its_lowest_point(solver):
    dae = lmoc.compile_text(PENDULUM)
    assert dae.states == ["y", "vy"]
    dae.simulate(stop=0.5, solver=solver)
    with pytest.raises(lmoc.SimulationError) as caught:  # by its own error test, or by the look at the whole run
        dae.simulate(stop=1.0, solver=solver)
    failure = caught.value
    assert failure.time == pytest.approx(0.585, abs=0.01)
    assert failure.partial.time[-1] <= failure.time
    angle = lmoc.compile_text(ANGLE).simulate(times=failure.partial.time, rtol=1e-9)
    assert failure.partial["x"] == pytest.approx(np.cos(angle["phi"]), abs=2e-3)


def test_angle_of_a_rocker_that_turns_back():
    wrong = lmoc.compile_text(ROCKER.format(ARM, CRANK))
    assert wrong.states == ["rocker.theta", "rocker.omega"]
    wrong.simulate(stop=0.2)
    failure = broken_off(wrong, stop=2)
    assert "the coordinates rocker.theta, rocker.omega do not determine" in str(failure)
    assert failure.partial.energy.balance < 1e-4
    assert broken_off(wrong, stop=2, keep=["crank.theta"]).time == failure.time
    for order, states in ((CRANK, ARM), None), ((ARM, CRANK), ["crank.theta"]):
        run = lmoc.compile_text(ROCKER.format(*order), states=states).simulate(stop=2)
        assert run.energy.balance < 1e-4


@pytest.mark.parametrize("points", [21, 101, 501])
def test_a_determinant_that_comes_near_zero_and_turns_back_is_no_such_place(points):
    """A crank and rocker near the change point of a parallelogram: down to 1.6 % of the largest determinant."""
    run = lmoc.compile_text(NEARLY_PARALLEL).simulate(stop=10, points=points)
    assert run.time[-1] == 10


@pytest.mark.parametrize("name", ["andrews", "car_axis", "slider_crank"])
def test_coordinates_that_carry_all_the_way(name):
    dae = lmoc.compile(ROOT / f"models/classic/{name}.lmo")
    run = dae.simulate()
    assert run.time[-1] == dae.flat.experiment.stop
    assert all(np.isfinite(run[state]).all() for state in dae.states)


def test_the_look_at_the_coordinates_changes_nothing():
    dae = lmoc.compile(ROOT / "models/classic/slider_crank.lmo")
    first, second = dae.simulate(points=11), dae.simulate(points=11)
    assert np.array_equal(first["x_slider"], second["x_slider"])
    assert first.stats["evaluations"] == second.stats["evaluations"]


def test_springs_without_stiffness_at_rest_are_no_such_place():
    """The force between two cubic springs follows from a triple root each time the mass passes the middle."""
    dae = lmoc.compile_text("""
        model M Fixed w; CubicSpring a(k = 50), b(k = 80); Mass m(m = 1, q(start = 0.4, fixed = true));
        equation connect(w.flange, a.a); connect(a.b, b.a); connect(b.b, m.flange); end M;""")
    assert dae.simulate(stop=5).time[-1] == 5
