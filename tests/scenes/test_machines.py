"""Parts of machines against closed forms and balances by hand."""

import numpy as np
import pytest
from numpy import cos, exp, pi, sqrt
from scipy.integrate import solve_ivp

import lmoc


def run(parts: str, equations: str = "", stop: float = 1.0, **options) -> lmoc.Run:
    text = f"model Scene\n{parts}\nequation\n{equations}\nend Scene;"
    found = lmoc.compile_text(text).simulate(stop=stop, rtol=1e-9, points=201, **options)
    if np.isfinite(found.energy.balance):
        assert found.energy.balance < 1e-6
    return found


REST = "theta(start = 0, fixed = true), omega(start = 0, fixed = true)"
STILL = "q(start = 0, fixed = true), v(start = 0, fixed = true)"


@pytest.mark.parametrize(("crossed", "sense"), [("false", 1), ("true", -1)])
def test_a_rigid_belt(crossed, sense):
    r = run(
        f"Torque drive(tau = 3); Inertia a(J = 0.5, {REST}); Belt belt(r1 = 0.1, r2 = 0.25, crossed = {crossed});"
        "Inertia b(J = 2);",
        "connect(drive.shaft, a.shaft); connect(a.shaft, belt.a); connect(belt.b, b.shaft);",
    )
    ratio = sense * 0.1 / 0.25
    alpha = 3 / (0.5 + 2 * ratio**2)
    assert r["a.theta"] == pytest.approx(alpha * r.time**2 / 2, abs=1e-9)
    assert r["b.theta"] == pytest.approx(ratio * r["a.theta"], abs=1e-9)
    assert r["belt.f"] == pytest.approx(np.full(201, (3 - 0.5 * alpha) / 0.1))


def test_an_elastic_belt_swings_with_both_inertias():
    r = run(
        "Inertia a(J = 0.5, theta(start = 0.1, fixed = true), omega(start = 0, fixed = true));"
        f"Belt belt(r1 = 0.1, r2 = 0.25, elastic = true, k = 4e3); Inertia b(J = 2, {REST});",
        "connect(a.shaft, belt.a); connect(belt.b, b.shaft);",
        stop=3,
    )
    w = sqrt(4e3 * (0.1**2 / 0.5 + 0.25**2 / 2))
    assert r["belt.f"] == pytest.approx(4e3 * 0.1 * 0.1 * cos(w * r.time), abs=1e-5)


def test_a_belt_slips_until_both_pulleys_have_one_speed():
    r = run(
        "Inertia a(J = 0.5, theta(start = 0, fixed = true), omega(start = 20, fixed = true));"
        f"Belt belt(r1 = 0.1, r2 = 0.2, slips = true, F = 15); Inertia b(J = 1, {REST});",
        "connect(a.shaft, belt.a); connect(belt.b, b.shaft);",
        stop=3,
    )
    until = 0.1 * 20 / (15 * (0.1**2 / 0.5 + 0.2**2 / 1))
    assert [e.kind for e in r.events] == ["stick"] and r.events[0].time == pytest.approx(until, rel=1e-8)
    assert r["a.omega"][-1] == pytest.approx(20 - 15 * 0.1 / 0.5 * until)
    assert 0.1 * r["a.omega"][-1] == pytest.approx(0.2 * r["b.omega"][-1])


def test_a_chain_with_slack_runs_free_first():
    r = run(
        f"Torque drive(tau = 2); Inertia a(J = 0.5, {REST});"
        "Chain chain(z1 = 20, z2 = 40, pitch = 0.0127, slack = 0.01);"
        f"Inertia b(J = 2, {REST});",
        "connect(drive.shaft, a.shaft); connect(a.shaft, chain.a); connect(chain.b, b.shaft);",
    )
    r1 = 20 * 0.0127 / (2 * pi)
    first = sqrt(2 * (0.005 / r1) / (2 / 0.5))
    assert r.events[0].kind == "taut" and r.events[0].time == pytest.approx(first, rel=1e-8)
    both = 0.5 + 2 / 4
    assert r["a.omega"][-1] == pytest.approx(4 * first * 0.5 / both + 2 / both * (1 - first))
    assert r["b.omega"][-1] == pytest.approx(r["a.omega"][-1] / 2)


def test_a_rack():
    r = run(
        f"Torque drive(tau = 3); Inertia a(J = 0.5, {REST}); Rack rack(r = 0.2); Mass m(m = 10);",
        "connect(drive.shaft, a.shaft); connect(a.shaft, rack.shaft); connect(rack.flange, m.flange);",
    )
    assert r["m.v"][-1] == pytest.approx(0.2 * 3 / (0.5 + 10 * 0.04))


def test_a_wheel_rolls():
    r = run(
        f"Torque drive(tau = 60); Inertia w(J = 2, {REST}); Wheel wheel(r = 0.3); Mass car(m = 100);",
        "connect(drive.shaft, w.shaft); connect(w.shaft, wheel.shaft); connect(wheel.flange, car.flange);",
    )
    assert r["car.v"][-1] == pytest.approx(0.3 * 60 / (2 + 100 * 0.09))
    assert r["wheel.f"] == pytest.approx(np.full(201, 100 * 0.3 * 60 / (2 + 9)))


def test_a_wheel_spins_and_then_grips():
    r = run(
        f'input Real M(unit = "N.m") = if time < 1 then 500 else 0; Torque drive(tau = M); Inertia w(J = 2, {REST});'
        f"Wheel wheel(r = 0.3, slips = true, mu = 0.5, load = 1000); Mass car(m = 100, {STILL});",
        "connect(drive.shaft, w.shaft); connect(w.shaft, wheel.shaft); connect(wheel.flange, car.flange);",
        stop=4,
    )
    grip = next(e for e in r.events if e.kind == "stick")
    a, alpha, back = 500 / 100, (500 - 150) / 2, 150 / 2
    # rim and road: 0.3*(alpha*1 - back*t) = a*(1 + t)
    t = (0.3 * alpha - a) / (0.3 * back + a)
    assert grip.time == pytest.approx(1 + t, rel=1e-7)
    assert r["car.v"][-1] == pytest.approx(a * (1 + t), rel=1e-7)


def test_a_screw_with_and_without_friction():
    free = run(
        f"Torque drive(tau = 1); Inertia s(J = 1e-3, {REST}); Screw screw(lead = 0.01); Mass m(m = 50);",
        "connect(drive.shaft, s.shaft); connect(s.shaft, screw.shaft); connect(screw.flange, m.flange);",
    )
    h = 0.01 / (2 * pi)
    assert free["s.omega"][-1] == pytest.approx(1 / (1e-3 + 50 * h**2))
    held = run(
        f"Force weight(f = -2000); Inertia s(J = 1e-3, {REST});"
        "Screw screw(lead = 0.01, tau = 3, tauStick = 4); Mass m(m = 50);",
        "connect(weight.flange, m.flange); connect(s.shaft, screw.shaft); connect(screw.flange, m.flange);",
    )
    assert held["s.theta"][-1] == 0.0 and held["screw.drag"][-1] == pytest.approx(-2000 * h)


def test_a_differential_shares_the_torque():
    r = run(
        f"Torque drive(tau = 12); Differential d(N = 3); Inertia l(J = 1, {REST}); Inertia r(J = 2, {REST});",
        "connect(drive.shaft, d.drive); connect(d.left, l.shaft); connect(d.right, r.shaft);",
    )
    assert r["l.omega"][-1] == pytest.approx(18.0) and r["r.omega"][-1] == pytest.approx(9.0)


PROFILE = "{" + ", ".join(f"{{{a:.12g}, {0.01 * (1 - cos(a)):.12g}}}" for a in np.linspace(0, 2 * pi, 25)) + "}"


def test_a_follower_that_is_pressed_on_follows_the_profile_for_ever():
    r = run(
        f"RotationSpeed drive(omega = 10); CamProfile cam(profile = {PROFILE}); Fixed top(q0 = 0.1); Spring s(k = 500);"
        "Mass m(m = 2, q(start = 0), v(start = 0));",
        "connect(drive.shaft, cam.shaft); connect(cam.flange, m.flange);"
        "connect(m.flange, s.a); connect(s.b, top.flange);",
        stop=1.5,
        parameters={"s.k": 500.0, "s.d0": 0.2},
    )
    assert not [e for e in r.events if e.kind in ("release", "impact")]
    assert r["m.q"] == pytest.approx(0.01 * (1 - cos(10 * r.time)), abs=2e-6)
    assert r["m.a"] == pytest.approx(cos(10 * r.time), abs=0.01)
    force = 2 * cos(10 * r.time) + 500 * (0.2 - 0.1 + r["m.q"])
    assert r["cam.f"] == pytest.approx(force, abs=0.02)


def test_a_follower_lifts_off_where_the_cam_falls_away():
    parts = (
        f"RotationSpeed drive(omega = 50); CamProfile cam(profile = {PROFILE});"
        "Mass m(m = 1, g = -9.81, q(start = 0), v(start = 0));"
    )
    r = run(parts, "connect(drive.shaft, cam.shaft); connect(cam.flange, m.flange);", stop=0.1)
    off = next(e for e in r.events if e.kind == "release")
    # it falls away faster than the weight where 0.01*50^2*cos = -9.81
    assert off.time == pytest.approx(np.arccos(-9.81 / 25) / 50, rel=0.05)
    assert r["cam.gap"].min() > -1e-9 and r["cam.gap"].max() > 1e-3


def test_a_force_over_the_position():
    r = run(
        "TableForce spring(table = {{-1, 50}, {0, 0}, {1, -50}});"
        "Mass m(m = 2, q(start = 0.5, fixed = true), v(start = 0, fixed = true));",
        "connect(spring.flange, m.flange);",
    )
    assert r["m.q"] == pytest.approx(0.5 * cos(5 * r.time), abs=1e-7)


def test_given_velocities():
    r = run(
        'input Real v(unit = "m/s") = 0.3*sin(2*time); Speed hand(v = v, q0 = 1); Spring s(k = 50); '
        "Mass m(m = 2, q(start = 1, fixed = true), v(start = 0, fixed = true));",
        "connect(hand.flange, s.a); connect(s.b, m.flange);",
    )
    u = 0.15 * (1 - cos(2 * r.time))
    assert r["hand.q"] == pytest.approx(1 + u, abs=1e-9)
    # 2 x'' + 50 x = 50 u
    x = 0.15 - 0.15 * 25 / 21 * cos(2 * r.time) + 0.15 * 4 / 21 * cos(5 * r.time)
    assert r["m.q"] == pytest.approx(1 + x, abs=1e-7)


@pytest.mark.parametrize(("v0", "c"), [(1.0, 4.0), (-1.0, 10.0)])
def test_a_damper_of_one_way(v0, c):
    r = run(
        "Fixed wall; OneWayDamper d(c = 4, cIn = 10);"
        f"Mass m(m = 2, q(start = 0, fixed = true), v(start = {v0}, fixed = true));",
        "connect(wall.flange, d.a); connect(d.b, m.flange);",
    )
    assert r["m.v"] == pytest.approx(v0 * exp(-c / 2 * r.time), rel=1e-7)


def test_an_unbalance_shakes_its_housing():
    r = run(
        f"RotationSpeed motor(omega = 30); Unbalance u(m = 0.2, r = 0.05); Mass housing(m = 10, {STILL}); ",
        "connect(motor.shaft, u.shaft); connect(u.flange, housing.flange);",
    )
    # momentum: 10.2 v + 0.2*0.05*30*cos(30 t) stays
    assert r["housing.v"] == pytest.approx(0.3 / 10.2 * (1 - cos(30 * r.time)), abs=1e-9)


def test_a_lever_with_weight_swings_like_a_pendulum():
    r = run("GravityLever p(m = 2, l = 0.5, J = 0.1, omega(start = 0, fixed = true)); "
            "initial equation p.shaft.theta = 0.01;", "", stop=5)  # fmt: skip
    w = sqrt(2 * 9.81 * 0.5 / (0.1 + 2 * 0.25))
    assert r["p.shaft.theta"] == pytest.approx(0.01 * cos(w * r.time), abs=2e-5)


def test_a_ball_on_a_hertz_contact_comes_back_at_its_speed():
    r = run(
        "Fixed wall; HertzContact contact(k = 1e6);"
        "Mass ball(m = 0.5, q(start = 0.1, fixed = true), v(start = -2, fixed = true));",
        "connect(wall.flange, contact.a); connect(contact.b, ball.flange);",
        stop=0.2,
    )
    assert r["ball.v"][-1] == pytest.approx(2, rel=1e-6)
    deepest = (0.5 * 0.5 * 2**2 * 2.5 / 1e6) ** 0.4  # k*d^(5/2)*2/5 = m*v^2/2
    assert -r["ball.q"].min() <= deepest * (1 + 1e-6)


def test_a_preload_shifts_the_rest():
    (rest,) = lmoc.compile_text(
        "model S Fixed wall; Spring s(k = 100); Preload p(F = 20); Mass m(m = 1); equation connect(wall.flange, s.a);"
        "connect(s.b, m.flange); connect(wall.flange, p.a); connect(p.b, m.flange); end S;"
    ).equilibria()
    assert str(rest["m.q"]) == "-p.F/s.k"


def test_the_drag_of_air_brakes_a_fall():
    r = run(f"AirDrag air(c = 0.5); Mass m(m = 2, g = 9.81, {STILL});", "connect(air.flange, m.flange);", stop=3)
    v = sqrt(2 * 9.81 / 0.5)
    assert r["m.v"] == pytest.approx(v * np.tanh(9.81 / v * r.time), rel=1e-7)


@pytest.mark.parametrize("L", [0.0, 0.02])
def test_a_motor_reaches_the_speed_of_its_voltage(L):
    r = run(
        f"DCMotor motor(R = 2, L = {L}, k = 0.1, J = 1e-3, u = 12, omega(start = 0, fixed = true));"
        "TorsionDamper d(c = 0.01); FixedShaft wall;" + (" initial equation motor.i = 0;" if L else ""),
        "connect(motor.shaft, d.a); connect(d.b, wall.shaft);",
        stop=10,
    )
    assert r["motor.omega"][-1] == pytest.approx(12 * 0.1 / (0.1**2 + 2 * 0.01), rel=1e-6)


@pytest.mark.parametrize("sampled", [0.0, 0.01])
def test_a_controller_holds_a_mass_at_its_reference_and_does_not_wind_up(sampled):
    r = run(
        f"Controller pid(kp = 40, ki = 20, kd = 12, lower = -5, upper = 5, Ts = {sampled}, reference = 1,"
        "measured = m.q);"
        f"Force push(f = pid.u); Force load(f = -2); Mass m(m = 1, {STILL});",
        "connect(push.flange, m.flange); connect(load.flange, m.flange);",
        stop=20,
    )
    assert np.abs(r["pid.u"]).max() <= 5 + 1e-9
    assert r["m.q"][-1] == pytest.approx(1, abs=2e-3) and r["pid.u"][-1] == pytest.approx(2, abs=2e-2)
    assert r["m.q"].max() < 1.6  # the integral has not grown while the output was limited


def test_a_controller_without_an_integral_or_without_a_differential_part():
    def closed(gains: str) -> lmoc.Run:
        return run(
            f"Controller c({gains}, reference = 1, measured = m.q); Force push(f = c.u); Mass m(m = 2, {STILL});"
            "Damper d(c = 4); Fixed wall;",
            "connect(push.flange, m.flange); connect(wall.flange, d.a); connect(d.b, m.flange);",
            stop=3,
        )

    p, pd = closed("kp = 10"), closed("kp = 10, kd = 2, Tf = 0.1")
    # 2*q'' + 4*q' + 10*q = 10
    assert p["m.q"] == pytest.approx(1 - exp(-p.time) * (cos(2 * p.time) + np.sin(2 * p.time) / 2), abs=1e-7)

    def rate(t, z):
        q, v, e = z
        u = 10 * (1 - q) + 2 * (1 - q - e) / 0.1
        return [v, (u - 4 * v) / 2, (1 - q - e) / 0.1]

    exact = solve_ivp(rate, (0, 3), [0, 0, 0], "DOP853", pd.time, rtol=1e-11, atol=1e-12).y[0]
    assert pd["m.q"] == pytest.approx(exact, abs=1e-7)
