"""Every planar part in a small scene, against the equation of motion written by hand."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lmoc

G = 9.81


def run(text: str, stop: float = 2.0, **options):
    """The run of a scene; its ledger must close."""
    scene = f"model Scene\n  import Planar.*;\n  inner World world(g = {G});\n{text}\nend Scene;"
    result = lmoc.compile_text(scene).simulate(stop=stop, rtol=1e-9, points=21, **options)
    assert result.energy.balance < 1e-6
    return result


def motion(rate, start, stop: float = 2.0) -> np.ndarray:
    """(variables, 21) the solution of an equation of motion."""
    times = np.linspace(0, stop, 21)
    return solve_ivp(rate, (0, stop), start, "DOP853", times, rtol=1e-11, atol=1e-12).y


def close(found, expected) -> bool:
    return np.allclose(found, expected, rtol=0, atol=1e-7)


def test_body_on_a_pin_whose_shaft_carries_a_spring_and_a_damper():
    """Link, ground and pin put the body at 0.3 + phi; its centre of mass lies off the frame."""
    found = run("""
      Ground ground(x = 1, y = 2, theta = 0.1);
      Link link(rx = 0.3, ry = -0.2);
      Weld weld;
      Revolute pin(useShaft = true, phi(start = 0.5, fixed = true));
      Body body(m = 2, J = 0.1, cx = 0.4, cy = 0.2);
      .TorsionSpring spring(k = 3);
      .TorsionDamper damper(c = 0.1);
      FixedShaft shaft;
    equation
      connect(ground.frame, link.a);
      connect(link.b, weld.a);
      connect(weld.b, pin.a);
      connect(pin.b, body.frame);
      connect(shaft.shaft, spring.a);
      connect(spring.b, pin.shaft);
      connect(shaft.shaft, damper.a);
      connect(damper.b, pin.shaft);""")

    def rate(t, z):
        phi, omega = z
        weight = 2 * G * (0.4 * np.cos(phi + 0.1) - 0.2 * np.sin(phi + 0.1))
        return [omega, (-3 * phi - 0.1 * omega - weight) / (0.1 + 2 * 0.2)]

    phi, _ = motion(rate, [0.5, 0.0])
    assert found.states == ["pin.phi", "pin.omega"]
    assert close(found["pin.phi"], phi) and close(found["body.theta"], phi + 0.1)
    assert close(found["body.x"], 1 + 0.3 * np.cos(0.1) + 0.2 * np.sin(0.1))
    assert close(found["body.y"], 2 + 0.3 * np.sin(0.1) - 0.2 * np.cos(0.1))


def test_torsion_spring_and_damper_between_bodies():
    found = run("""
      Ground ground;
      Revolute pin(phi(start = 1, fixed = true));
      Body body(m = 2, J = 0.3, cx = 0.5);
      TorsionSpring spring(k = 4, phi0 = 0.2);
      TorsionDamper damper(c = 0.3);
    equation
      connect(ground.frame, pin.a);
      connect(pin.b, body.frame);
      connect(ground.frame, spring.a);
      connect(body.frame, spring.b);
      connect(ground.frame, damper.a);
      connect(body.frame, damper.b);""")

    def rate(t, z):
        return [z[1], (-4 * (z[0] - 0.2) - 0.3 * z[1] - G * np.cos(z[0])) / (0.3 + 0.5)]

    phi, omega = motion(rate, [1.0, 0.0])
    assert close(found["pin.phi"], phi)
    assert close(found["spring.tau"], 4 * (phi - 0.2)) and close(found["damper.loss"], 0.3 * omega**2)


@pytest.mark.parametrize("direction", ["nx = 1", "nx = 2", "nx = 0, ny = -1"])
def test_slider_on_an_incline_with_a_spring_at_its_flange(direction):
    """The line is inclined by 0.5 against the horizontal; its direction is normalized."""
    angle = {"nx = 0, ny = -1": 0.5 - np.pi / 2}.get(direction, 0.5)
    found = run(f"""
      Ground ground(theta = 0.5);
      Prismatic slider(useFlange = true, {direction}, s(start = 0.1, fixed = true));
      Body body(m = 2, J = 0.1, cx = 0.1);
      .Spring spring(k = 30);
      Fixed wall;
    equation
      connect(ground.frame, slider.a);
      connect(slider.b, body.frame);
      connect(wall.flange, spring.a);
      connect(spring.b, slider.flange);""")
    rest = -2 * G * np.sin(angle) / 30
    s = rest + (0.1 - rest) * np.cos(np.sqrt(15) * found.time)
    assert close(found["slider.s"], s)
    assert close(found["body.x"], s * np.cos(angle)) and close(found["body.y"], s * np.sin(angle))
    # the line's force stands across it, the flange's along it
    fx, fy = found["slider.a.fx"], found["slider.a.fy"]
    assert np.allclose(fx * np.cos(angle) + fy * np.sin(angle), -30 * s, atol=1e-6)
    assert np.allclose(fy * np.cos(angle) - fx * np.sin(angle), 2 * G * np.cos(angle), atol=1e-6)


def test_guided_point_mass_on_a_spring():
    """The line rises by 4 in 5; its force stands to the left of its direction."""
    found = run(
        """
      PointMass mass(m = 2);
      Guide guide(nx = 3, ny = 4, x0 = 1, y0 = -1, flange(q(start = 0.0, fixed = true)));
      .Spring spring(k = 30);
      Fixed wall;
    equation
      connect(mass.point, guide.point);
      connect(wall.flange, spring.a);
      connect(spring.b, guide.flange);""",
    )
    rest = -2 * G * 0.8 / 30
    q = rest * (1 - np.cos(np.sqrt(15) * found.time))
    assert close(found["mass.x"], 1 + 0.6 * q) and close(found["mass.y"], -1 + 0.8 * q)
    assert close(found["guide.fn"], 2 * G * 0.6)


def test_wheel_rolls_under_a_torque():
    found = run("""
      Body body(m = 2, J = 0.3, theta(start = 0, fixed = true));
      RollingWheel wheel(r = 0.5);
      Torque motor(tau = -1.5);
    equation
      connect(body.frame, wheel.frame);
      connect(body.frame, motor.frame);""")
    acceleration = 1.5 / 0.5 / (2 + 0.3 / 0.25)
    assert close(found["body.x"], acceleration * found.time**2 / 2) and close(found["body.y"], 0.5)
    assert close(found["body.theta"], -found["body.x"] / 0.5)
    assert close(found["wheel.ft"], 2 * acceleration) and close(found["wheel.fn"], 2 * G)


def test_force_on_a_point_of_a_free_body():
    found = run(f"""
      Body body(m = 2, J = 0.3);
      PointOf corner(rx = 0.2, ry = 0.1);
      Force push(fx = 1, fy = {2 * G} + 0.5);
    equation
      connect(body.frame, corner.frame);
      connect(corner.point, push.point);""")
    fx, fy = 1.0, 2 * G + 0.5

    def rate(t, z):
        c, s = np.cos(z[0]), np.sin(z[0])
        return [z[1], ((0.2 * c - 0.1 * s) * fy - (0.2 * s + 0.1 * c) * fx) / 0.3]

    theta, _ = motion(rate, [0.0, 0.0])
    assert close(found["body.theta"], theta)
    assert close(found["body.x"], 0.25 * found.time**2) and close(found["body.y"], 0.125 * found.time**2)


def test_springs_and_dampers_between_points():
    found = run("""
      PointMass mass(m = 2, x(start = 1), y(start = -1));
      Anchor anchor;
      Spring spring(k = 50, d0 = 1), centre(k = 3);
      Damper damper(c = 0.4);
      SpringDamper both(k = 20, c = 0.2, d0 = 0.5);
      Motion shaker(x = sin(time), y = 0.1*time);
    equation
      connect(anchor.point, spring.a);
      connect(anchor.point, centre.a);
      connect(anchor.point, damper.a);
      connect(shaker.point, both.a);
      connect(spring.b, mass.point);
      connect(centre.b, mass.point);
      connect(damper.b, mass.point);
      connect(both.b, mass.point);""")

    def pull(place, speed, k, c, d0):
        length = np.hypot(*place)
        unit = place / length
        return -(k * (length - d0) + c * (unit @ speed)) * unit

    def rate(t, z):
        place, speed = z[:2], z[2:]
        shaker, its_speed = np.array([np.sin(t), 0.1 * t]), np.array([np.cos(t), 0.1])
        force = pull(place, speed, 50, 0.4, 1) - 3 * place + pull(place - shaker, speed - its_speed, 20, 0.2, 0.5)
        return [*speed, *(force / 2 - [0, G])]

    x, y, *_ = motion(rate, [1.0, -1.0, 0.0, 0.0])
    assert close(found["mass.x"], x) and close(found["mass.y"], y)
    assert close(found["spring.f"], 50 * (np.hypot(x, y) - 1))


def test_elastic_string_is_slack_and_taut_again():
    """Dropped half a metre above the length of the string; it stretches until the height is spent, and throws back."""
    found = run("""
      PointMass mass(m = 1, x(start = 0, fixed = true), y(start = -0.5, fixed = true));
      Anchor anchor;
      ElasticCable string(k = 1000, d0 = 1);
    equation
      connect(anchor.point, string.a);
      connect(string.b, mass.point);""")
    taut = np.sqrt(2 * 0.5 / G)
    speed, omega, rest = G * taut, np.sqrt(1000.0), G / 1000
    duration = 2 * (np.pi - np.arctan2(speed / omega, rest)) / omega
    times = np.array([event.time for event in found.events])
    assert all(np.abs(times - expected).min() < 1e-8 for expected in (taut, taut + duration))
    assert np.all(found["string.f"] >= 0) and np.allclose(found["mass.x"], 0)
    t = taut + duration + 0.3
    last = run("""
      PointMass mass(m = 1, x(start = 0, fixed = true), y(start = -0.5, fixed = true));
      Anchor anchor;
      ElasticCable string(k = 1000, d0 = 1);
    equation
      connect(anchor.point, string.a);
      connect(string.b, mass.point);""", stop=t)
    assert abs(last["mass.y"][-1] - (-1 + speed * 0.3 - G * 0.3**2 / 2)) < 1e-6


@pytest.mark.parametrize("angle", [-1.5, 0.0, 0.4, 1.5707963267948966, 3.0, -2.5])
def test_point_mass_on_a_rod_turns_through_all_positions(angle):
    """It starts with a push that carries it around again and again; the rod's tension holds it."""
    x, y = float(np.cos(angle)), float(np.sin(angle))
    found = run(f"""
      PointMass mass(m = 2, x(start = {x}, fixed = true), y(start = {y}));
      Anchor anchor(x = 0, y = 0);
      Rod rod(L = 1, omega(start = 8, fixed = true));
    equation
      connect(anchor.point, rod.a);
      connect(rod.b, mass.point);""")
    phi, omega = motion(lambda t, z: [z[1], -G * np.cos(z[0])], [angle, 8.0])
    assert len(found.states) == 2
    assert close(found["mass.x"], np.cos(phi)) and close(found["mass.y"], np.sin(phi))
    assert np.allclose(found["rod.f"], 2 * (omega**2 - G * np.sin(phi)), rtol=1e-6)


def test_bar_is_a_pendulum_whose_pin_carries_its_weight():
    found = run("""
      Ground ground;
      Revolute pin(phi(start = -1, fixed = true));
      Bar bar(l = 1.5, m = 2);
    equation
      connect(ground.frame, pin.a);
      connect(pin.b, bar.a);""")
    phi, omega = motion(lambda t, z: [z[1], -1.5 * G / 1.5 * np.cos(z[0])], [-1.0, 0.0])
    alpha = -G * np.cos(phi)
    assert close(found["pin.phi"], phi)
    assert close(found["bar.b.x"], 1.5 * np.cos(phi)) and close(found["bar.b.y"], 1.5 * np.sin(phi))
    ax = -0.75 * (np.sin(phi) * alpha + np.cos(phi) * omega**2)
    ay = 0.75 * (np.cos(phi) * alpha - np.sin(phi) * omega**2)
    assert np.allclose(found["bar.a.fx"], 2 * ax, atol=1e-6) and np.allclose(found["bar.a.fy"], 2 * (ay + G), atol=1e-6)


def test_without_a_world_gravity_is_that_of_the_earth():
    dae = lmoc.compile_text("model Falling import Planar.*; PointMass mass(m = 1); end Falling;")
    assert [d.code for d in dae.notes if d.code == "N0241"] == ["N0241"]
    assert np.allclose(dae.simulate(stop=1, points=2)["mass.y"], [0, -G / 2])


def test_global_parts_stay_reachable_beside_the_planar_ones():
    text = """model Both
      import Planar.*;
      inner World world(g = 0);
      .Spring line(k = 1);
      Spring plane(k = 1);
      Mass mass(m = 1);
      Fixed wall;
      PointMass point(m = 1, x(start = 1));
      Anchor anchor;
    equation
      connect(wall.flange, line.a);
      connect(line.b, mass.flange);
      connect(anchor.point, plane.a);
      connect(plane.b, point.point);
    end Both;"""
    run = lmoc.compile_text(text).simulate(stop=1, points=2, rtol=1e-9, initial={"mass.q": 1.0})
    assert close(run["mass.q"], np.cos([0, 1])) and close(run["point.x"], np.cos([0, 1]))


CROSSING = """
model Crossing
  import Planar.*;
  inner World world(g = 9.81);
  PointMass p(m = 2);
  Guide g1(nx = 2, ny = 1), g2(nx = 1, ny = -3, x0 = 2);
  .Mass m(m = 3, g = 5);
equation
  connect(g1.point, p.point);
  connect(g2.point, p.point);
  connect(g1.flange, m.flange);
end Crossing;
"""


def test_a_point_on_two_guides_that_cross_stands_still():
    """y = x/2 and y = -3 (x - 2) have one point in common. A guide takes what is normal to it, its flange the rest."""
    run = lmoc.compile_text(CROSSING).simulate(stop=1, points=3)
    assert any(n.code == "W0417" and "g2 and g1" in n.message for n in run.notes)
    assert run["p.x"] == pytest.approx(12 / 7, abs=1e-12) and run["p.y"] == pytest.approx(6 / 7, abs=1e-12)
    assert run["p.vx"] == pytest.approx(0.0, abs=1e-15) and run["p.vy"] == pytest.approx(0.0, abs=1e-15)
    first, second = (np.array([run[f"{g}.point.fx"], run[f"{g}.point.fy"]]) for g in ("g1", "g2"))
    assert first + second == pytest.approx(np.array([[0.0] * 3, [-19.62] * 3]), abs=1e-9)  # what the guides take
    assert np.array([2, 1]) @ first / np.sqrt(5) == pytest.approx(-15.0, abs=1e-9)  # handed on to the mass
    assert np.array([1, -3]) @ second == pytest.approx(0.0, abs=1e-9)


def test_a_third_guide_past_the_crossing_is_an_error_with_the_distance():
    text = CROSSING.replace("g2(", "g3(nx = 1, ny = 0.3, y0 = 1), g2(").replace(
        "connect(g2.point", "connect(g3.point, p.point); connect(g2.point"
    )
    with pytest.raises(lmoc.ModelError, match="E0411.*no position satisfies all of them"):
        lmoc.compile_text(text).simulate()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("element", ["SpringDamper s(k = 1, c = 1, d0 = 1)", "Damper s(c = 1)"])
def test_a_particle_gives_its_names_to_the_states_whatever_is_declared_first(element, turned):
    parts = ["PointMass p(m = 1, x(start = 1));", f"{element};", "Anchor a(x = 0.3);"]
    text = " ".join(parts[::-1] if turned else parts)
    dae = lmoc.compile_text(
        f"model S import Planar.*; inner World world; {text} equation connect(s.a, p.point);"
        " connect(s.b, a.point); end S;"
    )
    assert sorted(dae.states) == ["p.vx", "p.vy", "p.x", "p.y"]
