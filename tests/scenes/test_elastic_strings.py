"""Elastic strings, elastic play, and strings that would have to push, against closed forms and reference scenes."""

from math import atan, pi, sqrt

import numpy as np
import pytest

import lmoc


def test_a_mass_falls_into_an_elastic_string() -> None:
    run = lmoc.compile_text(
        """model Drop Fixed anchor; Mass m(m = 1, g = 9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
          ElasticCable string(k = 1000, d0 = 1);
        equation connect(anchor.flange, string.a); connect(string.b, m.flange); end Drop;"""
    ).simulate(stop=0.6, rtol=1e-10, points=601)
    taut, speed, w = sqrt(2 / 9.81), sqrt(2 * 9.81), sqrt(1000)
    sag = 9.81 / 1000
    slack = taut + 2 * (pi - atan(speed / (w * sag))) / w  # the string is longest half way
    for event in run.events:
        assert event.time == pytest.approx(taut if event.after == "true" else slack, abs=1e-9)
    assert {e.after for e in run.events} == {"true", "false"}
    assert run["string.f"].max() == pytest.approx(150.22451527530907, rel=2e-4)
    assert run["string.f"].min() == 0
    assert run.energy.balance < 1e-8


def test_an_elastic_string_with_damping_never_pushes() -> None:
    run = lmoc.compile_text(
        """model Damped Fixed anchor; Mass m(m = 1, g = 9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
          ElasticCable string(k = 1000, d0 = 1, c = 30);
        equation connect(anchor.flange, string.a); connect(string.b, m.flange); end Damped;"""
    ).simulate(stop=3, rtol=1e-9, points=3001)
    assert run["string.f"].min() == 0
    assert run["string.loss"].min() > -1e-9
    assert run.energy.balance < 1e-7
    assert run.energy.lost[-1] > 5


BACKLASH = """model Mesh Inertia J1(J = 1, theta(fixed = true), omega(fixed = true));
  Inertia J2(J = 2, theta(fixed = true), omega(fixed = true));
  Backlash mesh(N = 2, clearance = 0.02, elastic = true, k = 2000); TorsionDamper d(c = 0.2); FixedShaft ground;
  Torque drive(tau = 2*sin(6*time));
equation connect(drive.shaft, J1.shaft); connect(J1.shaft, mesh.a); connect(mesh.b, J2.shaft);
  connect(J2.shaft, d.b); connect(d.a, ground.shaft); end Mesh;"""
# instants at which the flanks touch and part, from piecewise matrix exponentials with 34 digits
TOUCHES = (
    *(0.1741414132814, 0.2184309422020, 0.3848954708697, 0.4283427223970, 0.6059530563502, 0.6493874439335),
    *(0.8023904542737, 0.8473429869761, 1.070155591935, 1.108163797948, 1.244942423560, 1.288074876348),
)


def test_elastic_play_touches_and_parts_when_it_should() -> None:
    run = lmoc.compile_text(BACKLASH).simulate(stop=1.4, rtol=1e-10, points=11)
    found = sorted({round(e.time, 9) for e in run.events})
    near = [min(abs(t - e) for e in found) for t in TOUCHES]
    assert max(near) < 1e-8
    assert max(min(abs(t - e) for t in TOUCHES) for e in found) < 1e-8  # and at no other times
    assert run.energy.balance < 1e-8


@pytest.mark.parametrize("rigid", ["Rod rod(string = true)", "Rod rod"])
def test_a_rod_that_should_be_a_string_tells_when_it_would_push(rigid: str) -> None:
    run = lmoc.compile_text(
        f"""model Push Mass m1(m = 1, q(fixed = true), v(fixed = true)); Mass m2(m = 1); {rigid};
          Force f(f = cos(time));
        equation connect(m1.flange, rod.a); connect(rod.b, m2.flange); connect(m2.flange, f.flange); end Push;"""
    ).simulate(stop=3, points=301)
    told = [n.message for n in run.notes if "would have to push" in n.message]
    assert len(told) == ("string" in rigid)
    if told:
        assert float(told[0].split("t = ")[1].split()[0]) == pytest.approx(pi / 2, abs=0.02)
        assert np.abs(run["rod.f"] - np.cos(run.time) / 2).max() < 1e-6
