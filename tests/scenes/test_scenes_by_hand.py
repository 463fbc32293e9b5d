"""Scenes that mix parts, against equations of motion derived by hand and integrated by scipy."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy import cos, sin
from scipy.integrate import solve_ivp

import lmoc

G = 9.81


class ByHand(NamedTuple):
    """A scene, x' = rate(t, x), where x starts, and what some variables are."""

    text: str
    rate: Callable
    start: list
    values: dict[str, Callable]
    states: int
    stop: float = 5.0


SCENES = {}

# two levers in series on a rod, the far end on a spring with initial tension: one angle moves all
ARM = 0.5 * 0.4 / -0.3  # of the first mass, about the second pivot
INERTIA = 2 * ARM**2 + 0.7 * 0.9**2 + 0.05
SCENES["levers in series"] = ByHand(
    """model M
      Lever l1(l1 = 0.5, l2 = -0.3, smallAngle = true), l2(l1 = 0.4, l2 = 0.9, smallAngle = true);
      Rod r; Mass m1(m = 2, q(start = 0.1, fixed = true)), m2(m = 0.7, g = 9.81); Inertia J(J = 0.05);
      Spring s(k = 300, d0 = 0.2, L = 0.1); Damper d(c = 3); Fixed w(q0 = 0.05);
    equation
      connect(m1.flange, l1.a); connect(l1.b, r.a); connect(r.b, l2.a); connect(l2.b, m2.flange);
      connect(w.flange, s.a); connect(s.b, m2.flange); connect(w.flange, d.a); connect(d.b, m1.flange);
      connect(J.shaft, l2.pivot);
    end M;""",
    lambda t, x: [x[1], (0.9 * (0.7 * G - 300 * (0.9 * x[0] - 0.15)) - 3 * ARM**2 * x[1]) / INERTIA],
    [0.1 / ARM, 0],
    {
        "m1.q": lambda t, x: ARM * x[0],
        "s.f": lambda t, x: 300 * (0.9 * x[0] - 0.15),
        "l1.pivot.theta": lambda t, x: 2 * ARM * x[0],
    },
    2,
)


def rack(t, x):
    arm, m = 0.7, 2.0
    torque = m * G * arm * cos(x[0]) - 0.5 * x[1] - 30 * 0.2**2 * x[0] + m * arm**2 * sin(x[0]) * cos(x[0]) * x[1] ** 2
    return [x[1], torque / (0.3 + 1.1 * 0.2**2 + m * arm**2 * cos(x[0]) ** 2)]


SCENES["rack, pinion and a turning arm"] = ByHand(
    """model M
      Drum dr(r = 0.2); Arm ar(l = 0.7); Inertia J(J = 0.3); Mass rack(m = 1.1), m(m = 2, g = 9.81);
      TorsionDamper td(c = 0.5); FixedShaft fs; Spring s(k = 30); Fixed w;
    equation
      connect(J.shaft, dr.shaft); connect(J.shaft, ar.shaft); connect(dr.flange, rack.flange);
      connect(ar.flange, m.flange); connect(fs.shaft, td.a); connect(td.b, J.shaft);
      connect(w.flange, s.a); connect(s.b, rack.flange);
    end M;""",
    rack,
    [0, 0],
    {"J.theta": lambda t, x: x[0], "m.q": lambda t, x: 0.7 * sin(x[0]), "rack.q": lambda t, x: 0.2 * x[0]},
    2,
    1.0,
)


def differential(t, x):
    mass = np.array([[0.3 + 0.5 / 4, 0.5 / 4], [0.5 / 4, 0.4 + 0.5 / 4]])
    return [x[2], x[3], *np.linalg.solve(mass, [1.5 - 0.2 * x[2] - 2 * x[0], 1.5 - 0.6 * x[3]])]


SCENES["differential gear"] = ByHand(
    """model M
      PlanetaryGear p(ratio = 1); Inertia s(J = 0.3), r(J = 0.4), c(J = 0.5); Torque t(tau = 3); FixedShaft w;
      TorsionDamper d1(c = 0.2), d2(c = 0.6); TorsionSpring k(k = 2);
    equation
      connect(p.sun, s.shaft); connect(p.ring, r.shaft); connect(p.carrier, c.shaft); connect(t.shaft, c.shaft);
      connect(w.shaft, d1.a); connect(d1.b, s.shaft); connect(w.shaft, d2.a); connect(d2.b, r.shaft);
      connect(w.shaft, k.a); connect(k.b, s.shaft);
    end M;""",
    differential,
    [0, 0, 0, 0],
    {"s.theta": lambda t, x: x[0], "r.theta": lambda t, x: x[1], "c.omega": lambda t, x: (x[2] + x[3]) / 2},
    4,
)

SCENES["cubic spring and damper in series"] = ByHand(
    """model M
      Fixed w; CubicSpring s(k = 50); Damper d(c = 2); Mass m(m = 1.5, q(start = 0.4, fixed = true));
      Force f(f = 1.5*sin(time));
    initial equation
      s.b.q = 0.3;
    equation
      connect(w.flange, s.a); connect(s.b, d.a); connect(d.b, m.flange); connect(f.flange, m.flange);
    end M;""",
    lambda t, x: [x[2] - 25 * x[0] ** 3, x[2], sin(t) - 50 * x[0] ** 3 / 1.5],
    [0.3, 0.4, 0],
    {"m.q": lambda t, x: x[1], "d.f": lambda t, x: 50 * x[0] ** 3},
    3,
)

SHARE = (80 / 50) ** (1 / 3) / (1 + (80 / 50) ** (1 / 3))  # of the extension that the first spring takes
SCENES["cubic springs in series"] = ByHand(
    """model M
      Fixed w; CubicSpring s1(k = 50), s2(k = 80); Mass m(m = 1.5, q(start = 0.4, fixed = true));
    equation
      connect(w.flange, s1.a); connect(s1.b, s2.a); connect(s2.b, m.flange);
    end M;""",
    lambda t, x: [x[1], -50 * (SHARE * x[0]) ** 3 / 1.5],
    [0.4, 0],
    {"m.q": lambda t, x: x[0], "s1.b.q": lambda t, x: SHARE * x[0]},
    2,
)

SCENES["spring in a shaken frame"] = ByHand(
    """model M
      input Real u(unit = "m") = 0.1*sin(3*time);
      Motion mo(q = u); MovingFrame fr(q(start = 0.05, fixed = true), v(start = 0.1, fixed = true));
      Mass m(m = 2, g = 9.81); SpringDamper s(k = 100, c = 2, L = 0.3, d0 = 0.25);
    equation
      connect(mo.flange, fr.base); connect(fr.flange, m.flange); connect(mo.flange, s.a); connect(s.b, m.flange);
    end M;""",
    lambda t, x: [x[1], (-100 * (x[0] + 0.05) - 2 * x[1]) / 2 + G + 0.9 * sin(3 * t)],
    [0.05, 0.1],
    {"fr.q": lambda t, x: x[0], "m.v": lambda t, x: x[1] + 0.3 * cos(3 * t)},
    2,
)


def train(t, x):
    buffer = 20 * (x[0] + 0.3) + 4 * x[3]
    f1, f2 = 60 * (x[1] - x[0] - 0.5), 60 * (x[2] - x[1] - 0.6)
    return [*x[3:], (f1 - buffer) / 2, (f2 - f1) / 3, -f2 / 4]


SCENES["a train of wagons that extend a vehicle"] = ByHand(
    """partial model Vehicle
      Flange p; parameter Real m(unit = "kg") = 1; Mass body(m = m);
    equation connect(p, body.flange);
    end Vehicle;
    model Wagon extends Vehicle(m = 3); Flange q; Rod bar(L = 0.4); parameter Real k(unit = "N/m") = 100;
    equation connect(body.flange, bar.a); connect(bar.b, q);
    end Wagon;
    model Train
      Flange front; parameter Integer N = 3; Wagon w[N](m = {2, 3, 4}, body(each v(start = 0.2)), each body.g = 0);
      Spring s[N - 1](each k = w[1].k, each d0 = 0.1);
    equation
      connect(front, w[1].p);
      for i in 1:N - 1 loop connect(w[i].q, s[i].a); connect(s[i].b, w[i + 1].p); end for;
    end Train;
    model M
      Train t(w(k = fill(60, 3)), s(d0 = {0.1, 0.2})); Fixed f(q0 = -0.3); SpringDamper b(k = 20, c = 4);
    initial equation
      t.w[2].body.q = 0.5; t.w[3].body.q = 1.2; der(t.w[1].body.q) = 0;
    equation
      connect(f.flange, b.a); connect(b.b, t.front);
    end M;""",
    train,
    [0, 0.5, 1.2, 0, 0.2, 0.2],
    {"t.w[3].body.q": lambda t, x: x[2], "t.w[2].bar.f": lambda t, x: 60 * (x[2] - x[1] - 0.6)},
    6,
)


@pytest.mark.parametrize("name", SCENES)
def test_trajectory_states_and_energy(name):
    scene = SCENES[name]
    dae = lmoc.compile_text(scene.text)
    assert len(dae.states) == scene.states
    run = dae.simulate(stop=scene.stop, points=51, rtol=1e-9)
    hand = solve_ivp(scene.rate, (0, scene.stop), scene.start, "DOP853", run.time, rtol=1e-11, atol=1e-12)
    for variable, value in scene.values.items():
        expected = np.array([value(t, x) for t, x in zip(hand.t, hand.y.T, strict=True)])
        assert np.abs(run[variable] - expected).max() < 1e-6 * np.abs(expected).max(), variable
    assert run.energy.balance < 1e-7
    assert dae.simulate(stop=scene.stop).energy.balance < 1e-4
