"""Two particles on strings, one below the other: slack at the start, and taut where they hang."""

TWO_BOBS = """
model TwoBobs
  import Planar.*;
  parameter Real l1 = 1, l2 = 0.5;
  inner World world(g = 9.81);
  Anchor top;
  PointMass a(m = 2, x(start = 0.3, fixed = true), y(start = -0.2, fixed = true));
  PointMass b(m = 1, x(start = 0.5, fixed = true), y(start = -0.3, fixed = true));
  Cable upper(L = l1), lower(L = l2);
equation
  connect(top.point, upper.a);
  connect(upper.b, a.point);
  connect(a.point, lower.a);
  connect(lower.b, b.point);
end TwoBobs;
"""
