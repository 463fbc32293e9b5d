"""The mechanisms of ``models/planar``: as many states as degrees of freedom ask for, closed forms, energy."""

import numpy as np
import pytest
from conftest import ROOT
from oracles import models
from scipy.integrate import solve_ivp

import lmoc

STATES = {
    "andrews": 2,
    "cart_pole": 4,
    "chain": 10,
    "crane": 4,
    "double_pendulum": 4,
    "four_bar": 2,
    "pendulum": 2,
    "pendulum_cartesian": 2,
    "pendulum_on_a_rod": 2,
    "scissor_lift": 2,
    "slider_crank": 2,
    "three_cranks": 2,
    "wheel_with_pendulum": 5,  # the wheel's angle is free beside its place
}


def compiled(name: str, **parameters) -> lmoc.DAE:
    return models.compiled(f"planar/{name}", **parameters)


def test_every_mechanism_is_looked_at():
    assert sorted(STATES) == sorted(path.stem for path in (ROOT / "models/planar").glob("*.lmo"))


@pytest.mark.parametrize("name", STATES)
def test_states_are_few_and_the_energy_is_balanced(name):
    dae = compiled(name)
    assert len(dae.states) == STATES[name]
    run = dae.simulate(rtol=1e-9)
    assert run.energy.balance < 1e-5


@pytest.mark.parametrize("n", [1, 2, 3, 17, 300])
def test_open_chain_ends_in_joint_coordinates(n):
    dae = compiled("chain", n=n)
    pins = [f"pin[{i}]" for i in range(1, n + 1)]
    assert sorted(dae.states) == sorted([f"{p}.phi" for p in pins] + [f"{p}.omega" for p in pins])


def test_pendulum_on_a_rod_is_the_pendulum_with_an_angle():
    run = compiled("pendulum_on_a_rod").simulate(rtol=1e-10, points=101)
    exact = solve_ivp(lambda t, z: [z[1], -9.81 * np.sin(z[0])], (0, 10), [0, 7.1], "DOP853", run.time, rtol=1e-12,
                      atol=1e-12).y  # fmt: skip
    assert np.allclose(run["x"], np.sin(exact[0]), rtol=0, atol=1e-7)
    assert np.allclose(run["T"], exact[1] ** 2 + 9.81 * np.cos(exact[0]), rtol=0, atol=1e-5)


def test_double_pendulum_of_bars_moves_as_lagrange_says():
    """Angles of both bars from the horizontal; Lagrange's equations of two uniform bars."""
    l1, m1, l2, m2, g = 1.0, 1.0, 0.7, 0.5, 9.81

    def rate(t, z):
        a, b, u, v = z
        c, s = np.cos(a - b), np.sin(a - b)
        mass = np.array([[(m1 / 3 + m2) * l1**2, m2 * l1 * l2 * c / 2], [m2 * l1 * l2 * c / 2, m2 * l2**2 / 3]])
        force = [
            -m2 * l1 * l2 * s * v**2 / 2 - (m1 / 2 + m2) * g * l1 * np.cos(a),
            m2 * l1 * l2 * s * u**2 / 2 - m2 * g * l2 * np.cos(b) / 2,
        ]
        return [u, v, *np.linalg.solve(mass, force)]

    run = compiled("double_pendulum").simulate(stop=3, rtol=1e-10, points=31)
    exact = solve_ivp(rate, (0, 3), [0, 1, 0, 0], "DOP853", run.time, rtol=1e-12, atol=1e-12).y
    assert np.allclose(run["phi1"], exact[0], rtol=0, atol=1e-6)
    assert np.allclose(run["lower.theta"], exact[1], rtol=0, atol=1e-6)


def test_cart_and_pole_keep_their_horizontal_momentum():
    run = compiled("cart_pole").simulate(rtol=1e-10)
    pole = run["rail.v"] - 0.5 * np.sin(run["pole.theta"]) * run["pole.omega"]
    assert np.abs(1.0 * run["rail.v"] + 0.1 * pole).max() < 1e-8


def test_crane_follows_the_force():
    """Momentum along the rail is the impulse of the motor; the load stays a rope's length below."""
    run = compiled("crane").simulate(rtol=1e-10)
    momentum = 1000 * run["trolley.v"] + 4000 * run["load.vx"]
    assert np.allclose(momentum, 2000 * np.minimum(run.time, 2.0), rtol=0, atol=1e-3)
    assert np.allclose(np.hypot(run["x"] - run["q"], run["y"] - 12), 10, rtol=0, atol=1e-12)


def test_andrews_from_parts_is_andrews_from_equations():
    parts = compiled("andrews").simulate(rtol=1e-9, points=16)
    written = models.compiled("classic/andrews").simulate(rtol=1e-9, points=16)
    for angle in ("beta", "Theta", "gamma", "phi", "delta", "Omega", "epsilon"):
        assert np.allclose(parts[angle], written[angle], rtol=0, atol=1e-5), angle


def test_loop_of_the_four_bar_stays_closed():
    run = compiled("four_bar").simulate(rtol=1e-8)
    gap = np.hypot(run["coupler.b.x"] - run["rocker.b.x"], run["coupler.b.y"] - run["rocker.b.y"])
    crank = np.stack([0.3 * np.cos(run["theta"]), 0.3 * np.sin(run["theta"])])
    rocker = np.stack([1 + 0.8 * np.cos(run["psi"]), 0.8 * np.sin(run["psi"])])
    assert gap.max() < 1e-12 and np.abs(np.hypot(*(rocker - crank)) - 0.9).max() < 1e-9
    assert run["theta"][-1] > 2 * np.pi  # the crank turns through


def test_platform_of_the_scissor_lift_stays_level():
    run = compiled("scissor_lift").simulate(rtol=1e-8)
    foot = run["foot_position"]
    assert np.allclose(run["platform.theta"], 0, atol=1e-9)
    assert np.allclose(run["height"], np.sqrt(4 - foot**2), atol=1e-9)


def test_wheel_and_pendulum_keep_what_they_must():
    run = compiled("wheel_with_pendulum").simulate(rtol=1e-10)
    assert np.abs(run["wheel.vx"] + 0.2 * run["wheel.omega"]).max() < 1e-9
    assert np.allclose(run["contact.fn"] > 0, True)


def test_a_yoke_on_two_guides_slides_without_a_warning():
    """It cannot turn, which is what the second guide is for; the crank moves it by x = r cos(theta)."""
    run = lmoc.compile_text("""model Yoke
      import Planar.*;
      inner World world(g = 0);
      Ground ground;
      Revolute main(phi(start = 0.6, fixed = true), omega(start = 5, fixed = true)), pin;
      Bar crank(l = 0.4, m = 1);
      Body yoke(m = 2, J = 0.5, x(start = 0.33));
      Prismatic slot(nx = 0, ny = 1, s(start = 0.2));
      PointOf left, right(rx = 0.5);
      Guide first, second;
    equation
      connect(ground.frame, main.a); connect(main.b, crank.a);
      connect(yoke.frame, slot.a); connect(slot.b, pin.a); connect(pin.b, crank.b);
      connect(yoke.frame, left.frame); connect(left.point, first.point);
      connect(yoke.frame, right.frame); connect(right.point, second.point);
    end Yoke;""").simulate(stop=1, rtol=1e-9)
    assert not any(n.code == "W0417" for n in run.notes)
    theta, omega = run["main.phi"], run["main.omega"]
    assert run["yoke.x"] == pytest.approx(0.4 * np.cos(theta), abs=1e-12)
    energy = (0.4**2 / 3 + 2 * (0.4 * np.sin(theta)) ** 2) * omega**2
    assert energy == pytest.approx(energy[0], rel=1e-7)
