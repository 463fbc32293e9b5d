"""Contacts of points, disks and edges, tracks and worms, against closed forms and equations of motion by hand."""

import numpy as np
import pytest
from numpy import cos, pi, sin
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import lmoc
from lmoc.view.page.hands import elsewhere

G = 9.81


def run(parts: str, equations: str, stop: float = 1.0, planar: bool = True, balance: float = 1e-6) -> lmoc.Run:
    head = f"import Planar.*; inner World world(g = {G});" if planar else ""
    text = f"model Scene\n{head}\n{parts}\nequation\n{equations}\nend Scene;"
    found = lmoc.compile_text(text).simulate(stop=stop, rtol=1e-9, points=201)
    assert found.energy.balance < balance
    return found


def solution(rate, start, stop: float) -> np.ndarray:
    """The variables at the end."""
    return solve_ivp(rate, (0, stop), start, "DOP853", rtol=1e-11, atol=1e-12, max_step=0.02).y[:, -1]


def fixed(**values: float) -> str:
    return ", ".join(f"{name}(start = {float(value)!r}, fixed = true)" for name, value in values.items())


def rows(x, y) -> str:
    return "{" + ", ".join(f"{{{float(a)!r}, {float(b)!r}}}" for a, b in zip(x, y, strict=True)) + "}"


# ------------------------------------------------------------------------------------------ worms

TURNING = "theta(start = 0, fixed = true), omega(start = 0, fixed = true)"
GAMMA = float(np.arctan(0.1))


def worm(mu: float, drive: str, load: float, inertia: float = 0.01, more: str = "", pressure: float = 0.0) -> lmoc.Run:
    return run(
        f"{drive} Inertia a(J = {inertia}, {TURNING}); Inertia b(J = 2); Torque load(tau = {load});"
        f"Worm w(N = 40, gamma = {GAMMA!r}, mu = {mu}, alpha = {pressure}{', play = 1e-3' if mu else ''});",
        "connect(a.shaft, w.a); connect(w.b, b.shaft); connect(load.shaft, b.shaft);" + more,
        planar=False,
    )


@pytest.mark.parametrize("mu, pressure", [(0.05, 0.0), (0.2, 0.0), (0.05, 0.35)])
def test_a_worm_drives_with_the_efficiency_of_its_thread(mu, pressure):
    r = worm(mu, "Torque drive(tau = 1);", -5, more="connect(drive.shaft, a.shaft);", pressure=pressure)
    rho = np.arctan(mu / cos(pressure))
    efficiency = np.tan(GAMMA) / np.tan(GAMMA + rho)
    # J*alpha of both, the worm's reduced to the wheel: efficiency*N*(1 - J1*N*alpha) = 5 + J2*alpha
    alpha = (efficiency * 40 - 5) / (2 + efficiency * 0.01 * 1600)
    last = r.time > 0.5
    assert np.diff(r["b.omega"][last]) == pytest.approx(np.diff(r.time[last]) * alpha, rel=1e-8)
    driven = -r["w.b.tau"][-1] * r["b.omega"][-1]
    assert driven / (r["w.a.tau"][-1] * r["a.omega"][-1]) == pytest.approx(efficiency, rel=1e-9)


def test_a_worm_without_friction_is_a_gear():
    r = worm(0, "Torque drive(tau = 1);", -5, more="connect(drive.shaft, a.shaft);")
    assert r["b.omega"][-1] == pytest.approx((40 - 5) / (2 + 0.01 * 1600))
    assert r["b.theta"] == pytest.approx(r["a.theta"] / 40, abs=1e-12)


def test_a_worm_locks_itself_where_friction_is_larger_than_its_lead():
    held, turned = (worm(mu, "", -50) for mu in (0.11, 0.09))
    assert held["a.omega"][-1] == 0.0 and abs(held["b.theta"][-1]) < 1.1e-3
    # what the wheel needs: normal force and friction, the worm has no torque
    friction = held["w.drag"][-1] * np.array([1 / (40 * 0.1), 0.1])
    assert held["w.tm"][-1] / 40 == pytest.approx(friction[0])
    assert held["w.tm"][-1] + friction[1] == pytest.approx(50)
    back = np.tan(GAMMA - np.arctan(0.09)) / np.tan(GAMMA)  # the wheel drives
    alpha = 50 / (2 + 0.01 * 1600 / back)
    last = turned.time > 0.5
    assert -np.diff(turned["b.omega"][last]) == pytest.approx(np.diff(turned.time[last]) * alpha, rel=1e-8)


# ------------------------------------------------------------------------------------------ contacts

SLOPE = 0.4
REST = fixed(theta=0, vx=0, vy=0, omega=0)


@pytest.mark.parametrize("mu", [0.5, 0.1, 0.0])
@pytest.mark.parametrize("turned", [True, False])
def test_a_disk_rolls_or_slides_down_a_slope(mu, turned):
    s, c = float(sin(SLOPE)), float(cos(SLOPE))
    edge = "" if turned else f", nx = {s!r}, ny = {c!r}"
    r = run(
        f"Ground g(theta = {-SLOPE if turned else 0}); EdgeContact k(r = 0.2, mu = {mu}{edge});"
        f"Body d(m = 2, J = 0.04, {fixed(x=0.2 * s, y=0.2 * c)}, {REST});",
        "connect(g.frame, k.frame); connect(d.frame, k.disk);",
    )
    rolls = np.tan(SLOPE) / 3 < mu
    a = 2 / 3 * G * s if rolls else G * (s - mu * c)
    turn = -a / 0.2 if rolls else -mu * 2 * G * c * 0.2 / 0.04
    assert np.hypot(r["d.vx"], r["d.vy"])[-1] == pytest.approx(a) and r["d.omega"][-1] == pytest.approx(turn)
    assert r["k.fn"] == pytest.approx(np.full(201, 2 * G * c)) and abs(r["k.gap"]).max() < 1e-13


def test_a_disk_bounces_on_an_edge_that_a_body_carries():
    r = run(
        f"Body plate(m = 3, J = 1, {fixed(x=0, y=0)}, {REST}); EdgeContact k(r = 0.2, d = 0.1, e = 1);"
        f"Body d(m = 2, J = 0.04, {fixed(x=0, y=0.5, theta=0, vx=0, vy=-1, omega=0)});",
        "connect(plate.frame, k.frame); connect(d.frame, k.disk);",
    )
    assert r.events[0].time == pytest.approx(0.2)
    at = -G * r.time[-1]
    assert r["d.vy"][-1] == pytest.approx((2 - 3) / 5 * -1 + at) and r["plate.vy"][-1] == pytest.approx(-4 / 5 + at)


def test_a_particle_slides_down_a_wedge_that_gives_way():
    s, c = float(sin(SLOPE)), float(cos(SLOPE))
    r = run(
        f"Ground g; Prismatic p({fixed(s=0, v=0)}); Body wedge(m = 5, J = 1); PointContact k(nx = {s!r}, ny = {c!r});"
        f"PointMass q(m = 2, {fixed(x=0, y=0, vx=0, vy=0)});",
        "connect(g.frame, p.a); connect(p.b, wedge.frame); connect(wedge.frame, k.frame); connect(q.point, k.point);",
    )
    assert r["p.v"][-1] == pytest.approx(-2 * G * s * c / (5 + 2 * s * s))


def test_friction_on_an_edge_that_turns():
    """A particle inside the far edge of a turning frame: it slides along it with the friction of its own pressure."""

    def rate(t, z):
        x, v = z  # along the edge at y = 1; the pressure is that of centrifugal and Coriolis forces
        return [v, 9.0 * x - 0.3 * (9.0 - 6.0 * v)]

    text = f"""model Scene
      import Planar.*;
      inner World world(g = 0);
      Ground g;
      Revolute pin(useShaft = true);
      RotationSpeed drive(omega = 3);
      Body table(m = 1, J = 1);
      PointContact k(ny = -1, d = -1, mu = 0.3);
      PointMass q(m = 2, {fixed(x=0.5, y=1, vx=-3 + 0.4, vy=1.5)});
    equation
      connect(g.frame, pin.a);
      connect(pin.b, table.frame);
      connect(drive.shaft, pin.shaft);
      connect(table.frame, k.frame);
      connect(q.point, k.point);
    end Scene;"""
    r = lmoc.compile_text(text).simulate(stop=0.2, rtol=1e-9, points=21)
    x, _ = solution(rate, [0.5, 0.4], 0.2)
    turn = 3 * 0.2
    assert r.energy.balance < 1e-6 and not r.events
    assert r["q.x"][-1] == pytest.approx(x * cos(turn) - sin(turn)) and r["q.y"][-1] == pytest.approx(
        x * sin(turn) + cos(turn)
    )


def test_a_disk_leaves_another_one():
    first, far = 0.1, 1.2
    r = run(
        f"Ground g; DiskContact k(r1 = 1, r2 = 0.2);"
        f"Body d(m = 2, J = 0.04, {fixed(x=far * sin(first), y=far * cos(first))}, {REST});",
        "connect(g.frame, k.a); connect(d.frame, k.b);",
        stop=2,
    )
    off = next(e.time for e in r.events if e.kind == "release")
    speed = np.sqrt(2 * G * far * (cos(first) - 2 / 3 * cos(first)))
    near = np.searchsorted(r.time, off)
    fall = r.time[near] - off
    angle = np.arccos(2 / 3 * cos(first))
    assert r["d.y"][near] == pytest.approx(far * cos(angle) - speed * sin(angle) * fall - G * fall**2 / 2, abs=1e-8)
    assert r["k.gap"].min() > -1e-12 and r["d.omega"][-1] == 0


def test_a_disk_rolls_in_a_ring():
    far, first = 0.8, 0.5
    r = run(
        f"Ground g; DiskContact k(r1 = 0.2, r2 = 1, inside = true, mu = 2);"
        f"Body d(m = 2, J = 0.04, {fixed(x=far * sin(first), y=-far * cos(first))}, {REST});",
        "connect(g.frame, k.b); connect(d.frame, k.a);",
        stop=3,
    )
    angle, rate = solution(lambda t, z: [z[1], -G * sin(z[0]) / (1.5 * far)], [first, 0], 3)
    assert np.arctan2(r["d.x"], -r["d.y"])[-1] == pytest.approx(angle, abs=1e-8)
    assert r["d.omega"][-1] == pytest.approx(-rate * far / 0.2, abs=1e-6)


def test_two_disks_share_momentum_and_rub():
    """An oblique impact: the normal impulse of restitution 0.5, and mu times it across."""
    r = run(
        f"DiskContact k(r1 = 0.3, r2 = 0.2, e = 0.5, mu = 0.1);"
        f"Body a(m = 2, J = 0.09, {fixed(x=0, y=0)}, {REST});"
        f"Body b(m = 1, J = 0.02, {fixed(x=1, y=0, theta=0, vx=-2, vy=0, omega=30)});",
        "connect(a.frame, k.a); connect(b.frame, k.b);",
    )
    normal = 1.5 * 2 / (1 / 2 + 1)
    across = 0.1 * normal  # the rim of b runs towards -y: friction pushes b along +y
    assert r.events[0].time == pytest.approx(0.25)
    fall = -G * r.time[-1]
    assert [r["a.vx"][-1], r["b.vx"][-1]] == pytest.approx([-normal / 2, -2 + normal])
    assert [r["a.vy"][-1] - fall, r["b.vy"][-1] - fall] == pytest.approx([-across / 2, across])
    assert [r["a.omega"][-1], r["b.omega"][-1]] == pytest.approx([-across * 0.3 / 0.09, 30 - across * 0.2 / 0.02])


# ------------------------------------------------------------------------------------------ tracks

X = np.linspace(0, 6, 13)
WAVES = rows(X, cos(X) + 0.1 * X)


def test_a_particle_on_a_track():
    way = np.concatenate([[0], np.cumsum(np.hypot(np.diff(X), np.diff(cos(X) + 0.1 * X)))])
    x, y = (CubicSpline(way, v, bc_type="natural") for v in (X, cos(X) + 0.1 * X))

    def rate(t, z):
        length = np.hypot(x(z[0], 1), y(z[0], 1))
        return [z[1] / length, -G * y(z[0], 1) / length]

    r = run(f"Track k(points = {WAVES}, {fixed(s=0, v=2)}); PointMass m(m = 3);", "connect(k.point, m.point);", stop=3)
    s, v = solution(rate, [0, 2], 3)
    assert [r["k.s"][-1], r["k.v"][-1], r["m.y"][-1]] == pytest.approx([s, v, float(y(s))], abs=1e-6)
    length = np.hypot(x(s, 1), y(s, 1))
    bent = (x(s, 1) * y(s, 2) - y(s, 1) * x(s, 2)) / length**3
    assert r["k.fn"][-1] == pytest.approx(3 * (bent * v**2 + G * x(s, 1) / length), rel=1e-6)


def circle(radius: float, first: float, last: float, n: int) -> str:
    """Points of a circle about the origin, by their angles from the lowest point, counter-clockwise."""
    angle = np.linspace(first, last, n)
    return rows(radius * sin(angle), -radius * cos(angle))


def test_through_a_loop():
    loop = circle(2, 0, 2 * pi, 25)
    r = run(
        f"Track k(points = {loop}, closed = true, {fixed(s=0, v=10.5)}); PointMass m(m = 3);",
        "connect(k.point, m.point);",
        stop=2,
    )
    assert r["k.s"][-1] > 4 * pi  # more than once around
    assert r["k.v"] ** 2 / 2 + G * r["m.y"] == pytest.approx(np.full(201, 10.5**2 / 2 - 2 * G), abs=1e-4)
    assert r["k.fn"] == pytest.approx(
        3 * (r["k.v"] ** 2 - G * r["m.y"]) / 2, abs=1.5
    )  # a spline bends by 1 % more or less


def test_a_particle_leaves_a_hill_where_textbooks_say():
    hill = circle(2, pi + 0.8, pi - 1.2, 21)
    r = run(
        f"Track k(points = {hill}, leaves = true, {fixed(s=1.65, v=0.3, gap=0)}); PointMass m(m = 3);",
        "connect(k.point, m.point);",
        stop=1.5,
    )
    off = next(e.time for e in r.events if e.kind == "release")
    begin = r["m.y"][0] / 2
    near = np.searchsorted(r.time, off)
    assert r["m.y"][near] / 2 == pytest.approx((2 * begin + 0.3**2 / G / 2) / 3, abs=0.02)
    fall = r.time[-1] - r.time[near]
    assert r["m.y"][-1] == pytest.approx(r["m.y"][near] + r["m.vy"][near] * fall - G * fall**2 / 2, abs=1e-6)


def test_friction_stops_a_particle_on_a_straight_track():
    s, c = float(sin(SLOPE)), float(cos(SLOPE))
    r = run(
        f"Track k(points = {rows([0, 3 * c, 5 * c], [0, 3 * s, 5 * s])}, leaves = true, mu = 0.6,"
        f"{fixed(s=0, v=4, gap=0)});"
        "PointMass m(m = 3);",
        "connect(k.point, m.point);",
    )
    a = G * (s + 0.6 * c)
    assert r.events[0].kind == "stick" and r.events[0].time == pytest.approx(4 / a)
    assert r["k.s"][-1] == pytest.approx(16 / 2 / a) and r["k.ft"][-1] == pytest.approx(3 * G * s)


def test_a_disk_rolls_in_a_bowl_or_slides():
    bowl = circle(2, -1.5, 1.5, 31)
    parts = f"Body d(m = 2, J = 0.04, {fixed(theta=0)}); DiskTrack k(points = {bowl}, r = 0.2, {fixed(s=5, v=0)}"
    r = run(parts + ");", "connect(k.disk, d.frame);", stop=2)
    assert "der(k.s)" in r.states and elsewhere(r, r) == {}  # a derivative is no variable, and a state of a page
    begin = np.arctan2(r["d.x"][0], -r["d.y"][0])
    angle, _ = solution(lambda t, z: [z[1], -G * sin(z[0]) / (1.5 * 1.8)], [begin, 0], 2)
    assert np.arctan2(r["d.x"], -r["d.y"])[-1] == pytest.approx(angle, abs=1e-4)
    assert r["d.theta"][-1] == pytest.approx((begin - angle) * 1.8 / 0.2, abs=1e-3)
    slid = run(
        f"Body d(m = 2, J = 0.04, {fixed(theta=0, omega=0)}); DiskTrack k(points = {bowl}, r = 0.2, leaves = true,"
        f"mu = 0.15, {fixed(s=5, v=0, gap=0)});",
        "connect(k.disk, d.frame);",
        stop=0.4,
    )

    def rate(t, z):
        normal = 1.8 * z[1] ** 2 + G * cos(z[0])
        return [z[1], (-G * sin(z[0]) + 0.15 * normal) / 1.8, 0.15 * normal * 2 * 0.2 / 0.04]

    angle, _, turn = solution(rate, [begin, 0, 0], 0.4)
    assert np.arctan2(slid["d.x"], -slid["d.y"])[-1] == pytest.approx(angle, abs=1e-4)
    assert slid["d.omega"][-1] == pytest.approx(turn, rel=2e-3)
