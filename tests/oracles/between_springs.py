"""Scenes of friction between springs, without a mass in between: its forces are states."""

JENKINS = """model Jenkins
  Fixed wall;
  Motion drive(q = 0.02*sin(2*time));
  Spring spring(k = 100);
  DryFriction slider(F = 1);
equation
  connect(drive.flange, spring.b);
  connect(spring.a, slider.b);
  connect(slider.a, wall.flange);
end Jenkins;"""

IWAN = """model Iwan "elements side by side on a mass"
  Fixed wall;
  Mass m(m = 1, q(start = 0.05, fixed = true), v(start = 0, fixed = true));
  Spring k[3](each k = 100);
  Spring k0(k = 20);
  DryFriction f[3](F = {0.5, 1, 1.5});
equation
  for i in 1:3 loop
    connect(m.flange, k[i].b);
    connect(k[i].a, f[i].b);
    connect(f[i].a, wall.flange);
  end for;
  connect(m.flange, k0.b);
  connect(k0.a, wall.flange);
end Iwan;"""

ROW = """model Row "springs each with a slider beside it, one after the other, driven at their end"
  Fixed wall;
  Motion drive(q = 0.05*sin(2*time));
  Spring k[3](k = {100, 200, 300});
  DryFriction f[3](F = {1.5, 1, 0.5});
equation
  connect(wall.flange, k[1].a);
  connect(wall.flange, f[1].a);
  for i in 1:2 loop
    connect(k[i].b, k[i + 1].a);
    connect(f[i].b, k[i].b);
    connect(f[i + 1].a, k[i].b);
  end for;
  connect(k[3].b, drive.flange);
  connect(f[3].b, drive.flange);
end Row;"""

PEAK = """model Peak "sticks at more than it slides with"
  Fixed wall;
  Motion drive(q = 0.05*time);
  Spring k1(k = 100), k2(k = 50);
  DryFriction f(F = 1, Fstick = 1.5);
equation
  connect(drive.flange, k1.b);
  connect(k1.a, f.b);
  connect(f.a, wall.flange);
  connect(k2.a, wall.flange);
  connect(k2.b, k1.a);
end Peak;"""

AMONG = """model Among "beside laws of other kinds"
  Fixed wall;
  Mass m(m = 1, q(start = 0.05, fixed = true), v(start = 0, fixed = true));
  Mass n(m = 2, q(start = 0.2, fixed = true), v(start = 1, fixed = true));
  Spring k[2](k = {100, 50}), k0(k = 20);
  DryFriction f[2](F = {0.5, 1}, Fstick = {0.6, 1.3}), g(F = 0.2);
  Cable c(L = 0.3, e = 0);
equation
  for i in 1:2 loop
    connect(m.flange, k[i].b);
    connect(k[i].a, f[i].b);
    connect(f[i].a, wall.flange);
  end for;
  connect(m.flange, k0.b); connect(k0.a, wall.flange);
  connect(m.flange, c.a); connect(c.b, n.flange);
  connect(n.flange, g.a); connect(g.b, wall.flange);
end Among;"""
