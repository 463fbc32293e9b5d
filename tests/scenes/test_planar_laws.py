"""Strings and contacts of the plane against closed forms."""

import numpy as np
import pytest
from scipy.integrate import simpson

import lmoc

G = 9.81


def compiled(name: str, parts: str, equations: str) -> lmoc.DAE:
    text = f"model {name}\n  import Planar.*;\n  inner World world;\n{parts}\nequation\n{equations}\nend {name};"
    return lmoc.compile_text(text)


def particle(x: float, y: float, vx: float, vy: float, equations: str, parts: str) -> lmoc.DAE:
    start = f"x(start = {x}, fixed = true), y(start = {y}, fixed = true), " + (
        f"vx(start = {vx}, fixed = true), vy(start = {vy}, fixed = true)"
    )
    return compiled("Particle", f"  PointMass p(m = 1, {start});\n{parts}", equations)


def test_a_pendulum_on_a_string_that_becomes_slack():
    """Slack where cos θ = −(v0² − 2gL)/(3gL), free flight, a plastic jerk."""
    dae = particle(0, -1, 6, 0, "  connect(anchor.point, string.a); connect(string.b, p.point);",
                   "  Anchor anchor; Cable string(L = 1);")  # fmt: skip
    run = dae.simulate(times=[0, 0.484466131711, 1.276023589312, 3], rtol=1e-11)
    slack, taut = run.events
    assert (slack.kind, taut.kind) == ("slack", "taut")
    assert [slack.time, taut.time] == pytest.approx([0.484466131711, 1.276023589312], abs=1e-10)
    assert taut.impulse == pytest.approx(5.966166408439, abs=1e-8)
    assert [run["p.x"][1], run["p.y"][1]] == pytest.approx([0.8307974208423, 0.5565749235474], abs=1e-9)
    assert [run["p.x"][3], run["p.y"][3]] == pytest.approx([-0.09510623879475, -0.9954671282078], abs=1e-9)
    speed = run["p.vy"] * run["p.x"] - run["p.vx"] * run["p.y"]
    assert speed[3] == pytest.approx(-0.5620706737102, abs=1e-9)
    assert taut.energy_lost == pytest.approx(5.966166408439**2 / 2, abs=1e-8)
    assert run["string.gap"] == pytest.approx(1 - np.hypot(run["p.x"], run["p.y"]), abs=1e-14)


@pytest.mark.parametrize(("solver", "rtol"), [("auto", 1e-3), ("taylor", 1e-6), ("radau", 1e-6), ("cvode", 1e-6)])
def test_a_taut_string_is_not_longer_whatever_the_tolerance(solver, rtol):
    """Its equation holds the acceleration; length and rate would drift with the square of time."""
    dae = particle(0.6, -0.8, 0, 0, "  connect(anchor.point, string.a); connect(string.b, p.point);",
                   "  Anchor anchor; Cable string(L = 1);")  # fmt: skip
    run = dae.simulate(stop=8, points=81, solver=solver, rtol=rtol)
    assert not run.events and [mode for _, mode in run.modes] == [{"string": "taut"}]
    x, y, u, v = (run[f"p.{name}"] for name in ("x", "y", "vx", "vy"))
    assert np.abs(np.hypot(x, y) - 1).max() < 1e-12
    assert np.abs(run["string.gap"]).max() < 1e-12
    assert np.abs(x * u + y * v).max() < 1e-12
    assert np.abs((u**2 + v**2) / 2 + G * (y + 0.8)).max() < 1e4 * rtol


def test_a_string_pulls_with_its_tension_and_may_be_folded_up():
    """Dropped from the anchor itself, where the string has no direction."""
    dae = particle(0, 0, 0, 0, "  connect(anchor.point, string.a); connect(string.b, p.point);",
                   "  Anchor anchor; Cable string(L = 0.5);")  # fmt: skip
    run = dae.simulate(stop=1, points=11, rtol=1e-9)
    (taut,) = run.events
    assert taut.time == pytest.approx(np.sqrt(1 / G), abs=1e-10)
    assert taut.impulse == pytest.approx(np.sqrt(G), abs=1e-9)
    assert run["string.f"][-1] == pytest.approx(G, abs=1e-9)
    assert run["p.y"][-1] == pytest.approx(-0.5, abs=1e-12)


def inclined(alpha: float, mu: float, e: float, height: float, speed: float) -> lmoc.DAE:
    """A particle above a slope that falls along (ny, −nx), at the origin of the slope, moving along it."""
    n, t = np.array([np.sin(alpha), np.cos(alpha)]), np.array([np.cos(alpha), -np.sin(alpha)])
    place, velocity = height * n, speed * t
    edge = f"  Contact edge(nx = {3 * n[0]:.17g}, ny = {3 * n[1]:.17g}, e = {e}, mu = {mu});"
    return particle(*map(float, (*place, *velocity)), "  connect(p.point, edge.point);", edge)


def test_bounces_on_a_slope_with_friction():
    """Normal velocities shrink by e, and each impact takes μ·(1 + e) of them from the sliding, until it sticks."""
    alpha, mu, e, speed = 0.3, 0.2, 0.6, 3.0
    run = inclined(alpha, mu, e, 0.5, speed).simulate(stop=2, points=3, rtol=1e-10)
    down, along = G * np.cos(alpha), G * np.sin(alpha)
    time, fall, slip = np.sqrt(1 / down), np.sqrt(down), speed
    slip += along * time
    for event in [v for v in run.events if v.kind == "impact"][:6]:
        normal = (1 + e) * fall
        kept = slip - np.sign(slip) * min(abs(slip), mu * normal)
        assert event.time == pytest.approx(time, abs=1e-9)
        assert event.impulse == pytest.approx(normal, abs=1e-9)
        assert event.energy_lost == pytest.approx((fall**2 * (1 - e**2) + slip**2 - kept**2) / 2, abs=1e-9)
        fall *= e
        slip = kept + along * 2 * fall / down
        time += 2 * fall / down


@pytest.mark.parametrize(("mu", "alpha"), [(0.5, 0.3), (0.2, 0.3)])
def test_sliding_down_a_slope_ends_where_friction_can_hold(mu, alpha):
    run = inclined(alpha, mu, 0, 0.0, 2.0).simulate(stop=3, points=301, rtol=1e-10)
    x = run["p.x"] / np.cos(alpha)
    rate = G * (np.sin(alpha) - mu * np.cos(alpha))
    assert np.abs(run["edge.gap"]).max() < 1e-12
    assert run["edge.fn"] == pytest.approx(np.full(301, G * np.cos(alpha)), abs=1e-9)
    if rate > 0:
        assert x == pytest.approx(2 * run.time + rate * run.time**2 / 2, abs=1e-9)
        return
    (stick,) = [v for v in run.events if v.kind == "stick"]
    assert stick.time == pytest.approx(-2 / rate, abs=1e-10)
    after = run.time > stick.time
    assert np.ptp(x[after]) < 1e-14 and x[after][0] == pytest.approx(-2 / rate, abs=1e-9)
    assert run["edge.ft"][after] == pytest.approx(np.full(after.sum(), -G * np.sin(alpha)), abs=1e-9)


@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.0), (0.5, 0.0), (0.5, 0.1), (0.3, 2.0)])
def test_a_bar_falls_on_its_corner(e, mu):
    """Impulse formula of the end of a bar: it slides through the impact, or sticks in it."""
    angle, length, mass = 0.4, 1.2, 3.0
    dae = compiled("Falling", f"""  Bar bar(l = {length}, m = {mass}, x(start = 0, fixed = true),
    y(start = 0.5, fixed = true), theta(start = {angle}, fixed = true),
    vx(start = 0.7, fixed = true), vy(start = 0, fixed = true),
    omega(start = 0, fixed = true));
  PointOf corner; Contact floor(e = {e}, mu = {mu});""",
        "  connect(bar.a, corner.frame); connect(corner.point, floor.point);")  # fmt: skip
    run = dae.simulate(stop=0.34, points=2, rtol=1e-10)
    impact = run.events[0]
    assert impact.time == pytest.approx(np.sqrt(1 / G), abs=1e-10)
    dx, dy, inertia = length / 2 * np.cos(angle), length / 2 * np.sin(angle), mass * length**2 / 12
    inverse = np.array(
        [[1 / mass + dx**2 / inertia, -dx * dy / inertia], [-dx * dy / inertia, 1 / mass + dy**2 / inertia]]
    )
    fall, slip = -np.sqrt(G), 0.7  # rows and columns: along the normal, along +x
    stick = np.linalg.solve(inverse, [-(1 + e) * fall, -slip])
    if abs(stick[1]) <= mu * stick[0]:
        expected = stick
    else:
        side = np.sign(stick[1])
        expected = np.array([1.0, side * mu]) * -(1 + e) * fall / (inverse[0] @ [1.0, side * mu])
    assert impact.impulse == pytest.approx(expected[0], rel=1e-9)
    before = np.array([fall, slip])
    assert impact.energy_lost == pytest.approx(-expected @ (before + inverse @ expected / 2), rel=1e-8)


CARTESIAN = """model Cartesian "a pendulum in x and y that hits a wall"
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T, fn, gap;
  discrete Integer turns(start = 0, fixed = true);
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x - fn; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
  gap = WALL - x;
  Law.unilateral(fn, gap, 0.8);
  when y > 0.1 then turns = pre(turns) + 1; end when;
end Cartesian;"""
ANGULAR = """model Angular
  Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true), fn, gap;
equation
  der(theta) = omega; der(omega) = -9.81*sin(theta) - fn*cos(theta);
  gap = WALL - sin(theta);
  Law.unilateral(fn, gap, 0.8);
end Angular;"""


@pytest.mark.parametrize(("wall", "speed"), [(0.3, 7.1), (2.0, 7.1)])
def test_coordinates_change_between_impacts_and_events(wall, speed):
    """The mode and the discrete values go on in the new coordinates; roots are found there as well."""
    cartesian, angular = (lmoc.compile_text(t.replace("WALL", str(wall))) for t in (CARTESIAN, ANGULAR))
    run = cartesian.simulate(stop=4, points=41, rtol=1e-9, initial={"vx": speed})
    other = angular.simulate(stop=4, points=41, rtol=1e-11, initial={"omega": speed})
    x, y = np.sin(other["theta"]), -np.cos(other["theta"])
    assert len(run.coordinates) > 3
    assert np.abs(run["x"] - x).max() < 2e-7 and np.abs(run["y"] - y).max() < 2e-7
    impacts = [v for v in run.events if v.kind == "impact"]
    assert [v.time for v in impacts] == pytest.approx([v.time for v in other.events], abs=1e-7)
    assert [v.impulse for v in impacts] == pytest.approx([v.impulse for v in other.events], abs=1e-6)
    fine = angular.simulate(stop=4, points=4001, initial={"omega": speed}, rtol=1e-9)
    above = -np.cos(fine["theta"]) > 0.1
    assert run["turns"][-1] == np.count_nonzero(above[1:] & ~above[:-1])


def test_what_happens_in_a_step_that_is_good_in_part_is_not_missed():
    """A step of a Taylor series is looked at several times; where the coordinates serve to its middle alone, events
    before that are found where they are, by θ' = √(v² − 2g(1 − cos θ))."""
    text = CARTESIAN.replace("WALL", "9").replace("y > 0.1", "x > 0.5")
    run = lmoc.compile_text(text).simulate(stop=4, points=3, rtol=1e-9, solver="taylor")
    angle = np.pi / 6 + 2 * np.pi * np.arange(4)
    ways = [np.linspace(0, a, 4001) for a in angle]
    expected = [simpson(1 / np.sqrt(7.1**2 - 2 * 9.81 * (1 - np.cos(w))), x=w) for w in ways]
    assert len(run.coordinates) > 9
    assert [v.time for v in run.events] == pytest.approx(expected, abs=1e-8)


def test_a_closed_loop_hits_a_wall_on_its_own_branch():
    """The rocker of a parallelogram hits an edge: the whole mechanism takes part in the impact."""
    dae = compiled("Linkage", """  Ground left, right(x = 1);
  Revolute first(phi(start = 2, fixed = true), omega(start = 1, fixed = true)), second(phi(start = 2));
  Revolute third(phi(start = -2)), fourth;
  Bar crank(l = 0.5, m = 1), coupler(l = 1, m = 1), rocker(l = 0.5, m = 1);
  PointOf tip; Contact wall(nx = 1, ny = 0, d = 0.55, e = 0.5);""",
        """  connect(left.frame, first.a); connect(first.b, crank.a); connect(crank.b, third.a);
  connect(third.b, coupler.a); connect(coupler.b, fourth.a); connect(fourth.b, rocker.b); connect(rocker.a, second.b);
  connect(right.frame, second.a); connect(rocker.b, tip.frame); connect(tip.point, wall.point);""")  # fmt: skip
    run = dae.simulate(stop=0.5, points=6, rtol=1e-10)
    impact = run.events[0]
    inertia, pull = (2 / 3 + 1) / 4, G * 2 * 0.5  # of both cranks and the coupler; its moment at horizontal cranks
    end = np.arccos((0.55 - 1) / 0.5)
    omega = np.sqrt(1 - 2 * pull / inertia * (np.sin(end) - np.sin(2)))
    arm = 0.5 * np.sin(end)  # of the edge's force
    assert impact.impulse == pytest.approx(1.5 * omega * inertia / arm, rel=1e-9)
    assert impact.energy_lost == pytest.approx(inertia * omega**2 / 2 * (1 - 0.25), rel=1e-9)
    assert np.abs(run["second.phi"] - run["first.phi"]).max() < 1e-12
    assert run["wall.gap"].min() > -1e-9


def test_painleves_paradox_is_reported():
    """A bar pushed ahead on a rough floor: no normal force holds its tip, as its friction turns the bar into it."""
    angle, length = 1.2, 1.0
    dae = compiled("Chalk", f"""  Bar bar(l = {length}, m = 1, x(start = 0, fixed = true), y(start = 0, fixed = true),
    theta(start = {angle}, fixed = true), vx(start = -1, fixed = true), vy(start = 0, fixed = true),
    omega(start = 0, fixed = true));
  PointOf tip; Contact floor(mu = 2);""",
        "  connect(bar.a, tip.frame); connect(tip.point, floor.point);")  # fmt: skip
    dx, dy = length / 2 * np.cos(angle), length / 2 * np.sin(angle)
    assert 1 + 12 * dx**2 - 2 * 12 * dx * dy < 0  # acceleration of the tip by a normal force with its friction
    with pytest.raises(lmoc.ModelError, match="floor contradict each other"):
        dae.simulate(stop=0.1)
    run = dae.simulate(stop=0.05, points=2, initial={"bar.vx": 1})  # pulled behind, it slides
    assert run["floor.fn"].min() > 0 and np.abs(run["floor.gap"]).max() < 1e-12
