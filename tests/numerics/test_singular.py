"""Coordinates that cease to determine the rest on the way: the run says so, and only then."""

import numpy as np
import pytest
from oracles.models import compiled

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


HEIGHT = """
model Height "a point on a circle, started where its height says nothing of its side"
  parameter Real L = 1, g = 9.81;
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x/L; der(vy) = -T*y/L - g; x^2 + y^2 = L^2;
end Height;
"""
SWING = """
model Swing
  Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true);
equation
  der(theta) = omega; der(omega) = -9.81*sin(theta);
end Swing;
"""
SHAFT = """
model A "an arm that turns over 90 degrees; the load is also watched in a frame at rest"
  Bar b(m = 1, l = 1, theta(start = 0, fixed = true), omega(start = 4, fixed = true));
  Arm arm(l = 0.5); Mass w(m = 1, g = -9.81); Fixed ground; MovingFrame frame;
equation
  connect(b.shaft, arm.shaft); connect(arm.flange, w.flange);
  connect(ground.flange, frame.base); connect(frame.flange, w.flange);
end A;
"""


EQUAL_CRANK = """
model Equal "a crank and a connecting rod of the same length: at 90 degrees the rod may turn back or go through"
  parameter Real J = 1, m = 1;
  Real t(start = 0.3, fixed = true), p(start = -0.3), x, w(start = 3, fixed = true), wp, v, f1, f2;
equation
  der(t) = w; der(p) = wp; der(x) = v;
  cos(t) + cos(p) = x; sin(t) + sin(p) = 0;
  J*der(w) = -sin(t)*f1 + cos(t)*f2; 0.1*der(wp) = -sin(p)*f1 + cos(p)*f2; m*der(v) = -f1;
end Equal;
"""


@pytest.mark.parametrize("options", [{}, {"points": 2}, {"solver": "cvode", "rtol": 1e-8}, {"solver": "radau"}])
def test_a_bifurcation_is_passed_on_the_branch_with_continuous_velocities(options):
    run = lmoc.compile_text(EQUAL_CRANK).simulate(stop=2, **options)
    t, w = run["t"], run["w"]
    assert t[-1] > 1.2 * np.pi / 2
    assert run["p"] == pytest.approx(-t, abs=1e-9)
    energy = (1 + 0.1 + 4 * np.sin(t) ** 2) * w**2
    assert energy == pytest.approx(energy[0], rel=1e-4)
    assert sum(n.code == "N0633" for n in run.notes) == 1


@pytest.fixture(scope="module")
def height():
    return lmoc.compile_text(HEIGHT)


@pytest.fixture(scope="module")
def swing():
    return lmoc.compile_text(SWING)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "ida", "radau", "auto"])
@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_a_pendulum_in_x_and_y_is_as_right_as_one_in_an_angle(height, swing, solver, rtol):
    options = {"stop": 3, "points": 31, "rtol": rtol, "solver": solver}
    exact = swing.simulate(**options | {"rtol": 1e-12, "solver": "dop853"})
    error = np.abs(np.sin(swing.simulate(**options)["theta"]) - np.sin(exact["theta"])).max()
    run = height.simulate(**options)
    assert np.abs(run["x"] - np.sin(exact["theta"])).max() < 30 * error + 1e-11
    assert np.abs(run["y"] + np.cos(exact["theta"])).max() < 30 * error + 1e-11
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - 1).max() < 1e-12


def test_what_the_output_times_are_changes_neither_steps_nor_coordinates(height, swing):
    exact = swing.simulate(stop=3, points=3001, rtol=1e-12)
    whole = height.simulate(stop=3, points=3001)
    random = np.random.default_rng(3)
    for count in (1, 2, 3, 5, 17, 100):
        rows = np.unique(np.append(random.integers(0, 3001, count), 3000))
        run = height.simulate(times=exact.time[rows])
        assert run.coordinates == whole.coordinates and run.stats["steps"] == whole.stats["steps"]
        assert run["x"] == pytest.approx(np.sin(exact["theta"][rows]), abs=1e-4)
        assert run["y"] == pytest.approx(-np.cos(exact["theta"][rows]), abs=1e-4)


def test_which_coordinates_held_when_is_told(height):
    run = height.simulate(stop=3)
    times, names = zip(*run.coordinates, strict=True)
    assert times[0] == 0 and (np.diff(times) > 0).all()
    assert set(map(tuple, names)) == {("x", "vx"), ("y", "vy")}
    (note,) = [n.message for n in run.notes if n.code == "N0632"]
    assert note == f"coordinates changed {len(times) - 1} times, between x, vx; y, vy"
    ratio = np.abs(run["x"] / run["y"])
    first = np.searchsorted(times, run.time, "right") - 1
    dependent = np.array([ratio[k] if names[i] == ["x", "vx"] else 1 / ratio[k] for k, i in enumerate(first)])
    assert dependent.max() < 4  # what is divided by never comes near zero


@pytest.mark.parametrize("stop", [0.3, 0.5, 1.9])
def test_a_run_goes_on_from_the_end_of_another_in_its_coordinates_and_on_its_side(height, stop):
    whole = height.simulate(times=[stop, 3.0], rtol=1e-10)
    first = height.simulate(stop=stop, rtol=1e-10)
    second = height.simulate(initial=first.end, stop=3, rtol=1e-10, points=2)
    assert second.time.tolist() == [stop, 3.0]
    assert second.coordinates[0] == (stop, first.coordinates[-1][1])
    assert second["x"] == pytest.approx(whole["x"], abs=1e-6)
    assert second["y"][0] == pytest.approx(first["y"][-1], abs=1e-15)


@pytest.mark.parametrize("solver", ["dop853", "cvode"])
def test_height_of_a_pendulum_at_its_lowest_point(solver):
    dae = lmoc.compile_text(PENDULUM)
    assert dae.states == ["y", "vy"]
    run = dae.simulate(stop=3, solver=solver, rtol=1e-8)
    angle = lmoc.compile_text(ANGLE).simulate(times=run.time, rtol=1e-11)
    assert run["x"] == pytest.approx(np.cos(angle["phi"]), abs=1e-4)


def test_angle_of_a_rocker_that_turns_back():
    wrong = lmoc.compile_text(ROCKER.format(ARM, CRANK))
    assert wrong.states == ["rocker.theta", "rocker.omega"]
    right = lmoc.compile_text(ROCKER.format(CRANK, ARM)).simulate(stop=2, rtol=1e-10)
    for options in ({}, {"keep": ["crank.theta", "rocker.theta"]}, {"points": 2}):
        run = wrong.simulate(stop=2, rtol=1e-9, **options)
        rows = np.searchsorted(right.time, run.time)
        for name in ("crank.theta", "rocker.theta"):
            assert run[name] == pytest.approx(right[name][rows], abs=1e-6)
        assert [names for _, names in run.coordinates] == [
            ["rocker.theta", "rocker.omega"], ["crank.theta", "crank.omega"]
        ]  # fmt: skip


@pytest.mark.parametrize("options", [{}, {"points": 3}, {"points": 7, "solver": "cvode", "rtol": 1e-8}])
def test_a_frame_at_rest_does_not_tell_where_an_arm_has_turned_to(options):
    run = lmoc.compile_text(SHAFT).simulate(stop=2, **options)
    exact = lmoc.compile_text(SHAFT, states=["b.theta"]).simulate(times=run.time, rtol=1e-11)
    assert run["b.theta"] == pytest.approx(exact["b.theta"], abs=1e-4)
    assert run.energy.balance < 1e-3


@pytest.mark.parametrize("points", [21, 101, 501])
def test_a_determinant_that_comes_near_zero_and_turns_back_is_no_such_place(points):
    """A crank and rocker near the change point of a parallelogram: down to 1.6 % of the largest determinant."""
    run = lmoc.compile_text(NEARLY_PARALLEL).simulate(stop=10, points=points)
    assert run.time[-1] == 10


@pytest.mark.parametrize("name", ["andrews", "car_axis", "slider_crank"])
def test_coordinates_that_carry_all_the_way(name):
    dae = compiled(f"classic/{name}")
    run = dae.simulate()
    assert run.time[-1] == dae.flat.experiment.stop
    assert all(np.isfinite(run[state]).all() for state in dae.states)


def test_the_look_at_the_coordinates_changes_nothing():
    dae = compiled("classic/slider_crank")
    first, second = dae.simulate(points=11), dae.simulate(points=11)
    assert np.array_equal(first["x_slider"], second["x_slider"])
    assert first.stats["evaluations"] == second.stats["evaluations"]


def test_springs_without_stiffness_at_rest_are_no_such_place():
    """The force between two cubic springs follows from a triple root each time the mass passes the middle."""
    dae = lmoc.compile_text("""
        model M Fixed w; CubicSpring a(k = 50), b(k = 80); Mass m(m = 1, q(start = 0.4, fixed = true));
        equation connect(w.flange, a.a); connect(a.b, b.a); connect(b.b, m.flange); end M;""")
    assert dae.simulate(stop=5).time[-1] == 5


def test_a_prescribed_motion_that_turns_round_is_no_jump():
    """Where a step spans its turning point, velocities leave more unexplained within than in all."""
    dae = compiled("classic/car_axis")
    run = dae.simulate(rtol=1e-8)
    assert not {"N0632", "N0633"} & {n.code for n in run.notes} and len(run.coordinates) == 1
