"""Gauss collocation keeps its tolerance, whatever the scene, and a finer one is more accurate."""

import numpy as np
import pytest

import lmoc

# two bodies of an open chain with gear and springs: coefficients of its motion are small by chance
GEARED = """
model Geared
  import Planar.*;
  inner World world(g = 3.0);
  Ground ground(x = -0.165, y = -0.168);
  Revolute j0(useShaft = true, phi(start = 0.36359), omega(start = -0.18537133491680957));
  Bar b0(l = 0.426, m = 1.363);
  Revolute j1(useShaft = true, phi(start = 0.706, fixed = true), omega(start = -0.3599443396442896, fixed = true));
  Body b1(m = 2.954, J = 0.85, cx = 0.024, cy = -0.332);
  Link k1(rx = -0.406, ry = 0.292);
  PointOf p0(rx = 1.491, ry = 0.147), p1(rx = -1.091, ry = -0.842);
  Spring e0(k = 14.655, d0 = 0.381);
  TorsionSpring ts0(k = 13.037, phi0 = -1.396);
  .Gear gear(N = 0.515);
equation
  connect(ground.frame, j0.a); connect(j0.b, b0.a); connect(ground.frame, j1.a); connect(j1.b, b1.frame);
  connect(b1.frame, k1.a); connect(b0.b, p0.frame); connect(k1.b, p1.frame);
  connect(p0.point, e0.a); connect(e0.b, p1.point);
  connect(b0.a, ts0.a); connect(ts0.b, k1.b);
  connect(j0.shaft, gear.a); connect(gear.b, j1.shaft);
end Geared;
"""
DUFFING = """
model Duffing Real x(start = 1, fixed = true), v(start = 0, fixed = true);
equation der(x) = v; der(v) = -x - 5*x^3 + cos(3*time); end Duffing;
"""
ORBIT = """
model Orbit
  Real x(start = 0.4, fixed = true), y(start = 0, fixed = true), u(start = 0, fixed = true), v(start = 2, fixed = true);
equation
  der(x) = u; der(y) = v; der(u) = -x/(x^2 + y^2)^1.5; der(v) = -y/(x^2 + y^2)^1.5;
end Orbit;
"""


@pytest.mark.parametrize(
    ("text", "names", "stop"),
    [(GEARED, ("j0.phi", "j1.phi"), 2.0), (DUFFING, ("x", "v"), 3.0), (ORBIT, ("x", "y", "u", "v"), 6.0)],
)
def test_errors_fall_with_the_tolerance(text, names, stop):
    dae = lmoc.compile_text(text)

    def end(solver, rtol):
        run = dae.simulate(stop=stop, rtol=rtol, solver=solver, points=2)
        return np.array([run[name][-1] for name in names])

    truth = end("dop853", 1e-13)
    rtols = 10.0 ** -np.arange(4, 11)
    errors = np.array([np.abs(end("gauss", rtol) - truth).max() for rtol in rtols]) / np.abs(truth).max()
    assert (errors < 10 * rtols).all()
    assert (errors[2:] < errors[:-2]).all()
