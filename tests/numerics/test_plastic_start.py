"""Fixed velocities that contradict each other are a plastic impact at the start, where they are those of inertias."""

import numpy as np
import pytest

import lmoc

JOINED = """model Joined "masses that a rod has just joined, the second one on a spring"
  Fixed wall; Spring s(k = 50, L = 0, d0 = 0); Rod rod(L = 1);
  Mass a(m = 2, v(start = 3, fixed = true)), b(m = 3, q(start = 0, fixed = true), v(start = -1, fixed = true));
equation
  connect(wall.flange, s.a); connect(s.b, b.flange); connect(b.flange, rod.a); connect(rod.b, a.flange);
end Joined;"""
MESHED = """model Meshed
  Inertia a(J = 0.3, omega(start = 10, fixed = true)), b(J = 2, omega(start = 1{b})), c(J = 0.7, omega(start = -4{c}));
  Gear first(N = 5), second(N = -2);
equation
  connect(a.shaft, first.a); connect(first.b, b.shaft); connect(b.shaft, second.a); connect(second.b, c.shaft);
end Meshed;"""
FIXED = ", fixed = true"


def warnings(run):
    return [n.code for n in run.notes if n.severity == "warning"]


def test_momentum_is_kept():
    run = lmoc.compile_text(JOINED).simulate(stop=1, rtol=1e-10)
    assert run["a.v"][0] == pytest.approx(0.6, abs=1e-14) and run["b.v"][0] == pytest.approx(0.6, abs=1e-14)
    (event,) = run.events
    assert (event.time, event.kind, event.name) == (0.0, "start", "a, b")
    assert event.energy_lost == pytest.approx(0.5 * 2 * 9 + 0.5 * 3 - 0.5 * 5 * 0.36, rel=1e-12)
    assert warnings(run) == ["W0538"]
    swing = 0.6 * np.sin(np.sqrt(10) * run.time) / np.sqrt(10)
    assert run["b.q"] == pytest.approx(swing, abs=1e-8)


def test_momentum_goes_through_gears():
    """w_a = 5·w_b, w_c = −w_b/2: of all allowed speeds the nearest in the metric of the kinetic energy."""
    run = lmoc.compile_text(MESHED.format(b=FIXED, c=FIXED)).simulate(stop=1)
    speed = (5 * 0.3 * 10 + 2 * 1 - 0.5 * 0.7 * -4) / (25 * 0.3 + 2 + 0.25 * 0.7)
    for name, ratio in (("a", 5), ("b", 1), ("c", -0.5)):
        assert run[f"{name}.omega"][0] == pytest.approx(ratio * speed, rel=1e-12)


def test_a_body_whose_velocity_nobody_has_given_leaves_a_contradiction():
    with pytest.raises(lmoc.ModelError, match="E0531"):
        lmoc.compile_text(MESHED.format(b=FIXED, c="")).simulate(stop=1)


def test_contradicting_positions_are_an_error():
    text = JOINED.replace("v(start = 3, fixed = true)", "q(start = 0.5, fixed = true)")
    with pytest.raises(lmoc.ModelError, match=r"E0531.*a\.q = 0\.5"):
        lmoc.compile_text(text).simulate(stop=1)
