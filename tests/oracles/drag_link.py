"""A crank that turns a rocker round, which moves nothing: its angle in closed form."""

import numpy as np

DRAG_LINK = """
model DragLink "A flywheel turns a crank, and by a coupler a rocker without mass that turns round, too"
  import Planar.*;
  output Real theta = crank.phi, phi = rocker.phi;
  inner World world(g = {g});
  Ground O, Q(x = 0.5);
  Revolute crank(phi(start = 1.5, fixed = true), omega(start = 6, fixed = true)), rocker(phi(start = 1.1)), A, B;
  Body wheel(m = 1, J = 1);
  Link a(rx = 1, ry = 0), b(rx = {b}, ry = 0), c(rx = {c}, ry = 0);
  discrete Integer n(start = 0, fixed = true);
equation
  connect(O.frame, crank.a); connect(crank.b, wheel.frame); connect(wheel.frame, a.a);
  connect(a.b, A.a); connect(A.b, c.a); connect(c.b, B.b); connect(b.b, B.a);
  connect(Q.frame, rocker.a); connect(rocker.b, b.a);
  when {when} then n = pre(n) + 1; end when;
  annotation(experiment(StopTime = 8));
end DragLink;
"""


def rocker(theta: np.ndarray, b: float, c: float) -> np.ndarray:
    """Its angle over that of the crank, one way round, from near 1.1."""
    x, y = np.cos(theta) - 0.5, np.sin(theta)
    d = np.hypot(x, y)
    return np.unwrap(np.arctan2(y, x)) - np.arccos((b**2 + d**2 - c**2) / (2 * b * d))
