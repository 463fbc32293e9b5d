"""What jumps while its argument does not is no coordinate, and a law on it passes the jump."""

import numpy as np
import pytest

import lmoc

CAM = """
model Cam "A cam turns freely below a mass, which a spring presses down on it"
  Inertia cam(J = 0.1, theta(start = 0, fixed = true), omega(start = 3, fixed = true));
  Fixed wall;
  Spring spring(k = 500, d0 = -0.02);
  Real phi, lift, f(unit = "N");
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Force push(f = f);
  Torque torque(tau = -0.01*sin(phi)*f);
equation
  phi = {angle};
  lift = 0.01*(1 - cos(phi));
  connect(wall.flange, spring.a);
  connect(spring.b, m.flange);
  connect(torque.shaft, cam.shaft);
  connect(push.flange, m.flange);
  Law.unilateral(f, m.q - lift);
  annotation(experiment(StopTime = 6.5));
end Cam;
"""


@pytest.mark.parametrize("angle", ["mod(cam.theta, 2*{pi})", "cam.theta - 2*{pi}*floor(cam.theta/(2*{pi}))",
                                   "noEvent(mod(cam.theta, 2*{pi}))", "rem(cam.theta, 2*{pi})"])  # fmt: skip
def test_a_contact_passes_the_end_of_each_turn(angle) -> None:
    plain = lmoc.compile_text(CAM.format(angle="cam.theta")).simulate(points=201, rtol=1e-9)
    dae = lmoc.compile_text(CAM.format(angle=angle.format(pi="3.141592653589793")))
    assert dae.states == ["cam.theta", "cam.omega", "m.q", "m.v"]
    run = dae.simulate(points=201, rtol=1e-9)
    assert run["phi"] == pytest.approx(np.mod(plain["cam.theta"], 2 * np.pi), abs=1e-6)
    assert run["m.q"] == pytest.approx(plain["m.q"], abs=1e-9)
    assert not [e for e in run.events if e.kind == "impact"]


@pytest.mark.parametrize("formula", ["mod(x, 0.5)", "x - floor(2*x)/2", "rem(x, 0.5)", "x - 0.5*integer(2*x)"])
@pytest.mark.parametrize("around", ["{}", "noEvent({})", "smooth(0, {})"])
def test_a_remainder_is_no_state_though_it_is_differentiated(formula, around) -> None:
    text = f"""model Remainder
      Real x(start = 0, fixed = true, stateSelect = StateSelect.avoid), p(stateSelect = StateSelect.prefer), v;
    equation
      der(x) = 1; p = {around.format(formula)}; v = der(p);
    end Remainder;"""
    run = lmoc.compile_text(text).simulate(times=[0.0, 0.3, 0.6, 0.9, 1.2])
    assert run["x"] == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.2], rel=1e-9)
    assert run["p"] == pytest.approx([0.0, 0.3, 0.1, 0.4, 0.2], rel=1e-9)
